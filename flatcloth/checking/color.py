"""Does color lie on depth? Shift and scale between them, by the item in both.

Each pixel's color gives the odds that it is the item's, from the colors inside and outside of it in depth, in
all views. They are moved and enlarged until they lie on the item in depth. An outline that the sensor
made wider or narrower is no scale: it changes width and height by as many pixels.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np

from flatcloth.checking.findings import Finding
from flatcloth.core.types import Bool, Float32, Float64, RgbdFrame, Uint8
from flatcloth.recordings.mending import Mends

_ROWS = 160
"""Images are reduced to so many rows. Measured: with 96, an outline moves too little in two of the 34."""
_VIEWS = 8
"""Views that are registered. Chosen: spread over the turn, they show the item from all sides."""
_MOST_ODDS = 2.0
"""The logarithm of the odds is bounded, so that one rare color does not count more than many. Chosen."""
_STEPS_PX = (8.0, 4.0, 2.0, 1.0, 0.5, 0.25)
"""Steps by which color is moved over depth, in reduced pixels, coarse to fine. Chosen."""
_LEAST_SHIFT_PX = 6.0
"""A smaller shift is not told. Measured: at most 3 on the 34 recordings."""
_LEAST_SCALE = 0.04
"""A smaller change of scale is not told. Measured: at most 0.02 on the 34 recordings."""
_SHIFT_STD_PX, _SCALE_STD = 1.5, 0.015
"""Deviations of the estimates. Measured: those of the 34 recordings."""
_LEAST_ALIKE = 0.6
"""Color that lies worse on depth does not show the outline. Chosen: on the 34 recordings it is 0.95."""


Shown = tuple[Float32, Uint8]
"""The item (h, w) of a reduced view, as the share of each pixel, and its color (h, w, 3)."""


def reduced(frame: RgbdFrame, item: Bool) -> Shown:
    """Return a view with its item (H, W), reduced."""
    rows, cols = item.shape
    scale = min(1.0, _ROWS / rows)
    size = max(1, round(scale * cols)), max(1, round(scale * rows))
    return tuple(  # type: ignore[return-value]
        cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        for image in (item.astype(np.float32), frame.color)
    )


def odds_of(shown: Sequence[Shown]) -> tuple[Float32, Float32]:
    """Return the items (N, h, w) of views, and the logarithms of the odds that colors are theirs."""
    items, colors = (np.stack(images) for images in zip(*shown, strict=True))
    code = (colors >> 4).astype(np.int32) @ np.array([256, 16, 1], np.int32)
    chances = []
    for share in (items, 1 - items):
        counted = np.bincount(code.ravel(), weights=share.ravel(), minlength=4096) / max(
            float(share.sum()), 1.0
        )
        chances.append(np.log(counted + 1e-4))
    odds = np.clip((chances[0] - chances[1])[code], -_MOST_ODDS, _MOST_ODDS).astype(np.float32)
    return items, odds


def likeness(odds: Float32, items: Float32) -> Float64:
    """Return how well odds (N, h, w) lie on each of the items (M, h, w): (N, M), 1 at most."""
    normed = []
    for images in (odds, items):
        flat = images.reshape(len(images), -1)
        centered = flat - flat.mean(axis=1, keepdims=True)
        normed.append(centered / np.maximum(np.linalg.norm(centered, axis=1, keepdims=True), 1e-9))
    alike: Float64 = (normed[0] @ normed[1].T).astype(np.float64)
    return alike


def registered(odds: Float32, items: Float32) -> tuple[Float64, float]:
    """Return how odds (N, h, w) must all be moved to lie best on their items (N, h, w), and how well they do.

    The motion (4,) is right and down in pixels, and the logarithms of the scales about the middle.
    """
    size = np.array(odds.shape[:0:-1])

    def moved(by: Float64) -> float:
        scale = np.exp(by[2:])
        matrix = np.column_stack([np.diag(scale), (1 - scale) * 0.5 * (size - 1) + by[:2]])
        made = (cv2.warpAffine(one, matrix, tuple(size), borderMode=cv2.BORDER_REPLICATE) for one in odds)
        pairs = ((np.asarray(m, dtype=np.float32)[None], i[None]) for m, i in zip(made, items, strict=True))
        return float(np.mean([likeness(*pair)[0, 0] for pair in pairs]))

    by, best = np.zeros(4), moved(np.zeros(4))
    for step in _STEPS_PX:
        ways = np.vstack([np.eye(4), -np.eye(4)]) * [step, step, *(step / size)]
        better = True
        while better:
            better = False
            for way in ways:
                if (tried := moved(by + way)) > best:
                    by, best, better = by + way, tried, True
    return by, best


def color_findings(items: Float32, odds: Float32, view_indices: Sequence[int], every: float) -> list[Finding]:
    """Return whether color is shifted or scaled against depth.

    Parameters
    ----------
    items, odds : (N, h, w) float32
        Of the views, by :func:`odds_of`.
    view_indices : sequence of int
        Their numbers.
    every : float
        Pixels of the images that one of these stands for.
    """
    some = slice(None, None, max(1, len(items) // _VIEWS))
    items, odds = items[some], odds[some]
    by, alike = registered(odds, items)
    if alike < _LEAST_ALIKE:
        return []
    height, width = ((items > 0.5).any(axis=axis).sum(axis=1).mean() for axis in (2, 1))
    wider, higher = np.expm1(by[2:]) * (width, height)
    narrower = 1.0 + (higher - wider) / max(height - width, 1.0) if height > width else 1.0
    scale, (right, down) = 1.0 / narrower - 1.0, (-every * by[:2]).tolist()
    shift = math.hypot(right, down)
    if shift < _LEAST_SHIFT_PX and abs(scale) < _LEAST_SCALE:
        return []
    far = max((shift - 2 * _SHIFT_STD_PX) / _SHIFT_STD_PX, (abs(scale) - _SCALE_STD) / _SCALE_STD)
    if abs(scale) >= _LEAST_SCALE:
        text = f"Color is {abs(scale):.0%} {'larger' if scale > 0 else 'smaller'} than depth"
        mend = Mends(color_scale=round(narrower, 3))
    else:
        text = f"Color is {shift:.0f} pixels off depth ({right:+.0f} to the right, {down:+.0f} down)"
        mend = Mends(color_shift=(0.0 - round(right), 0.0 - round(down)))
    view = view_indices[0]
    sure = math.erf(far / math.sqrt(2.0))
    return [Finding(name="color", text=text, probability=sure, mends=(mend,), views=(view, view))]
