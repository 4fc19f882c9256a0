"""Organised PCD files: each layout, the camera that their points tell, and every damage."""

import sys
from pathlib import Path

import numpy as np
import pytest
from foreign_folders import write_open3d
from pcd_files import CAMERA, cloud_points, write_pcd

from flatcloth.core.errors import RecordingError
from flatcloth.recordings import open_recording
from flatcloth.recordings.files.depth_files import camera_of, read_pcd


@pytest.mark.parametrize("layout", ["ascii", "binary", "binary_compressed"])
@pytest.mark.parametrize("rgb_type", ["F", "U"])
def test_points_and_colors_come_out_as_written(tmp_path: Path, layout: str, rgb_type: str) -> None:
    points, colors = cloud_points()
    file = write_pcd(tmp_path / "a.pcd", points, colors, layout=layout, rgb_type=rgb_type)
    cloud = read_pcd(file)
    np.testing.assert_allclose(cloud.xyz_m, points, atol=1e-6)
    np.testing.assert_array_equal(cloud.rgb, colors)
    np.testing.assert_allclose(cloud.depth_m, np.nan_to_num(points[..., 2]), atol=1e-6)
    assert (cloud.depth_m[np.isnan(points[..., 2])] == 0).all()


@pytest.mark.parametrize("lens", [(0.0, 0.0, 0.0, 0.0, 0.0), (0.1, -0.05, 0.002, -0.001, 0.0)])
def test_the_points_tell_their_camera_and_its_lens(tmp_path: Path, lens: tuple[float, ...]) -> None:
    points, colors = cloud_points(lens=lens)
    found, found_lens = camera_of(read_pcd(write_pcd(tmp_path / "a.pcd", points, colors)), tmp_path / "a.pcd")
    for name in ("fx", "fy", "cx", "cy"):
        assert getattr(found, name) == pytest.approx(getattr(CAMERA, name), abs=0.05)
    assert found_lens.is_identity == (not any(lens))
    # What matters: undone, the depth is that of a camera without a lens.
    straight = found_lens.undistort(np.nan_to_num(points[..., 2]).astype(np.float32), blend=False)
    truth = cloud_points()[0][..., 2]
    inner = (slice(10, -10), slice(10, -10))
    assert np.median(np.abs(straight[inner] - truth[inner])[straight[inner] > 0]) < 1e-3


def test_without_open3d_it_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = write_pcd(tmp_path / "a.pcd", *cloud_points())
    monkeypatch.setitem(sys.modules, "open3d", None)
    with pytest.raises(RecordingError, match=r"needs .* open3d, .*pip install 'flatcloth\[synthesis\]'"):
        read_pcd(file)


def test_points_of_no_camera_are_refused(tmp_path: Path) -> None:
    points, colors = cloud_points()
    shuffled = np.random.default_rng(0).permutation(points.reshape(-1, 3)).reshape(points.shape)
    for wrong, cause in (
        (shuffled, "miss their pixels"),
        (np.full_like(points, np.nan), "too few points"),
        (points * [0, 0, 1], "one line of sight"),
    ):
        file = write_pcd(tmp_path / "a.pcd", wrong, colors)
        with pytest.raises(RecordingError, match=cause) as caught:
            camera_of(read_pcd(file), file)
        assert "\n" not in str(caught.value)


def test_damage_is_told_in_one_line(tmp_path: Path) -> None:
    points, colors = cloud_points()
    file = tmp_path / "a.pcd"
    whole = {
        layout: write_pcd(file, points, colors, layout=layout).read_bytes()
        for layout in ("ascii", "binary", "binary_compressed")
    }
    binary = whole["binary"]
    for data, cause in (
        *((data[:-2000], "truncated or damaged") for data in whole.values()),
        (
            binary.replace(b"HEIGHT 48", b"HEIGHT 1").replace(b"WIDTH 64", b"WIDTH 3072"),
            "a list, not an image",
        ),
        (binary.replace(b"FIELDS x y z", b"FIELDS u v w"), "not a PCD file with x, y and z"),
        (binary.replace(b"WIDTH 64", b"WIDTH 9999999"), "damaged"),
        (binary.replace(b"SIZE 4", b"SIZE 3"), "damaged"),
        (binary.replace(b"DATA binary", b"DATA xml___"), "damaged"),
        (binary[:100], "damaged"),
        (whole["binary_compressed"].replace(b"compressed\n", b"compressed\n\xff\xff\xff\xff"), "truncated"),
    ):
        file.write_bytes(data)
        with pytest.raises(RecordingError, match=cause) as caught:
            read_pcd(file)
        assert "\n" not in str(caught.value)
    with pytest.raises(RecordingError, match="cannot be read"):
        read_pcd(tmp_path / "nowhere.pcd")


def test_depth_of_a_folder_may_be_pcd_and_then_tells_the_camera(tmp_path: Path) -> None:
    folder = write_open3d(tmp_path / "scan", camera={"any": 1})
    (folder / "intrinsic.json").unlink()
    points, _ = cloud_points(size=(12, 16), focal_px=20.0)
    for file in sorted(folder.glob("depth/*.png")):
        write_pcd(file.with_suffix(".pcd"), points, None, layout="binary")
        file.unlink()
    recording = open_recording(folder, step_deg=10)
    assert recording.intrinsics.fx == pytest.approx(20.0, abs=0.01)
    np.testing.assert_allclose(recording[1].depth_m, np.nan_to_num(points[..., 2]), atol=1e-6)
    file = folder / "depth/00001.pcd"
    file.write_bytes(file.read_bytes()[:-40])
    with pytest.raises(RecordingError, match="truncated"):
        open_recording(folder, step_deg=10)
