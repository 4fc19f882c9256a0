"""The whole program on folders and bags of others: opened, the axis found, integrated, resumed."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from ros_bags import COLOR, DEPTH, START_S, Image, Info, Message, write
from scenes import AXIS, CAMERA, Cylinder

from benchmarks.size import write_recording
from flatcloth.cli import main
from flatcloth.export.data import read_shape
from flatcloth.recordings import open_recording

STEP_DEG = 20.0
VIEWS = 4


def frames() -> list[tuple[np.ndarray, np.ndarray]]:
    """Color and depth (mm) of a cylinder that turns; its checkers are in color, its depth exact."""
    cylinder = Cylinder(angles_deg=tuple(STEP_DEG * n for n in range(VIEWS)), masks=False)
    seen = [cylinder[n] for n in range(VIEWS)]
    return [(frame.color, np.round(1000 * frame.depth_m).astype(np.uint16)) for frame in seen]


def tum(place: Path) -> Path:
    lines = []
    for n, (color, depth) in enumerate(frames()):
        for kind, pixels in (("rgb", color[..., ::-1]), ("depth", 5 * depth)):
            (place / kind).mkdir(parents=True, exist_ok=True)
            assert cv2.imwrite(str(place / kind / f"{n}.png"), pixels)
        lines.append(f"{n}.0 rgb/{n}.png {n}.0 depth/{n}.png\n")
    (place / "associations.txt").write_text("".join(lines))
    (place / "calibration.txt").write_text(f"{CAMERA.fx} {CAMERA.fy} {CAMERA.cx} {CAMERA.cy}")
    return place


def open3d(place: Path) -> Path:
    for n, (color, depth) in enumerate(frames()):
        (place / "color").mkdir(parents=True, exist_ok=True)
        (place / "depth").mkdir(exist_ok=True)
        assert cv2.imwrite(str(place / "color" / f"{n}.png"), color[..., ::-1])
        np.save(place / "depth" / f"{n}.npy", depth / np.float32(1000))
    matrix = [CAMERA.fx, 0, 0, 0, CAMERA.fy, 0, CAMERA.cx, CAMERA.cy, 1]
    (place / "intrinsic.json").write_text(json.dumps({"intrinsic_matrix": matrix}))
    return place


def ros(place: Path) -> Path:
    k = (CAMERA.fx, 0.0, CAMERA.cx, 0.0, CAMERA.fy, CAMERA.cy, 0.0, 0.0, 1.0)
    messages = []
    for n, (color, depth) in enumerate(frames()):
        messages += [
            Message(COLOR, START_S + n, Image("rgb8", color)),
            Message(DEPTH, START_S + n, Image("16UC1", depth)),
            Message("/camera/color/camera_info", START_S + n, Info(k=k, size=(CAMERA.width, CAMERA.height))),
        ]
    return write(place.with_suffix(".mcap"), messages)


@pytest.mark.parametrize("source", [tum, open3d, ros])
def test_a_source_of_others_is_integrated_and_resumed(
    source: Callable[[Path], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place, out = source(tmp_path / "turned"), tmp_path / "out"
    arguments = ["run", str(place), "--step", str(STEP_DEG), "--out", str(out)]
    assert main(arguments) == 0
    assert "turned: " in capsys.readouterr().out
    view = read_shape(out / "flattened.npz")
    # The cylinder's side: its points lie on it, whatever view they come from.
    points = view.xyz_m[view.valid].astype(float) - AXIS.point_m
    assert abs(np.median(np.hypot(points[:, 0], points[:, 2])) - 0.12) < 0.003
    kept = json.loads((out / "axis.json").read_text())
    assert kept["estimated"] is True
    assert abs(kept["point_m"][0]) < 0.005
    assert abs(kept["point_m"][2] - 0.85) < 0.005
    assert main(arguments) == 0
    np.testing.assert_array_equal(read_shape(out / "flattened.npz").xyz_m, view.xyz_m)


def test_a_source_without_angles_is_told_how_to_give_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", str(open3d(tmp_path / "turned")), "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert "--step DEG, or --angles FILE.csv" in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_the_recording_of_the_size_benchmark_is_one(tmp_path: Path) -> None:
    recording = open_recording(write_recording(tmp_path / "large", 2, width=72, height=128))
    assert recording.angles_deg == (0.0, 180.0)
    frame = recording[0]
    assert frame.mask is not None
    assert 0.02 < frame.mask.mean() < 0.5
    near = frame.depth_m[frame.mask]
    assert 0.6 < near.min() < near.max() < 0.9
    assert (frame.depth_m[~frame.mask] > 0.9).mean() > 0.9
