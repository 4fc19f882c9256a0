import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from scenes import sheet

from flatcloth.core.errors import FlatclothError
from flatcloth.core.geometry import Rigid3, camera_from_object, rotation_about
from flatcloth.core.types import RotationAxis
from flatcloth.export.data import (
    GraspFrames,
    grasps_document,
    json_bytes,
    read_shape,
    remove_stale,
    side_files,
    write_files,
)
from flatcloth.grasping.grasps import Grip
from flatcloth.session.journal import Pick


def pick(number: int, name: str, position: tuple[float, ...], normal: tuple[float, ...]) -> Pick:
    return Pick(
        id=number, name=name, position_held_m=np.array(position), normal_held=np.array(normal), view_index=1,
        source_rc=(5.0, 10.0),
    )  # fmt: skip


AXIS = RotationAxis(point_m=np.array([0.0, 0.0, 0.85]), direction=np.array([0.0, -1.0, 0.0]))
FRAMES = GraspFrames(axis=AXIS, rotation_deg=0.0)
PICK = pick(4, "left <collar>", (0.02, 0.01, 0.001), (0.0, 0.0, -1.0))


def test_arrays_picture_and_cloud_are_those_of_the_cloth_and_need_no_pickle(tmp_path: Path) -> None:
    view = sheet(1, 0, 40, 12.0)
    view.valid[:, :10] = False
    write_files(side_files("this", view), tmp_path)
    back = read_shape(tmp_path / "flattened.npz")
    for name in ("rgb", "xyz_m", "normal", "z_angle_deg", "valid", "view_index", "source_rc"):
        original, read = getattr(view, name), getattr(back, name)
        assert read.dtype == original.dtype
        np.testing.assert_array_equal(read, original)
    assert (back.pixel_size_m, back.origin_uv_m) == (view.pixel_size_m, view.origin_uv_m)
    with np.load(tmp_path / "flattened.npz", allow_pickle=False) as data:
        assert str(data["format"]) == "flatcloth-flattened/1"
    image = cv2.imread(str(tmp_path / "flattened.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(image[..., 3], np.where(view.valid, 255, 0))
    head, body = (tmp_path / "cloud.ply").read_bytes().split(b"end_header\n", 1)
    assert b"element vertex 600" in head
    record = np.dtype([("x", "<f4", 3), ("n", "<f4", 3), ("rgb", "u1", 3), ("uv", "<f4", 2)])
    points = np.frombuffer(body, record)
    np.testing.assert_array_equal(points["x"], view.xyz_m[view.valid])
    np.testing.assert_array_equal(points["rgb"], view.rgb[view.valid])
    np.testing.assert_allclose(points["uv"], points["x"][:, :2], atol=1e-6)


def matrix(pose: dict[str, object]) -> np.ndarray:
    return np.array(pose["matrix"])


def test_a_pose_is_given_in_held_camera_and_robot_frame(tmp_path: Path) -> None:
    base = Rigid3(rotation_about(np.array([1.0, 0, 0]), -2.0), np.array([0.4, -0.2, 0.9]))
    frames = GraspFrames(
        axis=AXIS, rotation_deg=70.0, grips={4: Grip(opening_m=0.055)}, base_from_camera=base
    )
    document = grasps_document(sheet(1, 0, 40, 12.0), [PICK], frames)
    assert document["rotation_deg"] == 70.0
    assert document["rotation_axis"]["direction"] == [0.0, -1.0, 0.0]
    (grasp,) = document["grasps"]
    held, camera, robot = (matrix(grasp["poses"][name]) for name in ("held", "camera", "base"))
    np.testing.assert_allclose(held[:3, 3], PICK.position_held_m, atol=1e-6)
    np.testing.assert_allclose(held[:3, 2], [0, 0, 1], atol=1e-6)  # into the cloth
    np.testing.assert_allclose(held[3], [0, 0, 0, 1])
    turn = camera_from_object(AXIS, 70.0)
    np.testing.assert_allclose(camera[:3, :3], turn.rotation @ held[:3, :3], atol=1e-6)
    np.testing.assert_allclose(camera[:3, 3], turn.apply(held[:3, 3]), atol=1e-6)
    np.testing.assert_allclose(robot, np.array(document["base_from_camera"]) @ camera, atol=2e-6)
    assert grasp["grip"]["opening_m"] == 0.055
    assert grasp["grip"]["axis_from"] == "outline"
    assert grasp["uncertainty"]["position_m"] == pytest.approx(0.0, abs=1e-6)
    for pose in grasp["poses"].values():
        assert np.linalg.norm(pose["quaternion_wxyz"]) == pytest.approx(1.0, abs=1e-6)
        assert pose["position_m"] == [row[3] for row in pose["matrix"][:3]]


def test_a_smaller_export_removes_the_pieces_of_a_larger_one(tmp_path: Path) -> None:
    view = sheet(1, 0, 40, 12.0)
    write_files(side_files("this", view, [view, view]), tmp_path)
    remove_stale(["flattened.npz", "floating-1.npz"], tmp_path)
    assert not (tmp_path / "floating-2.npz").exists()
    assert (tmp_path / "floating-1.npz").exists()


def test_what_is_not_known_is_null_and_the_file_stays_json() -> None:
    nowhere = pick(5, "lost", (0.5, 0.5, 0.5), (0.0, 0.0, -1.0))
    blind = pick(6, "blind", (0.02, 0.01, 0.0), (float("nan"),) * 3)
    text = json_bytes(grasps_document(sheet(1, 0, 40, 12.0), [nowhere, blind], FRAMES)).decode()
    assert "NaN" not in text
    lost, unseen = json.loads(text)["grasps"]
    assert lost["uncertainty"] == dict.fromkeys(("position_m", "normal_deg", "axis_deg", "placement_m"))
    assert lost["grip"]["axis_from"] == "level"
    assert (unseen["poses"], unseen["grip"], unseen["normal"]) == (None, None, [None, None, None])


@pytest.mark.parametrize("content", [b"", b"not an archive", b"PK\x03\x04truncated"])
def test_an_export_that_is_damaged_or_of_another_format_is_one_clear_line(
    tmp_path: Path, content: bytes
) -> None:
    path = tmp_path / "flattened.npz"
    path.write_bytes(content)
    with pytest.raises(FlatclothError, match=r"flattened\.npz: .*export it again"):
        read_shape(path)
    np.savez(path, format=np.str_("flatcloth-flattened/9"))
    with pytest.raises(FlatclothError, match="flatcloth-flattened/9"):
        read_shape(path)
