"""Symmetric equations between neighbouring nodes, as narrow bands for LAPACK.

Cloth hangs long and narrow: in the order of Cuthill and McKee (1969) all entries of such a matrix lie near
its diagonal, and LAPACK factors a band nearly as fast as the processor multiplies. Nothing here depends on
how many cores there are, or how wide the processor's vectors are, but for the last digits.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpbtrf, dpbtrs, zpbtrf, zpbtrs

from flatcloth.core.compiled import njit
from flatcloth.core.graphs import grouped
from flatcloth.core.types import Bool, Complex128, Float64, Int32

Band = NDArray[Any]
"""A symmetric matrix as a band (width + 1, N), real or complex: its lower half, by columns."""


@dataclass(frozen=True, kw_only=True)
class Order:
    """Nodes in an order that makes bands narrow.

    ``nodes`` (N,) int32 in that order; ``low``, ``high`` (P,) int32 the places of the ends of each pair in
    it, the lower first; ``is_turned`` (P,) whether that is the pair's second end; ``width`` the largest
    difference.
    """

    nodes: Int32
    low: Int32
    high: Int32
    is_turned: Bool
    width: int


def order_of(n: int, pairs: Int32) -> Order:
    """Return the order of ``n`` nodes for pairs (P, 2) int32."""
    nodes = cuthill_mckee(n, pairs)
    place = np.empty(n, dtype=np.int32)
    place[nodes] = np.arange(n, dtype=np.int32)
    first, second = place[pairs].T
    low, high = np.minimum(first, second), np.maximum(first, second)
    return Order(
        nodes=nodes, low=low, high=high, is_turned=first != low, width=int((high - low).max(initial=0))
    )


@njit(cache=True, nogil=True)
def cuthill_mckee(n: int, edges: Int32) -> Int32:
    """Return an order (n,) of points in which the ends of pairs (M, 2) int32 lie close together.

    It is that of Cuthill and McKee (1969), begun again where the one before ended (Gibbs et al., 1976) until
    that makes it no narrower: layers of a long shape are narrow if the first is at an end of it.
    """
    first, end = grouped(edges.ravel(), n)
    near = edges.ravel()[end ^ 1]
    narrowest, least, start = np.arange(n).astype(np.int32), n, 0
    while True:
        order, is_listed = np.empty(n, dtype=np.int32), np.zeros(n, dtype=np.bool_)
        count, widest, unlisted = 0, 0, 0
        for at in range(n):
            if at == count:  # the first point, or the first of another part
                while is_listed[unlisted]:
                    unlisted += 1
                order[at] = start if at == 0 else unlisted
                is_listed[order[at]] = True
                count += 1
            begin = count
            for k in range(first[order[at]], first[order[at] + 1]):
                other = near[k]
                if not is_listed[other]:
                    # Neighbours are listed by their numbers of pairs, sorted by insertion: they are few.
                    pairs, place = first[other + 1] - first[other], count
                    while place > begin and first[order[place - 1] + 1] - first[order[place - 1]] > pairs:
                        order[place] = order[place - 1]
                        place -= 1
                    order[place], is_listed[other] = other, True
                    count += 1
            widest = max(widest, count - 1 - at)
        if widest >= least:
            return narrowest
        narrowest, least, start = order, widest, order[-1]


def pair_form(
    order: Order, weight: Float64, coupling: Complex128 | None = None, held: float | Float64 = 0.0
) -> Band:
    """Return the form of pairs, sum w |x_j - c x_i|^2, factored: connection and ordinary Laplacians.

    Parameters
    ----------
    order : Order
        Of the nodes; i is the lower end of a pair, j the higher one.
    weight : (P,) float64
        The w of the pairs.
    coupling : (P,) complex128, optional
        The c of the pairs; by default 1, and the form is real.
    held : float or (N,) float64
        Added to the diagonal, so that a form with free motions can be factored.

    Raises
    ------
    numpy.linalg.LinAlgError
        If it is not definite, as weights are that are not finite.
    """
    n = len(order.nodes)
    band = np.zeros((order.width + 1, n), dtype=float if coupling is None else complex, order="F")
    band[0] = np.bincount(order.low, weight, n) + np.bincount(order.high, weight, n) + held
    band[order.high - order.low, order.low] = -weight if coupling is None else -weight * coupling
    return factored(band)


def factored(band: Band) -> Band:
    """Return the Cholesky factor of a band, which is overwritten.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the matrix is not positive definite.
    """
    factor: Band
    factor, failed = (zpbtrf if np.iscomplexobj(band) else dpbtrf)(band, lower=1, overwrite_ab=1)
    if failed:
        raise np.linalg.LinAlgError("the pairs of a shape have weights that are not finite")
    return factor


def solved(factor: Band, right: NDArray[Any]) -> NDArray[Any]:
    """Return the solutions (N, ...) by a factored band for right-hand sides."""
    found: NDArray[Any]
    found, _ = (zpbtrs if np.iscomplexobj(factor) else dpbtrs)(factor, right, lower=1)
    return found
