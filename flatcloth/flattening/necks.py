"""Narrow necks: places where only a few pairs connect two parts of a sheet of samples.

Two parts of cloth joined by a strip of one or two samples are each flattened correctly, but the
strip does not determine the angle between them. Cloth stretches and shears by one or two percent;
over so short a strip this turns one part against the other and displaces its far end by tens of
millimetres. Necks are therefore cut, and the parts are flattened and later placed separately.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numba import njit

from flatcloth.core.types import Bool, Int32
from flatcloth.flattening.sampling import Samples
from flatcloth.flattening.surface import unite

_NEIGHBOURS = 8
"""Neighbours of a sample inside the grid (paper, section 3: each sample is linked to the eight around it)."""


def cut_necks(samples: Samples, least_core: int) -> Samples:
    """Return the samples without the pairs that connect two parts through a neck.

    Parameters
    ----------
    samples : Samples
        Samples on a grid with their pairs.
    least_core : int
        A part has at least this many connected samples that have all eight neighbours. Other samples
        belong to the nearest part. 0 cuts nothing.
    """
    if least_core <= 0 or len(samples.edges) == 0:
        return samples
    part = _parts(len(samples.points_rc), samples.edges, least_core)
    inside = part[samples.edges[:, 0]] == part[samples.edges[:, 1]]
    return replace(samples, edges=samples.edges[inside], edge_length_m=samples.edge_length_m[inside])


def graph_components(n: int, edges: Int32) -> Int32:
    """Return the number (n,) of each point's connected component, in the order of their first points."""
    return _components(n, np.ascontiguousarray(edges))


@njit(cache=True, nogil=True)
def _components(n: int, edges: Int32) -> Int32:
    parent = np.arange(n).astype(np.int32)
    for e in range(edges.shape[0]):
        unite(parent, edges[e, 0], edges[e, 1])
    count = 0
    for m in range(n):
        # A parent has a smaller number than its child, and was replaced by its component's before.
        if parent[m] == m:
            parent[m] = count
            count += 1
        else:
            parent[m] = parent[parent[m]]
    return parent


def _parts(n: int, edges: Int32, least_core: int) -> Int32:
    """Find the core nearest to each sample (N,) along the pairs; -1 if no core can be reached."""
    a, b = edges[:, 0], edges[:, 1]
    whole = np.bincount(edges.ravel(), minlength=n) >= _NEIGHBOURS
    core = _cores(n, edges[whole[a] & whole[b]], whole)
    size = np.bincount(core[core >= 0], minlength=1)
    if (size >= least_core).sum() <= 1:
        return np.zeros(n, dtype=np.int32)  # at most one part
    part = np.where((core >= 0) & (size[np.maximum(core, 0)] >= least_core), core, -1).astype(np.int32)
    while True:  # grow by one pair at a time, so that the nearest core wins
        reached = part.copy()
        for near, far in ((a, b), (b, a)):
            grows = (part[near] >= 0) & (reached[far] < 0)
            reached[far[grows]] = part[near[grows]]
        if (reached == part).all():
            return part
        part = reached


def _cores(n: int, edges: Int32, whole: Bool) -> Int32:
    label: Int32 = np.where(whole, graph_components(n, edges), -1)
    return label
