"""Factored sparse systems: factor once, solve often."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix, csc_matrix
from scipy.sparse.linalg import SuperLU, splu

from flatcloth.types import Float64, Int32


def laplacian_factor(n: int, edges: Int32, weight: Float64) -> SuperLU:
    """Factor the graph Laplacian; a trace of the identity makes it definite."""
    i, j = edges[:, 0], edges[:, 1]
    rows, cols = np.concatenate([i, j, i, j]), np.concatenate([i, j, j, i])
    values = np.concatenate([weight, weight, -weight, -weight])
    matrix = coo_matrix((values, (rows, cols)), shape=(n, n)).tocsc()
    return factor(matrix + csc_matrix((np.full(n, 1e-6), (range(n), range(n))), shape=(n, n)))


def factor(matrix: csc_matrix) -> SuperLU:
    """Factor a sparse symmetric positive definite matrix."""
    return splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
