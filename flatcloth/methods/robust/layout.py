"""One piece of cloth on the plane: laid out from known nodes, or from one pair; then Eq. (2).

Minimising Eq. (2) from a poor start folds the sheet, so a new node is first laid out from its placed
neighbours, and the whole is relaxed as rigidly as possible. Pairs that contradict the others lose
their weight.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from flatcloth.core.types import Bool, Float32, Float64, Int32
from flatcloth.flattening.banded import Banding, banding
from flatcloth.flattening.minimisation import ENERGY_TOLERANCE, ITERATIONS, MOST_STEPS, ROBUST_STDS, minimise
from flatcloth.flattening.sampling import LEAST_INTERVAL_M
from flatcloth.methods.relaxation import local_rotations, relax_rigidly
from flatcloth.methods.robust.articulated import STILL_M, FlexibleSheet, settle_flexible
from flatcloth.methods.robust.connectivity import Links, both_ends, renumbered
from flatcloth.methods.robust.observations import Complex128

CONTRADICTED_WEIGHT = 0.25
"""Pairs of a smaller weight contradict the others: that of Geman and McClure at the scale. By definition."""
_ROUNDS = 2
"""Minimisations after each acceptance; the weights of the pairs are updated between them. Chosen for speed:
for what is shown they are updated until no node moves."""
_HALO = 2
"""Rows of nodes around new ones that are relaxed with them. Set by hand."""
_PRECISE = 1e-5
"""``ENERGY_TOLERANCE`` for what is shown. Chosen: wide parts turn about narrow ones with hardly any energy,
in trousers-waist-clean by 1 mm."""
MOST_DRIFT_M = 0.04
"""A pair that a layout misses by more than this contradicts it; the drift of a layout is 5 to 15 mm. Set by
hand."""

Int64 = NDArray[np.int64]


def seed_pair(z: Complex128, links: Links, within: Int64) -> None:
    """Place one pair, from which the rest of a piece is initialised."""
    seed = within[np.argmin(links.std_m[within])]
    z[links.edges[seed, 0]] = 0.0
    z[links.edges[seed, 1]] = links.offset[seed, 0]


def lay_out(z: Complex128, links: Links, inside: Int64) -> Complex128:
    """Place nodes (as u + iv) that pairs ``inside`` connect to placed nodes, layer by layer.

    A placed node has a known rotation if placed neighbours of the same view determine it. It then
    predicts the positions of its other neighbours in that view; several predictions are averaged.
    """
    has_place = np.isfinite(z.real)
    open_ = inside[~links.both_ends(has_place)[inside]]
    z = z.copy()
    if not open_.size:
        return z
    touched = np.zeros(links.n_members, dtype=bool)
    touched[links.member[open_]] = True
    members = links.member.take(inside, axis=0)
    near = inside[touched[members[:, 0]] | touched[members[:, 1]]]
    one, other = links.edges[near].T
    edges, offset = np.stack([one, other], axis=1), links.offset[near]
    which, member = renumbered(links.member[near])
    while True:
        at_one, at_other = has_place[one], has_place[other]
        both = (at_one & at_other).astype(np.float64)
        turn = local_rotations(z, edges, member, offset, both, which.size)
        led, place = [], []
        for end, says in ((0, at_one & ~at_other), (1, at_other & ~at_one)):
            e = np.flatnonzero(says)
            e = e[turn[member[e, end]] != 0]
            along = turn[member[e, end]] * offset[e, end]
            led.append(edges[e, 1 - end])
            place.append(z[edges[e, end]] + (along if end == 0 else -along))
        found, of_found = renumbered(np.concatenate(led))
        if not found.size:
            return z
        places = np.concatenate(place)
        sums = np.bincount(of_found, places.real) + 1j * np.bincount(of_found, places.imag)
        z[found] = sums / np.bincount(of_found)
        has_place[found] = True


def lay_pieces(z: Complex128, links: Links, inside: Int64, laid: Complex128, piece: Int32) -> Complex128:
    """Place pieces that have a layout of their own (as u + iv) where pairs lead to from placed nodes.

    A piece keeps its layout: nodes laid out again one after the other would lose the evidence of all its
    views, and could fold. Its rotation is that on which the pairs' directions, seen from both ends, agree in
    the mean; its shift is that of the places they predict.

    Parameters
    ----------
    z : (N,) complex128
        Positions of the placed nodes; NaN elsewhere.
    links, inside
        The pairs, and those that may be used.
    laid : (N,) complex128
        Positions of nodes, each piece on a plane of its own; NaN for nodes of none.
    piece : (N,) int32
        The piece of each node; -1 for none.
    """
    z = z.copy()
    edges, member, offset = links.edges[inside], links.member[inside], links.offset[inside]
    evidence, accuracy = links.evidence[inside], 1.0 / np.square(links.std_m[inside])
    waiting = np.isfinite(laid.real) & ~np.isfinite(z.real) & (piece >= 0)
    while waiting.any():
        placed = np.isfinite(z.real)
        across = (placed[edges] & waiting[edges][:, ::-1]).any(axis=1)
        pair = np.flatnonzero(across)
        if not pair.size:
            break
        there = np.where(waiting[edges[pair, 0]], 0, 1)
        joined = piece[edges[pair, there]]
        number = int(np.bincount(joined, evidence[pair]).argmax())
        own, pair, there = waiting & (piece == number), pair[joined == number], there[joined == number]
        waiting = waiting & ~own
        both = both_ends(placed, edges) | both_ends(own, edges)
        weight = np.where(both, accuracy, 0.0)
        turn = local_rotations(np.where(own, laid, z), edges, member, offset, weight, links.n_members)
        here, sign = 1 - there, np.where(there == 1, 1.0, -1.0)
        ahead = turn[member[pair, here]] * sign * offset[pair, here]
        back = turn[member[pair, there]] * -sign * offset[pair, there]
        known = (np.abs(ahead) > 0.0) & (np.abs(back) > 0.0)
        if not known.any():
            continue
        votes = evidence[pair] * known
        rotation = -(votes * ahead / np.maximum(np.abs(ahead), 1e-12) * np.conj(back)).sum()
        rotation /= max(abs(rotation), 1e-12)
        off = z[edges[pair, here]] + ahead - rotation * laid[edges[pair, there]]
        z[own] = rotation * laid[own] + (votes * off).sum() / votes.sum()
    return z


def grown_layout(
    n: int, edges: Int32, member: Int32, offset: Complex128, evidence: Float64, n_members: int
) -> Complex128:
    """Grow a layout of a piece from one pair: (n,), u + iv in metres, NaN for nodes that no edge reaches.

    The next node is always the one to which the most evidence leads from nodes that have a place, so
    doubtful pairs (seen once, or by noisy views) place nothing that others can place. A node's place is
    that on which the most evidence agrees.

    Parameters
    ----------
    n : int
        Number of nodes.
    edges, member, offset, n_members
        As in :class:`Links`.
    evidence : (M,) float64
        As in :func:`weakest_cut`.
    """
    ends = np.concatenate([edges[:, 0], edges[:, 1]])
    order = np.argsort(ends, kind="stable")
    first = np.searchsorted(ends[order], np.arange(n + 1))
    _, pair = np.unique(np.sort(edges, axis=1) @ np.array([n, 1]), return_inverse=True)
    together = np.bincount(pair, evidence)[pair]
    seed = int(edges[together.argmax(), 0])
    ends_by_node = _EdgeEnds(first, order)
    layout: Complex128 = _grow(
        edges, member, offset, evidence, n_members, ends_by_node, seed, LEAST_INTERVAL_M
    )
    return layout


class _EdgeEnds(NamedTuple):
    """The ends of the M edges, ``order``ed by node: k for the first end of edge k, M + k for the second.

    Those of node i are the entries ``first[i]`` to ``first[i + 1]``.
    """

    first: Int64
    order: Int64


@njit(cache=True, nogil=True)
def _grow(
    edges: Int32,
    member: Int32,
    offset: Complex128,
    evidence: Float64,
    n_members: int,
    ends: _EdgeEnds,
    seed: int,
    same_place_m: float,
) -> Complex128:
    """See :func:`grown_layout`."""
    first, order = ends
    m, n = edges.shape[0], first.size - 1
    z = np.full(n, complex(np.nan, np.nan))
    placed, leads = np.zeros(n, dtype=np.bool_), np.zeros(n)
    rotation = np.zeros(n_members, dtype=np.complex128)
    most = np.max(first[1:] - first[:-1])
    prediction, weight = np.empty(most, dtype=np.complex128), np.empty(most)
    node, count, waiting = seed, 0, [seed]
    while node >= 0:
        known = 0
        for s in range(first[node], first[node + 1]):
            e, end = order[s] % m, order[s] // m
            other = edges[e, 1 - end]
            if not placed[other]:
                continue
            turn = rotation[member[e, 1 - end]]
            if count == 1:
                turn = complex(1.0, 0.0)
            if abs(turn) > 0.0:
                along = offset[e, 1 - end] * turn / abs(turn)
                prediction[known] = z[other] + (along if end == 1 else -along)
                weight[known] = evidence[e]
                known += 1
        leads[node] = -1.0
        if count == 0:
            z[node] = complex(0.0, 0.0)
        elif known > 0:
            z[node] = _agreed(prediction[:known], weight[:known], same_place_m)
        if math.isfinite(z[node].real):
            placed[node] = True
            count += 1
            for s in range(first[node], first[node + 1]):
                e, end = order[s] % m, order[s] // m
                other = edges[e, 1 - end]
                if placed[other]:
                    along = z[edges[e, 1]] - z[edges[e, 0]]
                    if abs(abs(along) - abs(offset[e, 0])) < same_place_m:
                        for k in range(2):
                            rotation[member[e, k]] += evidence[e] * along * np.conj(offset[e, k])
                else:
                    if leads[other] <= 0.0:
                        waiting.append(other)
                    leads[other] = max(leads[other], 0.0) + evidence[e]
        node, strongest, kept = -1, 0.0, 0
        for other in waiting:
            if leads[other] > 0.0:  # it has no place yet, and was not tried in vain
                waiting[kept] = other
                kept += 1
                if leads[other] > strongest or (leads[other] == strongest and other < node):
                    node, strongest = other, leads[other]
        del waiting[kept:]
    return z


@njit(cache=True, nogil=True)
def _agreed(prediction: Complex128, weight: Float64, same_place_m: float) -> complex:
    """Return the mean of the predictions around the one with which the most weight agrees."""
    best, most = complex(0.0, 0.0), -1.0
    for a in range(prediction.size):
        total, place = 0.0, complex(0.0, 0.0)
        for b in range(prediction.size):
            if abs(prediction[a] - prediction[b]) < same_place_m:
                total += weight[b]
                place += weight[b] * prediction[b]
        if total > most:
            best, most = place / total, total
    return best


def minimise_piece(
    z: Complex128, links: Links, inside: Int64, weight: Float32 | Float64, *, precise: bool = False
) -> tuple[Float64, Float64]:
    """Return ``uv_m`` (all nodes; NaN off the piece) and the robust weights of the pairs ``inside``.

    If ``precise``, the places ``z`` are near the minimum, which is to be reached.
    """
    own, weight = np.flatnonzero(np.isfinite(z.real)), weight.astype(np.float64)
    place = np.full(len(z), -1, dtype=np.int32)
    place[own] = np.arange(own.size)
    edges = place[links.edges.take(inside, axis=0)]
    if not edges.size:
        return np.stack([z.real, z.imag], axis=1), weight
    length, std = links.length_m[inside], links.std_m[inside]
    member, offset = links.member.take(inside, axis=0), links.offset.take(inside, axis=0)
    accuracy = np.square(np.median(std) / std)
    which, pair = renumbered(links.pair.take(inside))
    once = place[links.once.take(which, axis=0)]
    narrow = replace(banding(own.size, once), pair=pair)
    if precise:  # relaxing would turn wide parts about narrow ones, away from the minimum
        x = np.stack([z.real[own], z.imag[own]], axis=1)
    else:
        stiff = accuracy * weight
        x = relax_rigidly(z[own], edges, member, offset, stiff, links.n_members, ITERATIONS, narrow)
    for _ in range(MOST_STEPS if precise else _ROUNDS):
        before = x
        x = _minimised(x, narrow, once, length, np.maximum(accuracy * weight, 1e-6), precise)
        residual = np.linalg.norm(x[once[:, 0]] - x[once[:, 1]], axis=1)[pair] - length
        weight = _robust_weight(residual / std)
        if np.abs(x - before).max() < STILL_M:
            break
    sheet = FlexibleSheet(
        edges=edges,
        once=once,
        member=member,
        n_members=links.n_members,
        length_m=length,
        weight=np.maximum(accuracy * weight, 1e-6),
        offset=offset,
    )
    uv = np.full((len(z), 2), np.nan)
    uv[own] = settle_flexible(x, sheet)
    return uv, weight


def misfit(uv_m: Float64, links: Links, inside: Int64) -> float:
    """Return the sum of the squared residuals of pairs ``inside``, in standard deviations.

    A residual counts as 3 at most. It counts as 3 if one end of the pair has no place.
    """
    apart_m = np.linalg.norm(np.diff(uv_m[links.edges[inside]], axis=1)[:, 0], axis=1)
    off = np.abs(apart_m - links.length_m[inside]) / links.std_m[inside]
    return float(np.square(np.fmin(off, 3.0)).sum())


def relax_around(
    z: Complex128, links: Links, inside: Int64, weight: Float32 | Float64, new: Bool
) -> tuple[Float64, Float64]:
    """Relax a piece around its ``new`` (N,) nodes only; all others keep their places.

    Parameters and results are those of :func:`minimise_piece`, of which this is the beginning. Eq. (2) is
    not minimised, and only pairs near the new nodes and those of the last view get other weights.
    """
    near = new.copy()
    for _ in range(_HALO):
        near[links.once[_either_end(near, links.once)]] = True
    is_near = _either_end(near, links.once)[links.pair.take(inside)]
    own, z, weight = np.flatnonzero(is_near), z.copy(), weight.astype(np.float64)
    if own.size:
        nodes, ends = renumbered(links.edges[inside[own]])
        which, pair = renumbered(links.pair[inside[own]])
        once = np.empty((which.size, 2), dtype=np.int32)
        once[pair] = ends
        members, member = renumbered(links.member[inside[own]])
        narrow = replace(banding(nodes.size, once), pair=pair)
        offset, std = links.offset[inside[own]], links.std_m[inside[own]]
        stiff = np.square(np.median(std) / std) * weight[own]
        moved = relax_rigidly(
            z[nodes], ends, member, offset, stiff, members.size, ITERATIONS, narrow, ~near[nodes]
        )
        z[nodes] = moved @ np.array([1.0, 1j])
    is_near[links.of_last_view(inside)] = True
    near_pairs = np.flatnonzero(is_near)
    if near_pairs.size:
        checked = inside[near_pairs]
        one, other = links.edges[checked].T
        residual = np.abs(z[one] - z[other]) - links.length_m[checked]
        weight[near_pairs] = _robust_weight(residual / links.std_m[checked])
    return np.stack([z.real, z.imag], axis=1), weight


def _either_end(flags: Bool, edges: Int32) -> Bool:
    return flags[edges[:, 0]] | flags[edges[:, 1]]


def _minimised(
    uv_m: Float64, narrow: Banding, once: Int32, length_m: Float64, weight: Float64, precise: bool
) -> Float64:
    """Minimise Eq. (2) over pairs (M,) that several views contribute; ``once`` (P, 2) are the unique ones.

    The observations of one pair in several views are one term with the mean length: it differs by a constant.
    """
    assert narrow.pair is not None
    total: Float64 = np.bincount(narrow.pair, weight).astype(np.float64)
    mean = np.bincount(narrow.pair, weight * length_m) / total
    spread = float((weight * np.square(length_m - mean[narrow.pair])).sum())
    return minimise(
        uv_m,
        once,
        mean,
        weight=total,
        majorisations=ITERATIONS,
        energy_tolerance=_PRECISE if precise else ENERGY_TOLERANCE,
        narrow=narrow,
        least_energy_m2=spread,
        most_steps=MOST_STEPS if precise else ITERATIONS,
    ).uv_m


def _robust_weight(normed: Float64) -> Float64:
    """Geman-McClure weights (Black and Rangarajan, 1996) of residuals in standard deviations."""
    scale = ROBUST_STDS * max(1.0, 1.4826 * float(np.median(np.abs(normed))))
    weight = np.square(normed * (1.0 / scale))
    weight += 1.0
    np.square(weight, out=weight)
    result: Float64 = np.reciprocal(weight, out=weight)
    return result
