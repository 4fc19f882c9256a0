"""Simulation of a stereo depth camera such as the D435 on a true depth image.

The errors are simulated in disparity, where they arise: block matching widens near surfaces (edge
fattening), joins layers across depth edges by ramps, correlates the noise of neighbouring pixels, and
fails where its window contains two depths.

The stereo camera is rendered instead: two infrared images under dots of a projector, matched. It stands
upright: the other imager is below the depth image's own, the color camera above it. Depth is matched by
normalised cross-correlation, so that errors arise as they do in a sensor. A D435 matches census codes in
hardware; of its filters only the left-right check and the removal of specks are here.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from scipy import ndimage

from flatcloth.core.geometry import window_of
from flatcloth.core.types import Bool, Float32, Float64, Intrinsics, Uint8
from flatcloth.synthesis.rendering import Projector, Scene

_MARGIN_PX = 12
"""Around the item, for effects beyond it. Chosen."""

BASELINE_M, UNIT_M = 0.050, 0.001
"""Distance of the imagers and unit of depth of a D435. What follows is its noise at 480x848 px with a focal
length of 425 px, measured on one of its frames (docs/synthesis.md): ..."""
_NOISE_PX, _GRAIN_SHARE, _CORRELATION_PX = 0.057, 0.06, 1.65
"""... the deviation of disparity, the share of its variance that is uncorrelated, and the sigma of the
Gaussian that correlates the rest; ..."""
_JITTER_PX, _FATTEN_PX, _OUTLINE_PX = 0.60, 1.2, (0.95, 1.0)
"""... the deviation of the matched position, the width by which near surfaces extend over far ones, mean and
deviation of the outward shift of the outline; ..."""
_RAMP_PX, _JOIN_M = 2.0, 0.06
"""... the sigma of the smoothing across edges, and the largest depth step that is smoothed; ..."""
_UNSURE_M, _HOLE_SHARE = 0.065, 0.003
"""... the least depth step next to which pixels may be lost, and the share of pixels lost at random."""


def measure_depth(depth_m: Float32, focal_px: float, random: np.random.Generator) -> Float32:
    """Simulate the sensor's depth image.

    Parameters
    ----------
    depth_m : (H, W) float32
        True depth along the optical axis, 0 where there is nothing.
    focal_px : float
        Focal length.
    random : Generator
        Source of the noise.

    Returns
    -------
    (H, W) float32
        Metres, 0 where nothing was measured; not yet rounded to depth units.
    """
    scale = focal_px * BASELINE_M
    measured = np.zeros_like(depth_m)
    window = window_of(depth_m > 0, _MARGIN_PX)
    if window is None:
        return measured
    inside = depth_m[window]
    true = np.where(inside > 0, scale / np.where(inside > 0, inside, 1), 0).astype(np.float32)
    moved = _jittered(true, random)
    wide = _fattened(moved, scale, random)
    ramped = _ramped(wide, scale)
    noise = _noise(true.shape, random)
    lost = _lost(wide, scale, random)
    seen = (ramped > 0) & ~lost
    disparity = np.where(seen, np.maximum(ramped + noise, 1e-3), 1)
    measured[window] = np.where(seen, scale / disparity, 0)
    return measured


def measure_color(rgb: Uint8, random: np.random.Generator, noise_levels: float = 2.0) -> Uint8:
    """Return the color image (H, W, 3), slightly defocused, with noise of a few grey levels."""
    blurred = cv2.GaussianBlur(rgb, (0, 0), 0.5).astype(np.float32)
    noisy = blurred + random.normal(0, noise_levels, rgb.shape).astype(np.float32)
    seen: Uint8 = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
    return seen


def _smooth_field(shape: tuple[int, ...], random: np.random.Generator, sigma_px: float) -> Float32:
    """Return Gaussian noise of unit standard deviation, correlated over a few pixels."""
    white = random.normal(size=shape).astype(np.float32)
    blurred = cv2.GaussianBlur(white, (0, 0), sigma_px, borderType=cv2.BORDER_REFLECT_101)
    field: Float32 = (blurred / max(float(blurred.std()), 1e-9)).astype(np.float32)
    return field


def _jittered(disparity: Float32, random: np.random.Generator) -> Float32:
    rows, cols = np.indices(disparity.shape, dtype=np.float32)
    wander = [_JITTER_PX * _smooth_field(disparity.shape, random, 2.0) for _ in range(2)]
    # Linear within a surface, nearest across an edge: jitter moves an edge without blurring it.
    at = cols + wander[0], rows + wander[1]
    nearest = cv2.remap(disparity, *at, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
    linear = cv2.remap(disparity, *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    moved: Float32 = np.where(np.abs(linear - nearest) < 0.25, linear, nearest)
    return moved


def _fattened(disparity: Float32, scale: float, random: np.random.Generator) -> Float32:
    # A matching window follows the nearest surface in it: slopes appear nearer by about a pixel ...
    wide = cv2.dilate(disparity, np.ones((3, 3), np.uint8)).astype(np.float32)
    # ... and a near layer extends over a far one, by a varying width (edge fattening).
    depth = scale / np.maximum(disparity, 1e-6)
    width = _FATTEN_PX + 0.6 * _smooth_field(disparity.shape, random, 2.0)
    for half_px in (1, 2, 3):
        size = 2 * half_px + 1
        near = cv2.dilate(disparity, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size)))
        over = (depth - scale / np.maximum(near, 1e-6) > 0.012) & (width > half_px - 0.5)
        wide = np.where(over, np.maximum(wide, near), wide).astype(np.float32)
    # The measured outline varies about the true one, and is wider by about a pixel.
    seen = disparity > 0
    outside = ndimage.distance_transform_edt(~seen) - ndimage.distance_transform_edt(seen)
    outline = _OUTLINE_PX[0] + _OUTLINE_PX[1] * _smooth_field(disparity.shape, random, 1.4)
    beyond = outside - 0.5 * np.sign(outside) > outline
    near = cv2.dilate(disparity, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (9, 9)))
    widened: Float32 = np.where(beyond, 0, np.where(seen, wide, near)).astype(np.float32)
    return widened


def _ramped(disparity: Float32, scale: float) -> Float32:
    """Smooth across depth steps up to ``_JOIN_M``, but not across larger ones or the outline."""
    radius = int(np.ceil(2.5 * _RAMP_PX))
    depth = np.where(disparity > 0, scale / np.maximum(disparity, 1e-6), 0).astype(np.float32)
    total, weight = np.zeros_like(disparity), np.zeros_like(disparity)
    padded_d = np.pad(disparity, radius)
    padded_z = np.pad(depth, radius)
    rows, cols = disparity.shape
    for i in range(-radius, radius + 1):
        for j in range(-radius, radius + 1):
            w = float(np.exp(-(i * i + j * j) / (2 * _RAMP_PX**2)))
            if w < 0.04:
                continue
            part = np.s_[radius + i : radius + i + rows, radius + j : radius + j + cols]
            other, z = padded_d[part], padded_z[part]
            joined = np.where(other > 0, w * np.exp(-0.5 * ((z - depth) / _JOIN_M) ** 2), 0)
            total += joined * other
            weight += joined
    smooth: Float32 = np.where(disparity > 0, total / np.maximum(weight, 1e-6), 0).astype(np.float32)
    return smooth


def _noise(shape: tuple[int, ...], random: np.random.Generator) -> Float64:
    smooth = _smooth_field(shape, random, _CORRELATION_PX)
    grain = random.normal(size=shape)
    noise: Float64 = _NOISE_PX * (np.sqrt(1 - _GRAIN_SHARE) * smooth + np.sqrt(_GRAIN_SHARE) * grain)
    return noise


def _lost(disparity: Float32, scale: float, random: np.random.Generator) -> Bool:
    """Pixels without depth: between distant layers, along the outline, and a few at random."""
    depth = np.where(disparity > 0, scale / np.maximum(disparity, 1e-6), 0).astype(np.float32)
    # Only one of the two cameras sees a far pixel next to a near layer.
    far = cv2.dilate(depth, np.ones((3, 3), np.uint8))
    near = cv2.erode(np.where(depth > 0, depth, 99).astype(np.float32), np.ones((5, 5), np.uint8))
    step = np.where(depth > 0, np.maximum(depth - near, 0.75 * (far - depth)), 0)
    doubt = np.clip((step - _UNSURE_M) / _UNSURE_M, 0, 1.5)
    field = _smooth_field(disparity.shape, random, 1.5)
    lost: Bool = (doubt > 0) & (ndimage.gaussian_filter(doubt, 0.5) * 1.6 + 0.7 * field > 1.0)
    holes = _smooth_field(disparity.shape, random, 2.8)
    # The outermost pixel of the outline is measured only sometimes.
    rim = (disparity > 0) & (cv2.erode((disparity > 0).astype(np.uint8), np.ones((3, 3), np.uint8)) == 0)
    lost |= rim & (_smooth_field(disparity.shape, random, 1.2) > 1.2)
    lost |= holes > np.quantile(holes, 1 - _HOLE_SHARE)
    return lost


# --- stereo ---------------------------------------------------------------------------------------

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


def exposed(rgb: Uint8, share: float, random: np.random.Generator) -> Uint8:
    """Return the image (H, W, 3) of one view with its gains: their deviation, a quarter of it by channel."""
    gains = 1.0 + random.normal(0, share) + random.normal(0, share / 4, 3)
    changed: Uint8 = np.clip(np.rint(rgb * np.maximum(gains, 0.0)), 0, 255).astype(np.uint8)
    return changed


def projector(seed: int) -> Projector:
    """Return a projector of random dots, half-way between the imagers."""
    random = np.random.default_rng([seed, 3])
    pattern = np.zeros((_PATTERN_PX, _PATTERN_PX), dtype=np.float32)
    sigma_px = _DOT_TAN * _PATTERN_PX / (2 * _FIELD_TAN)
    count = int(_DOTS_PER_TAN2 * (2 * _FIELD_TAN) ** 2)
    rows, cols = random.integers(0, _PATTERN_PX, (2, count))
    np.add.at(pattern, (rows, cols), 2 * np.pi * sigma_px**2)
    return Projector(
        at_m=np.array([0.0, BASELINE_M / 2, 0.0]),
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
    """
    offset_m = np.array([0.0, -BASELINE_M, 0.0])
    own = scene.infrared(camera, points_m, normals, dots)
    lower = scene.infrared(camera, points_m + offset_m, normals, replace(dots, at_m=dots.at_m + offset_m))
    gain = _EXPOSED / float(own[own > 0].mean()) if own.any() else 1.0
    first, second = (_exposed(image * gain, random) for image in (own, lower))
    scale = camera.fy * BASELINE_M
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
