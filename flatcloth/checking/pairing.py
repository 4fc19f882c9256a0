"""Does each color image belong to its depth image? The item in color is compared with that in depth.

The colors of the item and of the background, over all views, give the odds that a pixel shows the item. A
color image belongs to the depth image whose item covers these pixels best. As the item turns its outline
changes from view to view, so that also a shift by one view is seen.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np

from flatcloth.checking.color import likeness, registered
from flatcloth.checking.findings import Finding
from flatcloth.core.types import Float32, Float64
from flatcloth.recordings.mending import Mends

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
