"""Potentials over the evidence, by conjugate gradients on two grids: clusters, and pieces of several.

The evidence is that of one graph; only its conductances change from stroke to stroke. Its pieces, a few
clusters that strong evidence joins, are found once. Each step smooths the error on the clusters
(Gauss-Seidel), solves for what is left on the pieces, and smooths again: a cycle of two grids by
aggregation (Notay, ETNA 2010). A direct solution takes four times as long.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu

from flatcloth.core.types import Float64, Int64
from flatcloth.segmentation.partition import partition
from flatcloth.segmentation.relations import SignedGraph

_PIECE_NODES = 8
"""Clusters of a piece. Chosen: pieces of 4 and of 16 take longer."""
_WEAK = 0.05
"""Evidence weaker than this share of the strongest joins no pieces: it lies at their borders. Chosen for
speed."""
_PRECISION = 1e-4
"""Error, in the norm of the energy, over that of the start. Chosen: only the order of potentials counts."""
_MOST_STEPS = 200
"""Steps after which the solution is taken as it is; 5 to 40 are usual. Chosen."""


class Rows(NamedTuple):
    """The graph by rows: node i has the entries ``begin[i]`` to ``begin[i + 1]``: neighbour and edge."""

    begin: Int64
    neighbour: Int64
    edge: Int64


def rows_of(graph: SignedGraph) -> Rows:
    """Return each edge at both its ends."""
    one = np.concatenate([graph.first, graph.second])
    other = np.concatenate([graph.second, graph.first])
    order = np.argsort(one, kind="stable")
    begin = np.concatenate([[0], np.cumsum(np.bincount(one, minlength=graph.count))])
    return Rows(begin, other[order], order % max(len(graph.first), 1))


class Potentials:
    """Solves for the potentials of a graph; holds what does not depend on the conductances.

    Parameters
    ----------
    graph : SignedGraph
        The evidence.
    """

    def __init__(self, graph: SignedGraph) -> None:
        self.rows = rows_of(graph)
        self._graph = graph
        strong = np.maximum(graph.weight - _WEAK * graph.weight.max(initial=0.0), 0.0)
        pieces = partition(replace(graph, weight=strong), _PIECE_NODES)
        piece = np.unique(pieces.part, return_inverse=True)[1].ravel().astype(np.int64)
        self._piece, self._pieces = piece, int(piece.max(initial=-1)) + 1
        # Where each edge between pieces stands in the columns of the coarse system.
        one, other = piece[graph.first], piece[graph.second]
        self._between = np.flatnonzero(one != other)
        one, other = one[self._between], other[self._between]
        own = np.arange(self._pieces)
        self._place = own
        self._arrange(one, other, own)
        ones, count = np.ones(len(graph.first)), np.ones(graph.count)
        ordered = splu(
            self._coarse(ones, count),
            permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}, diag_pivot_thresh=0.0,
        )  # fmt: skip
        self._place = ordered.perm_c.astype(np.int64)
        self._arrange(self._place[one], self._place[other], self._place)

    def _arrange(self, one: Int64, other: Int64, own: Int64) -> None:
        n = self._pieces
        places = np.concatenate([other * n + one, one * n + other, own * n + own])
        entries, self._entry = np.unique(places, return_inverse=True)
        self._entry = self._entry.ravel()
        self._row = (entries % n).astype(np.int32)
        self._begin = np.searchsorted(entries, n * np.arange(n + 1)).astype(np.int32)

    def _coarse(self, conductance: Float64, anchor: Float64) -> csc_matrix:
        """Return the system of the pieces, in their order of elimination."""
        between = conductance[self._between]
        g = self._graph
        one, other = self._piece[g.first[self._between]], self._piece[g.second[self._between]]
        n = self._pieces
        total = np.bincount(self._piece, anchor, n)
        total += np.bincount(one, between, n) + np.bincount(other, between, n)
        data = np.bincount(self._entry, np.concatenate([-between, -between, total]), len(self._row))
        return csc_matrix((data, self._row, self._begin), shape=(n, n))

    def solve(self, conductance: Float64, anchor: Float64, right: Float64, start: Float64) -> Float64:
        """Return x (M,) with (L + diag(anchor)) x = right, where L is the Laplacian.

        Parameters
        ----------
        conductance : (E,) float64
            Of each edge, at least 0.
        anchor : (M,) float64
            Conductance of each node to ground, above 0.
        right : (M,) float64
            The right side.
        start : (M,) float64
            A first estimate.
        """
        rows = self.rows
        weight = conductance[rows.edge]
        diagonal = anchor + _sums(rows.begin, weight)
        coarse = splu(
            self._coarse(conductance, anchor),
            permc_spec="NATURAL", options={"SymmetricMode": True}, diag_pivot_thresh=0.0,
        )  # fmt: skip
        matrix = _Matrix(rows.begin, rows.neighbour, weight, diagonal)
        x = start.copy()
        residual = right - _times(matrix, x)
        way = np.zeros_like(x)
        last, least = 0.0, np.inf
        for step in range(_MOST_STEPS):
            smooth, left = _smoothed(matrix, residual, self._piece, self._pieces)
            moved = np.empty(self._pieces)
            moved[self._place] = left
            corrected = coarse.solve(moved)[self._place]
            _smoothed_again(matrix, residual, self._piece, corrected, smooth)
            energy = float(residual @ smooth)
            if step == 0:
                least = _PRECISION**2 * energy
            if energy <= least:
                break
            way = smooth + (energy / last if step else 0.0) * way
            last = energy
            pushed = _times(matrix, way)
            length = energy / float(way @ pushed)
            x += length * way
            residual -= length * pushed
        return x


class _Matrix(NamedTuple):
    begin: Int64
    neighbour: Int64
    weight: Float64
    diagonal: Float64


@njit(cache=True, nogil=True)
def _sums(begin: Int64, weight: Float64) -> Float64:
    total = np.zeros(len(begin) - 1)
    for i in range(len(total)):
        for k in range(begin[i], begin[i + 1]):
            total[i] += weight[k]
    return total


@njit(cache=True, nogil=True)
def _times(matrix: _Matrix, x: Float64) -> Float64:
    begin, neighbour, weight, diagonal = matrix
    found = np.empty(len(x))
    for i in range(len(x)):
        total = diagonal[i] * x[i]
        for k in range(begin[i], begin[i + 1]):
            total -= weight[k] * x[neighbour[k]]
        found[i] = total
    return found


@njit(cache=True, nogil=True)
def _smoothed(matrix: _Matrix, right: Float64, piece: Int64, pieces: int) -> tuple[Float64, Float64]:
    """Return the solution (M,) after a sweep from 0, and what is left of the right side, by pieces."""
    begin, neighbour, weight, diagonal = matrix
    x, left = np.zeros(len(right)), np.zeros(pieces)
    for i in range(len(x)):
        total = right[i]
        for k in range(begin[i], begin[i + 1]):
            total += weight[k] * x[neighbour[k]]
        x[i] = total / diagonal[i]
    for i in range(len(x)):
        total = right[i] - diagonal[i] * x[i]
        for k in range(begin[i], begin[i + 1]):
            total += weight[k] * x[neighbour[k]]
        left[piece[i]] += total
    return x, left


@njit(cache=True, nogil=True)
def _smoothed_again(matrix: _Matrix, right: Float64, piece: Int64, corrected: Float64, x: Float64) -> None:
    """Add the correction of each piece to x (M,), and sweep the other way."""
    begin, neighbour, weight, diagonal = matrix
    for i in range(len(x)):
        x[i] += corrected[piece[i]]
    for i in range(len(x) - 1, -1, -1):
        total = right[i]
        for k in range(begin[i], begin[i + 1]):
            total += weight[k] * x[neighbour[k]]
        x[i] = total / diagonal[i]
