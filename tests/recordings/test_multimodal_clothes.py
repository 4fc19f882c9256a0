"""MultimodalClothes: a made-up tree of its layout, with an exact cylinder that is turned forth and back."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from pcd_files import write_pcd
from scenes import CAMERA, Cylinder

from flatcloth.core.errors import RecordingError
from flatcloth.core.geometry import back_project
from flatcloth.recordings import SourceOptions, open_recording
from flatcloth.recordings.registry import recordings_below

TURNING_DEG = 240.0
STEP_DEG = TURNING_DEG / 24


def write_area(folder: Path, *, clouds: bool = True, images: int = 50, name: str = "take") -> Path:
    """Write an area: forth to the turning range in 25 images, and back in 25."""
    folder.mkdir(parents=True)
    for n in range(images):
        angle = STEP_DEG * (n if n < 25 else 49 - n)
        seen = Cylinder(angles_deg=(angle,), span_deg=(-100.0, 250.0))[0]
        stem = folder / f"{name}_{n:02d}"
        assert cv2.imwrite(f"{stem}_rgb.png", seen.color[::4, ::4, ::-1] if clouds else seen.color[..., ::-1])
        assert cv2.imwrite(f"{stem}_depth.png", np.rint(1000 * seen.depth_m).astype(np.uint16))
        if clouds:
            points = np.where(seen.depth_m[..., None] > 0, back_project(seen.depth_m, CAMERA), np.nan)
            write_pcd(Path(f"{stem}_pc.pcd"), points, seen.color)
    (folder / f"{name}_ft.csv").write_text("not read\n")
    return folder


@pytest.fixture(scope="module")
def area(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_area(tmp_path_factory.mktemp("data") / "07" / "33" / "02")


def opened(area: Path, **options: Any) -> Any:
    return open_recording(area, SourceOptions(**({"turning_deg": TURNING_DEG} | options)))


def refused(area: Path, cause: str, **options: Any) -> None:
    with pytest.raises(RecordingError, match=cause) as caught:
        opened(area, **options)
    assert "\n" not in str(caught.value)


def test_an_area_is_one_recording_whose_camera_its_clouds_tell(area: Path) -> None:
    recording = opened(area)
    assert recording.name == "07-33-02"
    np.testing.assert_allclose(recording.angles_deg, STEP_DEG * np.arange(25))
    for name in ("fx", "fy", "cx", "cy"):
        assert getattr(recording.intrinsics, name) == pytest.approx(getattr(CAMERA, name), abs=0.05)
    assert "focal length 425.0" in recording.notes[0]
    exact = Cylinder(angles_deg=(STEP_DEG * 3,), span_deg=(-100.0, 250.0))[0]
    frame = recording[3]
    np.testing.assert_allclose(frame.depth_m, exact.depth_m, atol=1e-5)
    np.testing.assert_array_equal(frame.color, exact.color)


def test_the_sweep_back_has_the_angles_backwards(area: Path) -> None:
    recording = opened(area, sweep="back")
    np.testing.assert_allclose(recording.angles_deg, -STEP_DEG * np.arange(25))
    exact = Cylinder(angles_deg=(TURNING_DEG - STEP_DEG * 4,), span_deg=(-100.0, 250.0))[0]
    np.testing.assert_allclose(recording[4].depth_m, exact.depth_m, atol=1e-5)


def test_images_without_clouds_need_a_camera_and_one_size(tmp_path: Path) -> None:
    plain = write_area(tmp_path / "01" / "02" / "03", clouds=False, images=26)
    refused(plain, "does not describe its camera")
    recording = opened(plain, fov_deg=(31.5, 31.5))
    assert recording.name == "01-02-03"
    assert "approximate" in recording.notes[0]
    assert recording[2].depth_m.max() == pytest.approx(Cylinder()[0].depth_m.max(), abs=0.001)
    for file in plain.glob("*_rgb.png"):
        cv2.imwrite(str(file), cv2.imread(str(file))[::2])
    refused(plain, "not registered", fov_deg=(31.5, 31.5))


def test_what_is_not_known_is_asked_for(area: Path, tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="--turning DEG"):
        open_recording(area)
    refused(area, "--turning given together with --step", step_deg=10.0)
    refused(area, "1 to 720", turning_deg=0.0)
    assert len(open_recording(area, step_deg=7.0)) == 25
    assert len(opened(area, turning_deg=360.0)) == 24  # the last shows the first again
    few = write_area(tmp_path / "few", images=3)
    refused(few, "no images of the sweep back", sweep="back")
    (few / "other_04_rgb.png").write_bytes((few / "take_00_rgb.png").read_bytes())
    refused(few, "images of 2 recordings")


def test_a_missing_image_keeps_the_angles_of_the_others(tmp_path: Path) -> None:
    few = write_area(tmp_path / "few", images=5)
    (few / "take_02_rgb.png").unlink()
    np.testing.assert_allclose(opened(few).angles_deg, STEP_DEG * np.array([0, 1, 3, 4]))
    (few / "take_03_pc.pcd").write_bytes((few / "take_03_pc.pcd").read_bytes()[:-100])
    with pytest.raises(RecordingError, match=r"take_03_pc\.pcd: truncated"):
        opened(few)[2]


def test_the_areas_of_a_data_set_a_class_or_a_sample_are_found(area: Path, tmp_path: Path) -> None:
    other = write_area(area.parents[1] / "34" / "01", images=1)
    (area.parents[2] / "readme").mkdir(exist_ok=True)
    for place, found in (
        (area.parents[2], (area, other)),
        (area.parents[1], (area, other)),
        (area.parent, (area,)),
        (area, ()),
        (tmp_path, ()),
    ):
        assert recordings_below(place) == found


def test_options_that_a_format_has_no_use_for_are_refused(tmp_path: Path) -> None:
    from foreign_folders import write_open3d
    from tiny_recordings import write_recording

    with pytest.raises(RecordingError, match=r"contains its camera. Leave out --fov"):
        open_recording(write_recording(tmp_path / "a"), SourceOptions(fov_deg=(60, 40)))
    with pytest.raises(RecordingError, match=r"Leave out --turning"):
        open_recording(write_open3d(tmp_path / "b"), SourceOptions(turning_deg=60))
