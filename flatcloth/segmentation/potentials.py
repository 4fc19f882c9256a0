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
from scipy.sparse import csr_matrix, diags
from scipy.sparse.linalg import LinearOperator, cg, splu

from flatcloth.core.compiled import njit
from flatcloth.core.types import Float64, Int64
from flatcloth.segmentation.partition import CORE_NODES, partition
from flatcloth.segmentation.relations import SignedGraph


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
    """Solves for the potentials of a graph; keeps the data that does not depend on the conductances."""

    def __init__(self, graph: SignedGraph) -> None:
        self.rows = rows_of(graph)
        part = partition(replace(graph, weight=np.maximum(graph.weight, 0.0)), CORE_NODES).part
        self._piece = np.unique(part, return_inverse=True)[1].ravel().astype(np.int64)
        every = np.arange(graph.count)
        self._of_piece = csr_matrix((np.ones(graph.count), (self._piece, every)))

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
        begin, neighbour, edge = self.rows
        weight = conductance[edge]
        joins = csr_matrix((weight, neighbour, begin), shape=(len(anchor), len(anchor)))
        diagonal = anchor + joins @ np.ones(len(anchor))
        matrix = diags(diagonal).tocsr() - joins
        coarse = splu(
            (self._of_piece @ matrix @ self._of_piece.T).tocsc(),
            permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}, diag_pivot_thresh=0.0,
        )  # fmt: skip
        rows = _Rows(begin, neighbour, weight, diagonal)

        def cycle(residual: Float64) -> Float64:
            smooth, left = _smoothed(rows, residual, self._piece, self._of_piece.shape[0])
            _smoothed_again(rows, residual, self._piece, coarse.solve(left), smooth)
            return smooth

        smoothed = LinearOperator(matrix.shape, cycle, dtype=np.float64)
        correction, _ = cg(matrix, right - matrix @ start, M=smoothed)
        return np.asarray(start + correction)


class _Rows(NamedTuple):
    begin: Int64
    neighbour: Int64
    weight: Float64
    diagonal: Float64


@njit(cache=True, nogil=True)
def _smoothed(rows: _Rows, right: Float64, piece: Int64, pieces: int) -> tuple[Float64, Float64]:
    """Return the solution (M,) after a sweep from 0, and the residual summed over each piece."""
    begin, neighbour, weight, diagonal = rows
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
def _smoothed_again(rows: _Rows, right: Float64, piece: Int64, corrected: Float64, x: Float64) -> None:
    """Add the correction of each piece to x (M,), and sweep the other way."""
    begin, neighbour, weight, diagonal = rows
    for i in range(len(x)):
        x[i] += corrected[piece[i]]
    for i in range(len(x) - 1, -1, -1):
        total = right[i]
        for k in range(begin[i], begin[i + 1]):
            total += weight[k] * x[neighbour[k]]
        x[i] = total / diagonal[i]
