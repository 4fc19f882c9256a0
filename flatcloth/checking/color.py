"""Does color belong to depth? Shift and scale between them, by the item in both, and exchanged views.

Each pixel's color gives the odds that it is the item's, from the colors inside and outside of it in depth,
in all views. They are moved and enlarged until they lie on the item in depth. An outline that the sensor
made wider or narrower is no scale: it changes width and height by as many pixels. A color image belongs to
the depth image whose item covers these pixels best: the outline changes as the item turns, so that also a
shift by one view is seen.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

import cv2
import numpy as np

from flatcloth.checking.findings import Finding
from flatcloth.core.types import Bool, Float32, Float64, RgbdFrame, Uint8
from flatcloth.recordings.options import Mends

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

_SAME_COLOR = 16
"""Values that differ by more are another color. Chosen: noise of reduced images is smaller."""


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


def share_unchanged(one: Shown, other: Shown) -> float:
    """Return the share of the item in both of two reduced views that has the same color, but for exposure."""
    both = (one[0] == 1.0) & (other[0] == 1.0)
    if not both.any():
        return 1.0
    change = one[1][both].astype(np.int16) - other[1][both]
    return float((np.abs(change - np.median(change, axis=0)).max(axis=1) <= _SAME_COLOR).mean())


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


# --- views that are exchanged ---------------------------------------------------------------------

_HIT, _BESIDE = 0.7, 0.06
"""Chance that a view fits best to its partner, and to each of those beside it. Measured: of right recordings
0.9 to 1 of the views fit best to their partner."""
_BESIDE_VIEWS = 2
"""A view may fit best to one at most so many views beside its partner. Chosen: outlines change slowly."""
_CHANGE = 6.0
"""Logarithm of how much less probable each change of the shift is than none. Chosen: one in 400."""
_WRONG = 1e-3
"""Probability that color and depth are shifted, before the views are looked at. Chosen."""
_FEWEST = 4
"""Fewest views that are shifted together. Chosen: single ones may be damaged."""


def partners(alike: Float64) -> tuple[list[int], float]:
    """Return the depth image (N,) that belongs to each color image, and how sure it is that any is another's.

    The views are in order of capture; ``alike`` is :func:`likeness`. Partners go forth or back from view to
    view, with few jumps, where frames were lost; they may lie before the first or after the last view.
    """
    count = len(alike)
    best, views = alike.argmax(axis=1), np.arange(count)
    votes = Counter((sense, k) for sense in (1, -1) for k in (best - sense * views).tolist())
    told = [(1, 0), *(way for way in votes if votes[way] >= _FEWEST and way != (1, 0))]
    ways = np.array([sense * views + k for sense, k in told])
    total, path = _likeliest(_log_fits(best, ways))
    right = float(_log_fits(best, views[None]).sum())
    paired = ways[path, views].tolist()
    moved = [n for n in range(count) if paired[n] != n]
    hits = np.mean([best[n] == paired[n] for n in moved]) if moved else 0.0
    if len(moved) < _FEWEST or hits < 0.5:
        return list(range(count)), 0.0
    odds = math.log(_WRONG) + total - right
    return paired, 1.0 / (1.0 + math.exp(-max(min(odds, 30.0), -30.0)))


def _log_fits(best: np.ndarray, paired: np.ndarray) -> Float64:
    """Return the logarithms of the chances (K, N) that views fit best to what they do, for K ways to pair."""
    off, count = np.abs(best - paired), len(best)
    chance = np.where(off == 0, _HIT, np.where(off <= _BESIDE_VIEWS, _BESIDE, _BESIDE / count))
    return np.asarray(np.log(chance), dtype=np.float64)


def _likeliest(log: Float64) -> tuple[float, list[int]]:
    """Return the likeliest sequence of ways (N,), and its logarithm; each change costs."""
    total, came = log[:, 0].copy(), []
    for n in range(1, log.shape[1]):
        jump = int(total.argmax())
        stays = total >= total[jump] - _CHANGE
        came.append(np.where(stays, np.arange(len(total)), jump))
        total = np.where(stays, total, total[jump] - _CHANGE) + log[:, n]
    path = [int(total.argmax())]
    for before in reversed(came):
        path.append(int(before[path[-1]]))
    return float(total.max()), path[::-1]


def pairing_findings(items: Float32, odds: Float32, view_indices: Sequence[int], count: int) -> list[Finding]:
    """Return whether the depth of views belongs to the color of others.

    Parameters
    ----------
    items, odds : (N, h, w) float32
        Of the views, in order of capture, by :func:`.color.odds_of`.
    view_indices : sequence of int
        Their numbers.
    count : int
        Views of the recording; without all of them nothing mends it.
    """
    if len(items) < 2 * _FEWEST:
        return []
    alike = likeness(odds, items)
    paired, sure = partners(alike)
    moved = [n for n, other in enumerate(paired) if other != n]
    seen = [n for n in moved if 0 <= paired[n] < len(paired)]
    if sure < 0.5 or registered(odds[seen], items[seen])[1] >= alike[seen, np.array(paired)[seen]].mean():
        return []
    example = next((n for n in moved[len(moved) // 2 :] if 0 <= paired[n] < len(paired)), moved[0])
    names = f"of views {view_indices[moved[0]]} to {view_indices[moved[-1]]}"
    shifts = sorted({paired[n] - n for n in moved})
    how = f"shifted against each other by {abs(shifts[0])} view{'s' if abs(shifts[0]) > 1 else ''}"
    if len(shifts) > 1:
        how = "in opposite order" if paired[moved[0]] > paired[moved[1]] else "shifted against each other"
    text = (
        f"Color and depth {names} are {how}: the color of view {view_indices[example]} shows what the depth"
    )
    text += f" of view {view_indices[min(max(paired[example], 0), len(paired) - 1)]} does"
    mends: tuple[Mends, ...] = ()
    if len(items) == count:
        fits = {other: max((n for n in range(count) if paired[n] == other), key=lambda n: alike[n, paired[n]])
                for other in set(paired) if 0 <= other < count}  # fmt: skip
        kept = set(fits.values())
        depth_views = tuple((n, paired[n]) for n in moved if n in kept)
        mends = (Mends(depth_views=depth_views, leave_out=tuple(n for n in range(count) if n not in kept)),)
    view = view_indices[example]
    return [Finding(name="pairing", text=text, probability=sure, mends=mends, views=(view, view))]
