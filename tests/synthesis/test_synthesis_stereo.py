"""Depth that is matched between two rendered infrared images, and items that twist."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from garment_meshes import RADIUS_M, arc, write_obj

from flatcloth.cli import main
from flatcloth.recordings import open_recording
from flatcloth.recordings.truth import Truth
from flatcloth.synthesis.sensor import match


def speckled(shape: tuple[int, int], seed: int = 0) -> np.ndarray:
    noise = np.random.default_rng(seed).random(shape).astype(np.float32)
    blurred = cv2.GaussianBlur(noise, (0, 0), 1.2)
    return np.clip(128 + (blurred - 0.5) * 900, 0, 255).astype(np.uint8)


def moved_up(image: np.ndarray, by_px: float) -> np.ndarray:
    shift = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, -by_px]])
    return cv2.warpAffine(image, shift, image.shape[::-1], borderMode=cv2.BORDER_CONSTANT)


@pytest.mark.parametrize("by_px", [20.0, 20.25, 20.5, 20.75])
def test_a_shift_is_found_to_a_fraction_of_a_pixel(by_px: float) -> None:
    first = speckled((160, 120))
    found = match(first, moved_up(first, by_px), 15, 26)
    inside = found[40:-10, 10:-10]
    assert (inside > 0).mean() > 0.95
    assert abs(np.median(inside[inside > 0]) - by_px) < 0.1


def test_a_stereo_recording_is_that_of_the_mesh_with_the_errors_of_matching(tmp_path: Path) -> None:
    vertices, triangles, flat = arc(160.0)
    mesh = write_obj(tmp_path / "sheet.obj", vertices, triangles, flat)
    usual = [
        str(mesh),
        "--step",
        "90",
        "--held",
        str(RADIUS_M),
        "0",
        "0",
        "--size",
        "240",
        "320",
        "--focal",
        "425",
    ]
    for name, more in (
        ("clean", []),
        ("stereo", ["--sensor", "stereo"]),
        ("swaying", ["--sensor", "stereo", "--sway", "3", "--twist", "0.7", "--exposure", "8"]),
    ):
        assert main(["synthesize", *usual, *more, "--out", str(tmp_path / name)]) == 0
    clean, stereo, swaying = (open_recording(tmp_path / name) for name in ("clean", "stereo", "swaying"))
    measured, true = stereo[0].depth_m, clean[0].depth_m
    both = (measured > 0) & (true > 0)
    assert both.sum() > 0.9 * (true > 0).sum()
    assert 0.2e-3 < np.median(np.abs(measured - true)[both]) < 6e-3  # a D435's: 2.7 mm at 0.08 px
    # Errors of matching are correlated over its windows; independent ones would not be.
    error = np.where(
        both & cv2.erode(both.astype(np.uint8), np.ones((15, 15))).astype(bool), measured - true, np.nan
    )
    neighbours = np.isfinite(error[:, 1:]) & np.isfinite(error[:, :-1])
    assert np.corrcoef(error[:, 1:][neighbours], error[:, :-1][neighbours])[0, 1] > 0.5
    assert np.array_equal(
        Truth(stereo.location)[0].flat_uv_m, Truth(clean.location)[0].flat_uv_m, equal_nan=True
    )
    mask = stereo[0].mask
    assert mask is not None
    assert (measured[mask] > 0).all()
    assert stereo[0].color[measured == 0].mean() < 10  # nothing is aligned there, but for the noise of JPEG
    assert "it sways" in swaying.description
    assert "waver" in swaying.description
    brightness = [swaying[n].color[swaying[n].depth_m > 0].mean() for n in (0, 2)]
    steady = [stereo[n].color[stereo[n].depth_m > 0].mean() for n in (0, 2)]
    assert abs(brightness[0] / steady[0] - brightness[1] / steady[1]) > 0.005
