"""Recordings of a few pixels, in memory and on disk; and of few views of a bundled one."""

import copy
import json
import shutil
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from flatcloth.core.resources import sample_recordings
from flatcloth.core.types import Intrinsics, RotationAxis
from flatcloth.recordings.base import Recording, ViewImages

WIDTH, HEIGHT = 16, 12

HEADER: dict[str, Any] = {
    "format": "flatcloth-recording/1",
    "name": "tiny",
    "description": "a few pixels",
    "intrinsics": {
        "width": WIDTH,
        "height": HEIGHT,
        "fx": 20.0,
        "fy": 20.0,
        "cx": 7.5,
        "cy": 5.5,
        "distortion_model": "none",
        "distortion": [],
    },
    "depth_scale_m": 0.001,
    "rotation_axis": {"point_m": [0.0, -0.1, 0.85], "direction": [0.0, -1.0, 0.0]},
    "held_point_m": [0.0, -0.1, 0.85],
    "views": [
        {
            "angle_deg": 10.0 * i,
            "color": f"color/{i}.png",
            "depth": f"depth/{i}.png",
            "mask": f"mask/{i}.png",
            "truth": f"truth/{i}.png",
        }
        for i in range(3)
    ],
    "truth": {"garment": "towel", "held_at": "corner", "panel_of_interest": 1},
}


def header() -> dict[str, Any]:
    """Return a valid header that a test may change."""
    return copy.deepcopy(HEADER)


def write_header(folder: Path, content: Any) -> None:
    (folder / "recording.json").write_text(json.dumps(content))


def write_image(path: Path, pixels: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), pixels)


def write_recording(folder: Path) -> Path:
    """Write a valid recording of three views; view i is told apart by its pixels."""
    folder.mkdir(parents=True, exist_ok=True)
    write_header(folder, header())
    for i in range(3):
        bgr = np.zeros((HEIGHT, WIDTH, 3), dtype=np.uint8)
        bgr[..., 2], bgr[..., 0] = 200, 10 * i
        depth = np.full((HEIGHT, WIDTH), 850 + i, dtype=np.uint16)
        depth[0, 0] = 0
        mask = np.zeros((HEIGHT, WIDTH), dtype=np.uint8)
        mask[2:, :] = 255
        truth = np.zeros((HEIGHT, WIDTH, 3), dtype=np.uint16)
        truth[4:8, 4:8] = (17, 20000, 40000)  # B panel 1 from outside, G v = -0.5 m, R u = 0.5 m
        truth[8:, 4:8] = (2, 30000, 30000)
        for kind, pixels in (("color", bgr), ("depth", depth), ("mask", mask), ("truth", truth)):
            write_image(folder / kind / f"{i}.png", pixels)
    return folder


MemoryRecording = partial(
    Recording,
    name="memory",
    location="nowhere",
    intrinsics=Intrinsics(width=WIDTH, height=HEIGHT, fx=20.0, fy=20.0, cx=7.5, cy=5.5),
    rotation_axis=RotationAxis(point_m=np.array([0.0, 0.0, 0.85]), direction=np.array([0.0, -1.0, 0.0])),
    angles_deg=tuple(10.0 * i for i in range(6)),
    read=lambda _: ViewImages(
        color=np.zeros((HEIGHT, WIDTH, 3), dtype=np.uint8),
        depth_m=np.full((HEIGHT, WIDTH), 0.85, dtype=np.float32),
    ),
)
"""A recording that exists in memory only; its frames are blank."""


def few_views(name: str, step: int, folder: Path) -> Path:
    """Write every so many views of a bundled recording, with their truth, to a folder; return it."""
    shutil.copytree(sample_recordings()[name], folder)
    header = json.loads((folder / "recording.json").read_text())
    header["views"] = header["views"][::step]
    (folder / "recording.json").write_text(json.dumps(header))
    return folder
