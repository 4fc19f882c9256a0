"""Films with stops from TUM folders and ROS recordings: the stops are found, their frames averaged."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from realsense_files import Shot, stop_and_go, turning
from ros_bags import COLOR, DEPTH, START_S, Image, Info, Message, write
from scenes import CAMERA, Cylinder

from flatcloth.cli import main
from flatcloth.core.errors import RecordingError
from flatcloth.recordings import open_recording

STEP_DEG, STOPS, FPS = 20.0, 3, 15.0
SHOTS = turning(stop_and_go(STOPS, STEP_DEG, 1.0, 0.8), 4.8, fps=FPS)


def tum(place: Path, shots: list[Shot] = SHOTS) -> Path:
    lines = []
    for kind in ("rgb", "depth"):
        (place / kind).mkdir(parents=True)
    for n, shot in enumerate(shots):
        assert shot.color is not None
        assert shot.depth_mm is not None
        assert cv2.imwrite(str(place / f"rgb/{n}.png"), shot.color[..., ::-1])
        assert cv2.imwrite(str(place / f"depth/{n}.png"), 5 * shot.depth_mm)
        time_s = 1000.0 + shot.time_s
        lines.append(f"{time_s:.4f} rgb/{n}.png {time_s:.4f} depth/{n}.png\n")
    (place / "associations.txt").write_text("".join(lines))
    (place / "calibration.txt").write_text(f"{CAMERA.fx} {CAMERA.fy} {CAMERA.cx} {CAMERA.cy}")
    return place


def ros(place: Path) -> Path:
    k = (CAMERA.fx, 0.0, CAMERA.cx, 0.0, CAMERA.fy, CAMERA.cy, 0.0, 0.0, 1.0)
    messages = []
    for shot in SHOTS:
        at = START_S + shot.time_s
        assert shot.color is not None
        assert shot.depth_mm is not None
        messages += [
            Message(COLOR, at, Image("rgb8", shot.color)),
            Message(DEPTH, at, Image("16UC1", shot.depth_mm)),
            Message("/camera/color/camera_info", at, Info(k=k, size=(CAMERA.width, CAMERA.height))),
        ]
    return write(place.with_suffix(".mcap"), messages)


@pytest.mark.parametrize("source", [tum, ros])
def test_the_stops_of_a_film_are_found_and_their_frames_averaged(source, tmp_path: Path) -> None:
    film = open_recording(source(tmp_path / "film"), step_deg=STEP_DEG)
    assert film.angles_deg == (0.0, 20.0, 40.0)
    assert getattr(film, "notes", None) == (
        f"A film: 3 stops were found in {len(SHOTS)} images, assumed 20 degrees apart.",
    )
    for view in range(STOPS):
        true, _ = Cylinder(angles_deg=(STEP_DEG * view,)).surface(0)
        frame = film[view]
        cloth = (frame.depth_m > 0) & (frame.depth_m < 1.2) & np.isfinite(true)
        error_mm = 1000 * (frame.depth_m - true)[cloth]
        # One frame has 1.4 mm of noise: the average has less, and it is of the right angle.
        assert np.median(np.abs(error_mm)) < 0.6
        assert frame.angle_deg == film.angles_deg[view]
    with pytest.raises(IndexError):
        film[STOPS]


def test_a_film_is_imported_as_a_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert main(["import", str(tum(tmp_path / "film")), "--step", "-20", "--out", str(out)]) == 0
    assert "A film: 3 stops were found" in capsys.readouterr().out
    assert open_recording(out).angles_deg == (0.0, -20.0, -40.0)


def test_what_comes_after_a_whole_turn_is_left_out(tmp_path: Path) -> None:
    assert open_recording(tum(tmp_path / "film"), step_deg=180).angles_deg == (0.0, 180.0)


def test_a_film_in_which_nothing_stands_still_is_refused(tmp_path: Path) -> None:
    place = tum(tmp_path / "film", turning(lambda t: 60.0 * t, 3.0, fps=FPS))
    with pytest.raises(RecordingError, match="never stands still for half a second"):
        open_recording(place, step_deg=STEP_DEG)


def test_a_frame_that_shows_nothing_does_not_end_a_stop(tmp_path: Path) -> None:
    place = tum(tmp_path / "film")
    blank = np.zeros((CAMERA.height, CAMERA.width), dtype=np.uint16)
    assert cv2.imwrite(str(place / "depth/5.png"), blank)
    film = open_recording(place, step_deg=STEP_DEG)
    assert film.angles_deg == (0.0, 20.0, 40.0)
    assert film[0].depth_m.any()
