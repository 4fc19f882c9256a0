"""Depth that is matched between two rendered infrared images, and items that twist."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from garment_meshes import HEIGHT_M, RADIUS_M, arc, write_obj

from flatcloth.cli import main
from flatcloth.recordings import open_recording
from flatcloth.recordings.truth import Truth
from flatcloth.synthesis.hanging import hang, turn, twisted
from flatcloth.synthesis.recording import camera_of
from flatcloth.synthesis.request import Request
from flatcloth.synthesis.sensor import COLOR_ABOVE_M, aligned_color, exposed, match


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


def test_what_only_one_imager_sees_and_what_has_no_texture_is_lost() -> None:
    first = speckled((160, 120))
    second = moved_up(first, 20.0)
    second[60:100, :60] = speckled((40, 60), seed=1)
    first[:, 90:], second[:, 90:] = 128, 128
    found = match(first, second, 15, 26)
    assert (found[90:110, 10:50] > 0).mean() < 0.1  # by chance
    assert not found[:, 100:].any()
    assert (found[90:110, 65:80] > 0).all()


def test_a_stereo_recording_is_that_of_the_mesh_with_the_errors_of_matching(tmp_path: Path) -> None:
    vertices, triangles, flat = arc(160.0)
    mesh = write_obj(tmp_path / "sheet.obj", vertices, triangles, flat)
    usual = f"{mesh} --step 90 --held {RADIUS_M} 0 0 --size 240 320 --focal 425".split()
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


def test_color_is_taken_from_where_the_camera_above_sees_the_cloth() -> None:
    camera = camera_of((64, 128), 180.0)
    depth = np.full((camera.height, camera.width), 0.85, dtype=np.float32)
    depth[:, :5] = 0
    rows = np.repeat(np.arange(camera.height, dtype=np.uint8)[:, None], camera.width, axis=1)
    seen = aligned_color(np.dstack([rows] * 3), depth, camera)
    assert not seen[:, :5].any()
    shift = round(camera.fy * COLOR_ABOVE_M / 0.85)
    assert (seen[50, 5:] == 50 + shift).all()


def test_a_twist_grows_downwards_and_leaves_heights_and_the_held_point() -> None:
    asked = Request(mesh=Path(), out=Path(), held=(RADIUS_M, 0.0, 0.0), step_deg=90.0, twist_deg=2.0)
    hung = hang(arc()[0], asked)
    moved = twisted(hung, 10.0) - hung.held_point_m
    still = hung.points_m - hung.held_point_m
    assert np.allclose(moved[:, 1], still[:, 1])
    assert np.allclose(np.hypot(moved[:, 0], moved[:, 2]), np.hypot(still[:, 0], still[:, 2]))
    off = np.hypot(still[:, 0], still[:, 2]) > 0.01
    turned = np.degrees(np.arctan2(moved[:, 0], moved[:, 2]) - np.arctan2(still[:, 0], still[:, 2]))[off]
    turned = np.mod(turned + 180, 360) - 180
    assert np.allclose(turned, 10.0 * still[off, 1] / HEIGHT_M, atol=1e-6)
    turning = turn(hung, asked, np.random.default_rng(0))
    assert turning.twist_deg[0] == 0.0
    assert min(np.abs(turning.twist_deg[1:])) > 0


def test_exposure_wavers_by_its_share_and_colors_by_a_quarter_of_it() -> None:
    random = np.random.default_rng(0)
    grey = np.full((1, 1, 3), 100, dtype=np.uint8)
    seen = np.array([exposed(grey, 0.08, random)[0, 0] for _ in range(2000)]) / 100
    assert seen.mean(axis=1).std() == pytest.approx(0.08, rel=0.1)
    assert (seen[:, 0] - seen[:, 1]).std() == pytest.approx(0.02 * np.sqrt(2), rel=0.1)
    assert (exposed(grey, 0.0, random) == 100).all()
