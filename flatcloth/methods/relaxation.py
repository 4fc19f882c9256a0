"""As-rigid-as-possible relaxation (Sorkine and Alexa, 2007) of a sheet observed by several views.

A membership is a node as observed by one view. In each step every membership is rotated from its tangent
plane to the plane, without mirroring; then one solve moves all nodes at once.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.linalg.lapack import dpbtrf, dpbtrs

from flatcloth.core.types import Bool, Float64, Int32
from flatcloth.flattening.banded import BandedLaplacian, Banding

Complex128 = NDArray[np.complex128]
Int64 = NDArray[np.int64]

_HELD = 1e-6
"""Weight that holds every node at its position, because lengths do not fix the sheet as a whole; its inverse
keeps a node where it is. By definition: far from the weights of pairs, which are about 1."""


@njit(cache=True, nogil=True)
def local_rotations(
    z: Complex128, edges: Int32, member: Int32, offset: Complex128, weight: Float64, n_members: int
) -> Complex128:
    """Return the rotation of each membership from its tangent plane to the plane, as a unit complex number.

    It is 0 where no pair determines it.

    Parameters
    ----------
    z : (N,) complex128
        Positions of the nodes, u + iv, metres.
    edges, member : (M, 2) int32
        Pairs of nodes, and the same ends as memberships.
    offset : (M, 2) complex128
        The other end in the tangent plane of each end, metres.
    weight : (M,) float64
        Weight of each pair; a pair with weight 0 may have ends without a position.
    n_members : int
        Number of memberships.
    """
    total = np.zeros(n_members, dtype=np.complex128)
    for e in range(edges.shape[0]):
        if weight[e] > 0.0:
            along = z[edges[e, 1]] - z[edges[e, 0]]
            for end in range(2):
                total[member[e, end]] += weight[e] * along * np.conj(offset[e, end])
    for m in range(n_members):
        size = abs(total[m])
        if size > 0.0:
            total[m] /= size
    return total


@njit(cache=True, nogil=True)
def _wanted(
    turn: Complex128, edges: Int32, member: Int32, offset: Complex128, weight: Float64, n: int
) -> Float64:
    """Return the right-hand side (n, 2) of the solve, from the rotated neighbourhoods."""
    rhs = np.zeros((n, 2))
    for e in range(edges.shape[0]):
        i, j = edges[e, 0], edges[e, 1]
        along = turn[member[e, 0]] * offset[e, 0] + turn[member[e, 1]] * offset[e, 1]
        along *= 0.5 * weight[e]
        rhs[j, 0] += along.real
        rhs[j, 1] += along.imag
        rhs[i, 0] -= along.real
        rhs[i, 1] -= along.imag
    return rhs


def relax_rigidly(
    z: Complex128,
    edges: Int32,
    member: Int32,
    offset: Complex128,
    weight: Float64,
    n_members: int,
    steps: int,
    narrow: Banding,
    is_held: Bool | None = None,
) -> Float64:
    """Return the nodes (N, 2), metres, after some steps of relaxation.

    Parameters
    ----------
    z, edges, member, offset, n_members
        As in :func:`local_rotations`, where all pairs have equal weight.
    weight : (M,) float64
        Weights of the pairs.
    steps : int
        Number of alternations between rotating the neighbourhoods and moving the nodes.
    narrow : Banding
        The banding of the pairs, or of the unique ones among them.
    is_held : (N,) bool, optional
        Nodes that keep their places.
    """
    pair = np.arange(len(edges)) if narrow.pair is None else narrow.pair
    held = np.full((len(z), 1), _HELD)
    if is_held is not None:
        held[is_held] = 1.0 / _HELD
    laplacian = BandedLaplacian(narrow, np.bincount(pair, weight).astype(np.float64), held[:, 0])
    alike = np.ones(len(edges))
    center = z.mean()
    z = z - center
    for _ in range(steps):
        turn = local_rotations(z, edges, member, offset, alike, n_members)
        rhs = _wanted(turn, edges, member, offset, weight, len(z))
        moved = laplacian.solve(rhs + held * z.view(np.float64).reshape(-1, 2))
        z = moved[:, 0] + 1j * moved[:, 1]
    z = z + center
    return np.stack([z.real, z.imag], axis=1)


class BorderedBand:
    """A factored system whose matrix is a band but for its last rows and columns.

    Parameters
    ----------
    band : (F, K + 1) float64
        The lower band of the first F unknowns, each row from the diagonal on; it is overwritten.
    border : (B, F + B) float64
        The rows of the others, up to the diagonal.

    Raises
    ------
    numpy.linalg.LinAlgError
        The matrix is not positive definite; something must hold every unknown.
    """

    def __init__(self, band: Float64, border: Float64) -> None:
        self._free = len(band)
        if self._free:
            self._band, failed = dpbtrf(band.T, lower=1, overwrite_ab=1)
            if failed:
                raise np.linalg.LinAlgError("the matrix is not definite")
        self._side = border[:, : self._free]
        if len(border):
            corner = border[:, self._free :]
            self._reduced = self._banded(self._side.T)
            self._corner = np.tril(corner) + np.tril(corner, -1).T - self._side @ self._reduced

    def solve(self, rhs: Float64) -> Float64:
        """Return the solution (F + B,) for a right-hand side (F + B,)."""
        first = self._banded(rhs[: self._free])
        if not len(self._side):
            return first
        last = np.linalg.solve(self._corner, rhs[self._free :] - self._side @ first)
        return np.concatenate([first - self._reduced @ last, last])

    def _banded(self, rhs: Float64) -> Float64:
        """Solve for the first unknowns alone; LAPACK takes no empty matrix."""
        return np.asarray(dpbtrs(self._band, rhs, lower=1)[0] if self._free else rhs)


@njit(cache=True, nogil=True)
def add_products(column: Int64, value: Float64, weight: float, band: Float64, border: Float64) -> None:
    """Add ``weight`` times all products of a row's values to the matrix of a :class:`BorderedBand`."""
    free = band.shape[0]
    for a in range(column.size):
        for b in range(column.size):
            low, high = column[a], column[b]
            if low <= high:
                product = weight * value[a] * value[b]
                if high < free:
                    band[low, high - low] += product
                else:
                    border[high - free, low] += product
