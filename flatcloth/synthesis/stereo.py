"""A stereo depth camera such as the D435, rendered: two infrared images under dots of a projector, matched.

The camera stands upright: the other imager is below the depth image's own, the color camera above it. Depth
is matched by normalised cross-correlation, so that errors arise as they do in a sensor: near surfaces grow,
layers are joined, and what only one imager sees is lost. A D435 matches census codes in hardware; of its
filters only the left-right check and the removal of specks are here.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from flatcloth.core.types import Float32, Float64, Intrinsics, Uint8
from flatcloth.synthesis.rendering import Projector, Scene
from flatcloth.synthesis.sensor import DepthSensor

COLOR_ABOVE_M = 0.015
"""Distance of the color camera from the depth image's imager (datasheet of the D400 series)."""
_DOTS_PER_TAN2 = 5000 / 2.45
"""Dots of the projector per unit of solid angle, measured in tangents: some 5000 (Grunnet-Jepsen et al.,
Projectors for D400 series depth cameras) in a field of 90 by 63 degrees, which has 2.45."""
_DOT_TAN = 0.0012
"""Sigma of a dot, in tangents. Chosen: half a pixel of the camera."""
_FIELD_TAN, _PATTERN_PX = 1.1, 2048
"""Half the width of the pattern's image, which covers the field of view, and its pixels."""
_FULL_WELL, _READ_NOISE = 7000.0, 5.0
"""Electrons of a saturated pixel, and sigma of the noise without light. Chosen, as of small sensors with
a global shutter."""
_EXPOSED = 0.3
"""Share of the full range that the item has in the mean. Chosen: an automatic exposure aims there."""
_WINDOW_PX = 9
"""Size of the compared windows. Chosen."""
_LEAST_CORRELATION = 0.5
"""Chosen: above what the best of forty windows of pure noise has, 0.35."""
_SPECK_PX = 50
"""Largest area of a speck that is removed. Chosen."""


@dataclass(frozen=True, kw_only=True)
class Exposure:
    """Gains of the color image: ``share`` is the standard deviation, a quarter of it between channels."""

    share: float = 0.0

    def apply(self, rgb: Uint8, random: np.random.Generator) -> Uint8:
        """Return the image (H, W, 3) with the gains of one view."""
        gains = 1.0 + random.normal(0, self.share) + random.normal(0, self.share / 4, 3)
        changed: Uint8 = np.clip(np.rint(rgb * np.maximum(gains, 0.0)), 0, 255).astype(np.uint8)
        return changed


def projector(baseline_m: float, seed: int) -> Projector:
    """Return a projector of random dots, half-way between the imagers."""
    random = np.random.default_rng([seed, 3])
    pattern = np.zeros((_PATTERN_PX, _PATTERN_PX), dtype=np.float32)
    sigma_px = _DOT_TAN * _PATTERN_PX / (2 * _FIELD_TAN)
    count = int(_DOTS_PER_TAN2 * (2 * _FIELD_TAN) ** 2)
    rows, cols = random.integers(0, _PATTERN_PX, (2, count))
    np.add.at(pattern, (rows, cols), 2 * np.pi * sigma_px**2)
    return Projector(
        at_m=np.array([0.0, baseline_m / 2, 0.0]),
        pattern=np.asarray(cv2.GaussianBlur(pattern, (0, 0), sigma_px), dtype=np.float32),
        half_tan=_FIELD_TAN,
    )


def measure_stereo(
    scene: Scene,
    camera: Intrinsics,
    points_m: Float64,
    normals: Float64,
    dots: Projector,
    range_m: tuple[float, float],
    random: np.random.Generator,
    sensor: DepthSensor,
) -> Float32:
    """Return the depth image (H, W) in metres that is matched between two infrared images; 0: none.

    Parameters
    ----------
    scene, camera, points_m, normals
        As of :meth:`Scene.view`.
    dots : Projector
        As of :func:`projector`.
    range_m : (near, far)
        Depths that are looked for.
    random : Generator
        Source of the noise.
    sensor : DepthSensor
        Its baseline.
    """
    offset_m = np.array([0.0, -sensor.baseline_m, 0.0])
    own = scene.infrared(camera, points_m, normals, dots)
    lower = scene.infrared(camera, points_m + offset_m, normals, replace(dots, at_m=dots.at_m + offset_m))
    gain = _EXPOSED / float(own[own > 0].mean()) if own.any() else 1.0
    first, second = (_exposed(image * gain, random) for image in (own, lower))
    scale = camera.fy * sensor.baseline_m
    least, most = int(scale / range_m[1]) - 1, int(np.ceil(scale / range_m[0])) + 1
    disparity = match(first, second, max(least, 1), most)
    seen = disparity > 0
    return np.where(seen, scale / np.where(seen, disparity, 1), 0).astype(np.float32)


def match(first: Uint8, second: Uint8, least_px: int, most_px: int) -> Float32:
    """Match two images whose epipolar lines are the columns, by normalised cross-correlation.

    Parameters
    ----------
    first, second : (H, W) uint8
        A point at row r of ``first`` is at row r - disparity of ``second``.
    least_px, most_px : int
        Disparities that are tried.

    Returns
    -------
    (H, W) float32
        Disparity in pixels of ``first``, by a parabola to a fraction; 0 where nothing agrees, where the best
        match of ``second`` is another one, and in specks.
    """
    one, two = (image.astype(np.float32) for image in (first, second))
    (mean_1, std_1), (mean_2, std_2) = _moments(one), _moments(two)
    tried = range(least_px - 1, most_px + 2)  # one more on both sides, for the parabola
    score = np.full((len(tried), *one.shape), -1.0, dtype=np.float32)
    for n, d in enumerate(tried):
        joint = cv2.boxFilter(one[d:] * two[: len(two) - d], -1, (_WINDOW_PX, _WINDOW_PX))
        score[n, d:] = (joint - mean_1[d:] * mean_2[: len(two) - d]) / (std_1[d:] * std_2[: len(two) - d])
    best = score[1:-1].argmax(axis=0) + 1
    left, middle, right = (np.take_along_axis(score, best[None] + step, axis=0)[0] for step in (-1, 0, 1))
    bend = left - 2 * middle + right
    peak = (bend < 0) & (middle >= _LEAST_CORRELATION)
    part = np.where(peak, 0.5 * (left - right) / np.where(peak, bend, -1), 0)
    back = np.full(score.shape, -1.0, dtype=np.float32)
    for n, d in enumerate(tried):
        back[n, : len(two) - d] = score[n, d:]
    theirs = back[1:-1].argmax(axis=0) + 1
    rows = np.maximum(np.arange(len(one))[:, None] - (best + tried[0]), 0)
    agrees = np.abs(np.take_along_axis(theirs, rows, axis=0) - best) <= 1
    disparity = np.where(peak & agrees, best + tried[0] + np.clip(part, -0.5, 0.5), 0)
    specks = np.rint(disparity * 16).astype(np.int16)
    cv2.filterSpeckles(specks, 0, _SPECK_PX, 16)
    return np.where(specks > 0, disparity, 0).astype(np.float32)


def aligned_color(rgb_above: Uint8, depth_m: Float32, camera: Intrinsics) -> Uint8:
    """Return the image of the color camera (H, W, 3) at the pixels of the depth image, as librealsense does.

    Where there is no depth it is black; next to an outline it shows what the color camera sees there.
    """
    rows, cols = np.mgrid[0 : camera.height, 0 : camera.width].astype(np.float32)
    seen = depth_m > 0
    shift = camera.fy * COLOR_ABOVE_M / np.where(seen, depth_m, 1)
    moved = cv2.remap(rgb_above, cols, (rows + shift).astype(np.float32), cv2.INTER_NEAREST)
    aligned: Uint8 = np.where(seen[..., None], moved, 0).astype(np.uint8)
    return aligned


def _moments(image: Float32) -> tuple[Float32, Float32]:
    mean, square = (
        np.asarray(cv2.boxFilter(one, -1, (_WINDOW_PX, _WINDOW_PX)), dtype=np.float32)
        for one in (image, image * image)
    )
    return mean, np.sqrt(np.maximum(square - mean * mean, np.float32(1.0)))


def _exposed(light: Float32, random: np.random.Generator) -> Uint8:
    """Return the 8-bit image of a sensor, with the noise of photons and of reading."""
    electrons = np.clip(light, 0, 1) * _FULL_WELL
    noisy = electrons + random.normal(size=light.shape) * np.sqrt(electrons + _READ_NOISE**2)
    image: Uint8 = np.clip(np.rint(noisy * (255 / _FULL_WELL)), 0, 255).astype(np.uint8)
    return image
