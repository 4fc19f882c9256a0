"""Does color lie on depth? Shift and scale between them, by the outlines of the item in both.

Each pixel's color gives the odds that it is the item's, from the colors well inside and well outside of the
outline in depth. Where these odds step up or down is the outline in color. Its four sides are looked for
next to those in depth, so that an outline that the sensor made wider or narrower is no shift.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from flatcloth.checking.findings import Finding
from flatcloth.core.geometry import window_of
from flatcloth.core.types import Bool, Float32, Float64, RgbdFrame, Uint8
from flatcloth.recordings.mending import Mends, scaled_color

VIEWS = 4
"""Views that are looked at. Chosen: spread over the turn, they show the item from all sides."""
_HALF = 2
"""Images are halved: an outline is blurred by more than a pixel. Chosen."""
_SEARCH_PX = 32
"""Largest shift, in halved pixels. Chosen: color and depth of one camera are nearer."""
_CLEAR_PX = 4
"""Colors nearer to the outline than this, in halved pixels, are those of neither. Chosen."""
_MOST_ODDS = 2.0
"""The logarithm of the odds is bounded, so that one rare color does not count more than many. Chosen."""
_SMOOTH_PX = 1.0
"""Smoothing of the outlines, in halved pixels. Chosen."""
_LEAST_SHIFT_PX = 6.0
"""A smaller shift is not told. Measured: at most 3 on the 34 recordings."""
_LEAST_SCALE = 0.04
"""A smaller change of scale is not told. Measured: at most 0.02 on the 34 recordings."""
_SHIFT_STD_PX, _SCALE_STD = 1.5, 0.015
"""Deviations of the estimates. Measured: those of the 34 recordings."""
_SCALES = np.exp(np.linspace(-0.3, 0.3, 13))
"""Scales that are tried once color seems scaled. Chosen: color and depth of one camera differ by less."""
_LEAST_CONTRAST = 0.25
"""Color with a smaller share of its largest possible step does not show the outline. Set by hand."""


@dataclass(frozen=True, kw_only=True)
class ColorOffset:
    """Where the outline in color lies against that in depth: shift in pixels (right, down), and scale."""

    shift_px: tuple[float, float]
    scale: float
    contrast: float


class _Sides:
    """Correlations of the outlines of views, summed: left, right, upper and lower side."""

    def __init__(self) -> None:
        size = 2 * _SEARCH_PX + 1
        self.maps = np.zeros((4, size, size))
        self.energy = np.zeros(4)
        self.extent = np.zeros(2)
        self.views = 0

    def add(self, color: Uint8, item: Bool) -> None:
        """Add a view."""
        odds, near = _odds(color, item), cv2.GaussianBlur(item.astype(np.float32), (0, 0), _SMOOTH_PX)
        for axis in (0, 1):
            color_steps, depth_steps = (cv2.Sobel(of, cv2.CV_32F, 1 - axis, axis) for of in (odds, near))
            places = []
            for n, sign in enumerate((1.0, -1.0)):
                side = (sign * np.maximum(sign * depth_steps, 0.0)).astype(np.float32)
                self.maps[2 * axis + n] += _correlated(np.asarray(color_steps, dtype=np.float32), side)
                self.energy[2 * axis + n] += float(np.square(side).sum())
                weight = np.abs(side).sum(axis=axis)
                places.append(float(np.arange(len(weight)) @ weight) / max(float(weight.sum()), 1e-6))
            self.extent[axis] += places[1] - places[0]
        self.views += 1


def color_offset(frames: Sequence[tuple[RgbdFrame, Bool]]) -> ColorOffset | None:
    """Return where color lies against depth in some views with their items (H, W); None without outlines."""
    sides = _Sides()
    for frame, item in frames:
        window = window_of(item, _HALF * (_SEARCH_PX + _CLEAR_PX))
        if window is None:
            continue
        color, near = frame.color[window][::_HALF, ::_HALF], item[window][::_HALF, ::_HALF]
        closed = cv2.morphologyEx(near.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8)) > 0
        sides.add(np.ascontiguousarray(color), closed)
    if not sides.views or sides.energy.min() <= 0:
        return None
    found = [_peak(part) for part in sides.maps]
    left, right, top, bottom = found[0][0], found[1][0], found[2][1], found[3][1]
    width, height = sides.extent / sides.views
    # A wider outline in depth moves both sides apart alike; a scale moves the longer sides farther.
    scale = ((bottom - top) - (right - left)) / max(height - width, 1.0) if height > width else 0.0
    best = [part.max() / energy for part, energy in zip(sides.maps, sides.energy, strict=True)]
    return ColorOffset(
        shift_px=(_HALF * (left + right) / 2, _HALF * (top + bottom) / 2),
        scale=1.0 + scale,
        contrast=float(np.mean(best)) / (2 * _MOST_ODDS),
    )


def _scaled(frames: Sequence[tuple[RgbdFrame, Bool]], *, larger: bool) -> float:
    """Return the scale of color against depth, above or below 1, with which their outlines agree best."""
    found = []
    scales = _SCALES[_SCALES >= 1.0] if larger else _SCALES[_SCALES <= 1.0]
    for scale in scales:
        shrunk = [
            (replace(f, color=scaled_color(f.color, 1.0 / float(scale), (0.0, 0.0))), item)
            for f, item in frames
        ]
        offset = color_offset(shrunk)
        found.append(0.0 if offset is None else offset.contrast)
    return float(scales[int(np.argmax(found))])


def color_findings(frames: Sequence[tuple[RgbdFrame, Bool]]) -> list[Finding]:
    """Return whether color is shifted or scaled against depth, in some views with their items (H, W)."""
    found = color_offset(frames)
    if found is None or found.contrast < _LEAST_CONTRAST:
        return []
    shift, scale = math.hypot(*found.shift_px), found.scale - 1.0
    if shift < _LEAST_SHIFT_PX and abs(scale) < _LEAST_SCALE:
        return []
    far = max((shift - 2 * _SHIFT_STD_PX) / _SHIFT_STD_PX, (abs(scale) - _SCALE_STD) / _SCALE_STD)
    right, down = found.shift_px
    if abs(scale) >= _LEAST_SCALE:
        true = _scaled(frames[:2], larger=scale > 0)
        scale = true - 1.0
        if abs(scale) < _LEAST_SCALE:
            return []
        text = f"Color is {abs(scale):.0%} {'larger' if scale > 0 else 'smaller'} than depth"
        mend = Mends(color_scale=round(1.0 / true, 3))
    else:
        text = f"Color is {shift:.0f} pixels off depth ({right:+.0f} to the right, {down:+.0f} down)"
        mend = Mends(color_shift=(0.0 - round(right), 0.0 - round(down)))
    view = frames[0][0].view_index
    sure = math.erf(far / math.sqrt(2.0))
    return [
        Finding(
            name="color", text=text, probability=sure, mends=(mend,), views=(view, view), picture="outline"
        )
    ]


def _odds(color: Uint8, item: Bool) -> Float32:
    """Return the logarithm (H, W) of the odds that a pixel's color is the item's."""
    parts = (color >> 4).astype(np.int32)
    code = (parts[..., 0] << 8) | (parts[..., 1] << 4) | parts[..., 2]
    around, near = np.ones((3, 3), np.uint8), item.astype(np.uint8)
    inner = cv2.erode(near, around, iterations=_CLEAR_PX) > 0
    outer = cv2.dilate(near, around, iterations=_CLEAR_PX) == 0
    chances = []
    for part in (inner if inner.any() else item, outer):
        counted = np.bincount(code[part], minlength=4096) / max(int(part.sum()), 1)
        chances.append(np.log(counted + 1e-4))
    odds = np.clip((chances[0] - chances[1])[code], -_MOST_ODDS, _MOST_ODDS).astype(np.float32)
    made: Float32 = cv2.GaussianBlur(cv2.medianBlur(odds, 3), (0, 0), _SMOOTH_PX).astype(np.float32)
    return made


def _correlated(image: Float32, outline: Float32) -> Float64:
    """Return the correlation for shifts of the image against the outline up to the largest one."""
    least = 2 * _SEARCH_PX + 1
    rows, cols = (cv2.getOptimalDFTSize(max(size + _SEARCH_PX, least)) for size in image.shape)
    spectra = []
    for of in (image, outline):
        padded = np.zeros((rows, cols), np.float32)
        padded[: of.shape[0], : of.shape[1]] = of
        spectra.append(cv2.dft(padded))
    product = cv2.mulSpectrums(spectra[0], spectra[1], 0, conjB=True)
    whole = cv2.idft(product, flags=cv2.DFT_SCALE)
    size = 2 * _SEARCH_PX + 1
    return np.roll(whole, (_SEARCH_PX, _SEARCH_PX), (0, 1))[:size, :size].astype(np.float64)


def _peak(correlation: Float64) -> tuple[int, int]:
    """Return the shift (right, down) at which a correlation is largest."""
    row, col = np.unravel_index(int(correlation.argmax()), correlation.shape)
    return int(col) - _SEARCH_PX, int(row) - _SEARCH_PX
