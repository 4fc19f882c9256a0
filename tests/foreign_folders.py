"""Folders and bags as other programs write them, of a few pixels."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from flatcloth.core.errors import RecordingError
from flatcloth.core.types import Intrinsics
from flatcloth.recordings import open_recording

WIDTH, HEIGHT = 16, 12
FOCAL_PX, CENTER_PX = 20.0, (7.5, 5.5)
MATRIX = [FOCAL_PX, 0, 0, 0, FOCAL_PX, 0, *CENTER_PX, 1]  # by columns


def read(source: Path, **options: Any) -> list[Any]:
    """Open a source, 10 degrees a view unless other angles are given, and return its frames."""
    given = options if {"angles", "step_deg"} & options.keys() else {"step_deg": 10.0} | options
    recording = open_recording(source, **given)
    return [recording[n] for n in range(len(recording))]


def refused(source: Path, cause: str, **options: Any) -> str:
    """Read a source that is refused for a cause; return the line."""
    with pytest.raises(RecordingError, match=cause) as caught:
        read(source, **options)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def write_films(place: Path, frames: Sequence[tuple[float, Any, Any]], camera: Intrinsics) -> None:
    """Write a TUM folder of times (s), color and depth (mm)."""
    lines = []
    for n, (time_s, color, depth_mm) in enumerate(frames):
        write(place / f"rgb/{n}.png", color)
        write(place / f"depth/{n}.png", 5 * depth_mm)
        lines.append(f"{time_s:.4f} rgb/{n}.png {time_s:.4f} depth/{n}.png\n")
    (place / "associations.txt").write_text("".join(lines))
    (place / "calibration.txt").write_text(f"{camera.fx} {camera.fy} {camera.cx} {camera.cy}")


def rgb(view: int) -> np.ndarray:
    """Color of a view: told apart by its blue, and upright by a bright top."""
    pixels = np.zeros((HEIGHT, WIDTH, 3), dtype=np.uint8)
    pixels[..., 0], pixels[..., 2] = 200, (10 * view) % 250
    pixels[:3, :, 1] = 250
    return pixels


def depth_m(view: int) -> np.ndarray:
    depth = np.full((HEIGHT, WIDTH), 0.8 + 0.01 * view)
    depth[0, 0] = 0.0
    return depth


def write(path: Path, pixels: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".npy":
        np.save(path, pixels)
    else:
        shown = pixels[..., ::-1] if pixels.ndim == 3 else pixels
        assert cv2.imwrite(str(path), np.ascontiguousarray(shown))


def write_open3d(
    folder: Path, views: int = 3, *, suffix: str = ".png", dtype: Any = np.uint16, camera: Any = None
) -> Path:
    """Write ``color/``, ``depth/`` and ``intrinsic.json``; whole-numbered depth in millimetres."""
    folder.mkdir(parents=True, exist_ok=True)
    for n in range(views):
        write(folder / "color" / f"{n:05d}.png", rgb(n))
        whole = np.issubdtype(dtype, np.integer)
        units = np.round(depth_m(n) * 1000) if whole else depth_m(n)
        write(folder / "depth" / f"{n:05d}{suffix}", units.astype(dtype))
    camera = camera or {"width": WIDTH, "height": HEIGHT, "intrinsic_matrix": MATRIX}
    (folder / "intrinsic.json").write_text(json.dumps(camera))
    return folder


def write_tum(folder: Path, views: int = 3, *, associations: bool = True) -> Path:
    """Write ``rgb/``, ``depth/`` (5000 units per metre), their lists and ``calibration.txt``."""
    folder.mkdir(parents=True, exist_ok=True)
    lines: dict[str, list[str]] = {"rgb": ["# color images"], "depth": ["# depth maps"], "both": []}
    for n in range(views):
        color_s, depth_s = 1305031102.175304 + n, 1305031102.160407 + n
        color, depth = f"rgb/{color_s:.6f}.png", f"depth/{depth_s:.6f}.png"
        write(folder / color, rgb(n))
        write(folder / depth, np.round(depth_m(n) * 5000).astype(np.uint16))
        lines["rgb"].append(f"{color_s:.6f} {color}")
        lines["depth"].append(f"{depth_s:.6f} {depth}")
        lines["both"].append(f"{color_s:.6f} {color} {depth_s:.6f} {depth}")
    lists = {"associations.txt": "both"} if associations else {"rgb.txt": "rgb", "depth.txt": "depth"}
    for name, key in lists.items():
        (folder / name).write_text("\n".join(lines[key]) + "\n")
    (folder / "calibration.txt").write_text(f"{FOCAL_PX} {FOCAL_PX} {CENTER_PX[0]} {CENTER_PX[1]}\n")
    return folder
