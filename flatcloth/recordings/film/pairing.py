"""Pairing of color and depth images by time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def pair_by_time(
    color_s: Sequence[float], depth_s: Sequence[float], most_apart_s: float
) -> list[tuple[int, int]]:
    """Return pairs of indices, in the order of the color times; each image is in at most one pair.

    Parameters
    ----------
    color_s, depth_s : sequences of float
        Times in seconds, in any order.
    most_apart_s : float
        Images farther apart are not paired. The nearest are paired first.
    """
    color = np.asarray(color_s, dtype=np.float64)
    depth = np.asarray(depth_s, dtype=np.float64)
    order = np.argsort(depth, kind="stable")
    low = np.searchsorted(depth[order], color - most_apart_s)
    high = np.searchsorted(depth[order], color + most_apart_s, side="right")
    candidates = sorted(
        (abs(float(color[i] - depth[j])), i, int(j))
        for i in range(len(color))
        for j in order[low[i] : high[i]]
    )
    of_color: dict[int, int] = {}
    taken: set[int] = set()
    for _, i, j in candidates:
        if i not in of_color and j not in taken:
            of_color[i] = j
            taken.add(j)
    return [(i, of_color[i]) for i in np.argsort(color, kind="stable").tolist() if i in of_color]
