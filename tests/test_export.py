from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scenes import sheet

from flatcloth.errors import FlatclothError
from flatcloth.export import export_shape, read_shape


@dataclass(frozen=True)
class Pick:
    id: int
    name: str
    position_held_m: tuple[float, float, float]
    normal_held: tuple[float, float, float]
    view_index: int
    source_rc: tuple[float, float]


PICK = Pick(4, "left <collar>", (0.02, 0.01, 0.001), (0.0, 0.0, -1.0), 1, (5.0, 10.0))


def test_the_arrays_come_back_as_they_were_and_need_no_pickle(tmp_path: Path) -> None:
    view = sheet(1, 0, 40, 12.0)
    export_shape(view, [], tmp_path)
    back = read_shape(tmp_path / "flattened.npz")
    for name in ("rgb", "xyz_m", "normal", "z_angle_deg", "valid", "view_index", "source_rc"):
        original, read = getattr(view, name), getattr(back, name)
        assert read.dtype == original.dtype
        np.testing.assert_array_equal(read, original)
    assert (back.pixel_size_m, back.origin_uv_m) == (view.pixel_size_m, view.origin_uv_m)
    with np.load(tmp_path / "flattened.npz", allow_pickle=False) as data:
        assert str(data["format"]) == "flatcloth-flattened/1"


def test_the_picture_is_transparent_off_the_cloth(tmp_path: Path) -> None:
    view = sheet(1, 0, 40, 12.0)
    valid = view.valid.copy()
    valid[:, :10] = False
    export_shape(replace(view, valid=valid), [], tmp_path)
    image = cv2.imread(str(tmp_path / "flattened.png"), cv2.IMREAD_UNCHANGED)
    assert image is not None
    assert image.shape == (20, 40, 4)
    assert (image[:, :10, 3] == 0).all()
    assert (image[:, 10:, 3] == 255).all()


def test_the_cloud_is_a_readable_ply_of_all_valid_pixels(tmp_path: Path) -> None:
    view = sheet(1, 0, 40, 12.0)
    export_shape(view, [], tmp_path)
    head, body = (tmp_path / "cloud.ply").read_bytes().split(b"end_header\n", 1)
    assert b"element vertex 800" in head
    record = np.dtype([("x", "<f4", 3), ("n", "<f4", 3), ("rgb", "u1", 3), ("uv", "<f4", 2)])
    points = np.frombuffer(body, record)
    np.testing.assert_array_equal(points["x"], view.xyz_m[view.valid])
    np.testing.assert_array_equal(points["rgb"], view.rgb[view.valid])
    np.testing.assert_allclose(points["uv"], points["x"][:, :2], atol=1e-6)


def test_picks_are_written_with_their_place_in_space_and_on_the_plane(tmp_path: Path) -> None:
    export_shape(sheet(1, 0, 40, 12.0), [PICK], tmp_path)
    document = json.loads((tmp_path / "grasps.json").read_text())
    assert document["format"] == "flatcloth-grasps/1"
    assert document["frame"] == "held"
    (grasp,) = document["grasps"]
    assert grasp["name"] == PICK.name
    assert grasp["position_m"] == list(PICK.position_held_m)
    assert (grasp["flattened"]["row"], grasp["flattened"]["col"]) == (5, 10)
    assert grasp["flattened"]["distance_m"] == pytest.approx(0.001, abs=1e-6)


def test_a_folder_that_cannot_be_written_is_one_clear_line(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    with pytest.raises(FlatclothError, match="choose another folder"):
        export_shape(sheet(1, 0, 4, 0.0), [], blocked / "out")


@pytest.mark.parametrize("content", [b"", b"not an archive", b"PK\x03\x04truncated"])
def test_a_damaged_export_is_one_clear_line(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "flattened.npz"
    path.write_bytes(content)
    with pytest.raises(FlatclothError, match=r"flattened\.npz: .*export it again"):
        read_shape(path)


def test_another_format_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "flattened.npz"
    np.savez(path, format=np.str_("flatcloth-flattened/9"))
    with pytest.raises(FlatclothError, match="flatcloth-flattened/9"):
        read_shape(path)
