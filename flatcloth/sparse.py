"""Factored sparse systems: factor once, solve often."""

from __future__ import annotations

from scipy.sparse import csc_matrix
from scipy.sparse.linalg import SuperLU, splu


def factor(matrix: csc_matrix) -> SuperLU:
    """Factor a sparse symmetric positive definite matrix."""
    return splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
