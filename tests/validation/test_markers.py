"""Markers found on bent cloth and in photos, against closed forms."""

import functools
from typing import Any

import cv2
import msgspec
import numpy as np
import pytest

from flatcloth.cli import main
from flatcloth.validation.kit import (
    SQUARE,
    Kit,
    KitError,
    grid_kit,
    marker_at,
    printed_cloth,
    read_kit,
    write_kit,
)
from flatcloth.validation.markers import KitTruth, found_markers, measured_kit

FOCAL_PX, SIZE_PX, DISTANCE_M, RADIUS_M = 600.0, 480, 0.85, 0.15
STICKERS = grid_kit((0.21, 0.27), 0.03, 1, stickers=12)


def painted(rgb: np.ndarray, shape: tuple[int, int], seed: int) -> np.ndarray:
    """Average 3 x 3 rays a pixel, and add the noise of a camera."""
    fine = rgb.reshape(3 * shape[0], 3 * shape[1], 3) * 255
    noise = np.random.default_rng(seed).normal(0, 3, (*shape, 1))
    return (cv2.resize(fine, shape[::-1], interpolation=cv2.INTER_AREA) + noise).clip(0, 255).astype(np.uint8)


def on_cylinder(kit: Kit, seed: int = 0) -> np.ndarray:
    """Paint sheet 1 around an upright cylinder, in the frame of a camera that looks at its middle."""
    uv, is_seen = cylinder()
    rgb = printed_cloth(kit)(uv.reshape(-1, 2), 1)
    rgb[~is_seen.ravel()] = 0.15
    return painted(rgb, (SIZE_PX, SIZE_PX), seed)


def cylinder() -> tuple[np.ndarray, np.ndarray]:
    """Places (H, W, 2) of the cloth on it, three rays a pixel, and whether it is there."""
    x, y = np.meshgrid(*[((np.arange(3 * SIZE_PX) + 0.5) / 3 - SIZE_PX / 2) / FOCAL_PX] * 2)
    middle = DISTANCE_M + RADIUS_M  # |(x z, z - middle)| = radius
    root = middle**2 - (1 + x**2) * (middle**2 - RADIUS_M**2)
    z = (middle - np.sqrt(np.maximum(root, 0))) / (1 + x**2)
    return np.stack([RADIUS_M * np.arctan2(x * z, middle - z), y * z], axis=-1), root >= 0


def on_image(kit: Kit, i: int) -> tuple[np.ndarray, float]:
    """Corners (4, 2) of a marker in that image, and its greatest angle to the rays in degrees."""
    u, v = (kit.corners_m[i] - np.array(kit.size_mm) / 2e3).T
    x, z = RADIUS_M * np.sin(u / RADIUS_M), DISTANCE_M + RADIUS_M * (1 - np.cos(u / RADIUS_M))
    angle = np.degrees(np.abs(u / RADIUS_M + np.arctan2(x, z))).max()
    return np.stack([x / z, v / z], axis=1) * FOCAL_PX + (SIZE_PX - 1) / 2, float(angle)


def test_bent_markers_are_read_without_a_wrong_one_and_to_a_fifth_of_a_pixel():
    kit = grid_kit((0.48, 0.48), 0.03, 1)
    found = found_markers(on_cylinder(kit), kit)
    truth = {i: on_image(kit, i) for i in kit.corners_m}
    off = {i: np.linalg.norm(corners - truth[i][0], axis=1) for i, corners in found.items()}
    assert np.max(list(off.values())) < 5.0, "a wrong id would be off by a cell, 20 px"
    facing = {i for i, (px, angle) in truth.items() if angle < 55 and (np.abs(px - SIZE_PX / 2) < 230).all()}
    assert len(facing & off.keys()) > 0.95 * len(facing) > 90
    assert np.median([off[i] for i in facing & off.keys()]) < 0.15
    assert np.sqrt(np.mean(np.square([off[i] for i in facing & off.keys()]))) < 0.3


def test_markers_give_the_place_of_the_pixels_between_them():
    kit = grid_kit((0.48, 0.48), 0.03, 1)
    facing = {i: px for i, (px, angle) in ((i, on_image(kit, i)) for i in kit.corners_m) if angle < 55}
    pixels = np.stack(np.meshgrid(*[np.arange(float(SIZE_PX))] * 2), axis=-1).reshape(-1, 2)
    found = KitTruth(kit, lambda _: facing).places(0, pixels)
    off_mm = 1e3 * np.linalg.norm(found - cylinder()[0][1::3, 1::3].reshape(-1, 2) - 0.24, axis=1)
    known = np.isfinite(found[:, 0])
    assert known.sum() > 39_000
    assert np.median(off_mm[known]) < 0.3
    assert off_mm[known].max() < 1.5


def test_nothing_is_found_of_another_kit_or_of_mirrored_cloth():
    kit = grid_kit((0.48, 0.48), 0.03, 1)
    image = on_cylinder(kit)
    other = replace(kit, {i + 300: c for i, c in kit.corners_m.items()}, dict.fromkeys(range(300, 525), 1))
    assert not found_markers(image, other) | found_markers(image[:, ::-1].copy(), kit)


def replace(kit: Kit, corners_m: dict[int, np.ndarray], sheet: dict[int, int], **changed: Any) -> Kit:
    """Return a kit with other places."""
    markers = [marker_at(i, sheet[i], corners) for i, corners in corners_m.items()]
    return msgspec.structs.replace(kit, markers=markers, **changed)


@functools.cache
def scattered() -> Kit:
    """Stickers that lie about on a garment."""
    random, kit = np.random.default_rng(0), STICKERS
    turns = random.uniform(0, 2 * np.pi, len(kit.corners_m))
    places = [
        np.array([0.08 + 0.11 * (n % 4), 0.08 + 0.13 * (n // 4)]) + random.uniform(-0.03, 0.03, 2)
        for n in range(12)
    ]
    corners = {
        i: 0.012 * SQUARE @ np.array([(np.cos(t), np.sin(t)), (-np.sin(t), np.cos(t))]) + place
        for i, t, place in zip(kit.corners_m, turns, places, strict=True)
    }
    return replace(kit, corners, kit.sheet, size_mm=(500.0, 450.0), is_measured=True)


@functools.cache
def photographed() -> np.ndarray:
    """Paint a photo of them, taken obliquely, 1600 px/m."""
    kit = scattered()
    image_from_sheet = np.array([[1600.0, 60.0, 60.0], [-40.0, 1500.0, 90.0], [0.12, -0.08, 1.0]])
    y, x = np.mgrid[: 3 * 760, : 3 * 900] / 3.0 - 1 / 3
    at = np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3)
    plane = at @ np.linalg.inv(image_from_sheet).T
    return painted(
        printed_cloth(kit)(plane[:, :2] / plane[:, 2:] - np.array(kit.size_mm) / 2e3, 1), (760, 900), 1
    )


def test_stickers_are_measured_from_a_photo(tmp_path, capsys):
    truth = scattered()
    cv2.imwrite(str(tmp_path / "flat.png"), photographed()[..., ::-1])
    write_kit(STICKERS, tmp_path / "kit.json")
    assert main(["kit", "--out", str(tmp_path), "--from-photo", str(tmp_path / "flat.png")]) == 0
    kit = read_kit(tmp_path / "kit.json")
    assert kit.is_measured
    assert kit.sheet == dict.fromkeys(range(12), 1)
    known, got = (np.concatenate([c[i] for i in range(12)]) for c in (truth.corners_m, kit.corners_m))
    apart = [np.linalg.norm(x[:, None] - x[None], axis=2) for x in (known, got)]
    assert np.abs(apart[0] - apart[1]).max() < 0.0005
    assert (got > 0).all()


def test_a_photo_of_too_few_stickers_is_refused():
    with pytest.raises(KitError, match=r"^3 stickers are read"):
        measured_kit(STICKERS, photographed()[:, :280])  # the left column
