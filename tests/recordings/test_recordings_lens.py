"""Lens distortion is undone, in OpenCV's meaning of the coefficients."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from tiny_recordings import write_header, write_image

from flatcloth.core.errors import RecordingError
from flatcloth.core.types import Intrinsics
from flatcloth.recordings import open_recording
from flatcloth.recordings.files.camera import Lens

WIDTH, HEIGHT = 160, 120
CAMERA = {"width": WIDTH, "height": HEIGHT, "fx": 150.0, "fy": 150.0, "cx": 79.5, "cy": 59.5}
COEFFICIENTS = [-0.2, 0.05, 0.002, -0.001, 0.01]


def write(folder: Path, model: str, coefficients: list[float]) -> Path:
    """Write one view: a bright square whose corners lie where the lens puts a known 3D square."""
    corners = np.array([[-0.3, -0.2, 1.0], [0.3, -0.2, 1.0], [0.3, 0.2, 1.0], [-0.3, 0.2, 1.0]])
    matrix = np.array([[CAMERA["fx"], 0, CAMERA["cx"]], [0, CAMERA["fy"], CAMERA["cy"]], [0, 0, 1]])
    seen, _ = cv2.projectPoints(corners, np.zeros(3), np.zeros(3), matrix, np.array(coefficients))
    color = np.zeros((HEIGHT, WIDTH, 3), dtype=np.uint8)
    depth = np.full((HEIGHT, WIDTH), 1000, dtype=np.uint16)
    mask = np.zeros((HEIGHT, WIDTH), dtype=np.uint8)
    for col, row in np.rint(seen[:, 0]).astype(int):
        color[row - 1 : row + 2, col - 1 : col + 2] = 255
        depth[row - 1 : row + 2, col - 1 : col + 2] = 2000
        mask[row - 1 : row + 2, col - 1 : col + 2] = 255
    for kind, pixels in (("color", color), ("depth", depth), ("mask", mask)):
        write_image(folder / f"{kind}.png", pixels)
    view = {"angle_deg": 0, "color": "color.png", "depth": "depth.png", "mask": "mask.png"}
    intrinsics = {**CAMERA, "distortion_model": model, "distortion": coefficients}
    write_header(
        folder,
        {
            "format": "flatcloth-recording/1",
            "intrinsics": intrinsics,
            "depth_scale_m": 0.001,
            "views": [view],
        },
    )
    return folder


@pytest.mark.parametrize("coefficients", [COEFFICIENTS, COEFFICIENTS[:4], [0.0] * 5])
def test_a_known_square_lands_where_a_pinhole_camera_sees_it(
    tmp_path: Path, coefficients: list[float]
) -> None:
    frame = open_recording(write(tmp_path, "brown_conrady", coefficients))[0]
    assert frame.mask is not None
    for x, y in ((-0.3, -0.2), (0.3, -0.2), (0.3, 0.2), (-0.3, 0.2)):
        row, col = round(150 * y + 59.5), round(150 * x + 79.5)
        assert frame.mask[row, col]
        assert frame.depth_m[row, col] == np.float32(2.0)
        assert frame.color[row, col, 0] > 200


def test_depth_is_never_a_mixture_and_zero_where_nothing_was_seen(tmp_path: Path) -> None:
    # A barrel lens bent outwards: the pinhole image's corners were never measured.
    frame = open_recording(write(tmp_path, "brown_conrady", [0.3, 0.0, 0.0, 0.0, 0.0]))[0]
    assert set(np.unique(frame.depth_m).tolist()) == {0.0, 1.0, 2.0}
    assert frame.depth_m[0, 0] == 0
    assert not frame.mask[0, 0]  # type: ignore[index]


def test_coefficients_that_fold_the_image_are_refused(tmp_path: Path) -> None:
    folder = write(tmp_path, "brown_conrady", COEFFICIENTS)
    write(folder, "brown_conrady", [-0.1, 0, 0, 0, 0])
    text = (folder / "recording.json").read_text().replace("-0.1", "-5.0")
    (folder / "recording.json").write_text(text)
    with pytest.raises(RecordingError, match="folds the image over itself"):
        open_recording(folder)


def test_five_coefficients_at_most(tmp_path: Path) -> None:
    folder = write(tmp_path, "brown_conrady", COEFFICIENTS)
    text = (folder / "recording.json").read_text().replace("[-0.2", "[0.1, -0.2")
    (folder / "recording.json").write_text(text)
    with pytest.raises(RecordingError, match="distortion has 6 numbers"):
        open_recording(folder)


def test_without_distortion_an_image_is_returned_as_it_is() -> None:
    lens = Lens(Intrinsics(**CAMERA), (0.0,) * 5)  # type: ignore[arg-type]
    image = np.zeros((HEIGHT, WIDTH), dtype=np.uint16)
    assert lens.undistort(image, blend=False) is image
