"""The shape of a set of views, from nothing: the whole algorithm, a call a step.

Nodes are points of the cloth, shared by the views that see them; each view measures the lengths and
directions between neighbours. All views together are one graph of frames, whose layout on the plane minimises
Eq. (2) of the paper (lengths) and the directions. The result depends on the set of views and on what was
decided, not on the order of the views, nor on what was computed before. ``docs/robust.md`` explains it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import Bool, Complex128, Int32
from flatcloth.shape.deviations import LOST, deviations_m, ripples_of
from flatcloth.shape.graph import Graph, Links, graph_of, uv_of, view_frames
from flatcloth.shape.hand import ByHand, with_hands
from flatcloth.shape.joints import DecidedParts, doubt_m, seen_often
from flatcloth.shape.layout import Minimum, minimum, pairs_of, places, rotations
from flatcloth.shape.observations import Observed, PlacedView, observe_all, with_view
from flatcloth.shape.pieces import cut_of_overlap, pieces_of, with_main
from flatcloth.shape.shape import PIECES_APART_M, PLACE_STD_M, Shape


def shape(
    views: Sequence[PlacedView], interval_px: int, upright: int, by_hand: Sequence[ByHand] = ()
) -> Shape:
    """Return the shape of a set of views.

    Parameters
    ----------
    views : sequence of PlacedView
        All views, in an order that depends on nothing but the set.
    interval_px : int
        Sampling interval d of the nodes in the images.
    upright : int
        The ``view_index`` of the view that fixes the plane: its image's right is u.
    by_hand : sequence of ByHand
        Further views, which the operator laid one after the other; each on the shape with those before it.

    Raises
    ------
    FlatclothError
        If no view shows two places of cloth side by side.
    """
    # 1. Nodes: cloth at a place in space with a normal, found in all views; pairs as each view has them.
    seen = observe_all(views, interval_px)
    for laid in by_hand:
        seen = with_view(seen, laid.view, laid.shown, interval_px)
    if not seen.observations:
        raise FlatclothError("No view shows two places of cloth side by side; check depth and masks.")
    # 2. One graph of frames: all views of a pair are one pair, the surer the more views agree.
    graph, links = graph_of(seen.nodes, seen.observations, seen.object_from_camera)
    graph, links, vouched = with_hands(graph, links, seen.observations, by_hand)
    # 3. to 7. Its layout on the plane.
    found = laid_out(graph, np.ones(len(graph.pairs), dtype=np.bool_), vouched)
    return _shape(seen, graph, links, found, vouched, upright)


def as_decided(whole: Shape, parts: DecidedParts, upright: int) -> Shape:
    """Return a shape, laid out again, with each part that was taken off as a piece of its own.

    The joints of the parts that are kept are not doubted.
    """
    holds, (first, second) = whole.holds.copy(), whole.graph.pairs.T
    for part in parts.taken_off:
        holds &= part[first] == part[second]
    laid = laid_out(whole.graph, holds, whole.vouched)
    laid = replace(laid, piece=with_main(laid.piece, whole.placed, *parts.taken_off))
    return _shape(whole, whole.graph, whole.links, laid, whole.vouched, upright, whole.scale, parts.kept)


@dataclass(frozen=True, kw_only=True)
class LaidOut:
    """The layout of a graph: which pairs hold (P,), the piece (N,) of each node by size, -1 for none; the
    minimum, and places ``z`` and ``rotation`` (N,) complex in the order of the graph.
    """

    holds: Bool
    piece: Int32
    at: Minimum
    z: Complex128
    rotation: Complex128


def laid_out(graph: Graph, used: Bool, vouched: Bool | None = None, seams: Bool | None = None) -> LaidOut:
    """Lay out a graph, each piece of it somewhere on the plane.

    Parameters
    ----------
    graph : Graph
        Nodes and pairs.
    used : (P,) bool
        The pairs that may join cloth.
    vouched : (P,) bool, optional
        Pairs that the operator vouches for: none of them is taken for false, or cut.
    seams : (P,) bool, optional
        Pairs at seams of two sheets: none is taken for false. The sheets may lie on each other: no cut.
    """
    pairs, sure = pairs_of(graph), np.zeros(len(graph.pairs), dtype=np.bool_) if vouched is None else vouched
    kept = np.isin(np.arange(len(graph)), graph.pairs[sure])
    while True:
        # 3. Rotations, from nothing: the lowest eigenvector of a connection Laplacian. False links.
        rotation, weight = rotations(pairs, used, sure if seams is None else seams)
        # 4. Places, for known rotations. False links, by place.
        z, holds = places(pairs, rotation, weight, sure if seams is None else seams)
        # 5. Pieces: cloth that enough evidence joins.
        piece = pieces_of(graph, holds, sure)
        first, second = piece[graph.pairs].T
        holds &= (first == second) & (first >= 0)
        # 6. The minimum of lengths and directions.
        at, band = minimum(pairs, z, rotation, holds), np.argsort(pairs.order.nodes)
        laid = LaidOut(holds=holds, piece=piece, at=at, z=at.z[band], rotation=at.rotation[band])
        # 7. Cloth that lies on other cloth is joined by false pairs that agree: the weakest are cut.
        if seams is not None or not (cut := cut_of_overlap(graph, holds, piece, laid.z, kept) & ~sure).any():
            return laid
        used = used & ~cut


def _shape(
    seen: Observed | Shape,
    graph: Graph,
    links: Links,
    laid: LaidOut,
    vouched: Bool,
    upright: int,
    scale: float | None = None,
    kept: Sequence[Bool] = (),
) -> Shape:
    """Return a laid-out graph as a shape: every piece upright, at its place on the plane, with deviations."""
    piece, z = laid.piece, _upright(seen, laid, upright)
    # 8. A noisy sensor takes ripples off all lengths; one factor for all, as others would bend necks.
    ripples, main = np.zeros(len(graph)), piece == 0
    is_noisy = any(view.is_noisy for view in seen.observations)
    if is_noisy:
        ripples[main] = ripples_of(uv_of(z[main]), graph.xyz_m[main], seen.nodes.normal[main])
    if scale is None:
        scale = 1.0 + LOST * float(ripples[main].mean())
        links = replace(links, length_m=scale * links.length_m)
    uv_m = scale * uv_of(z)
    uv_m[:, 0] += PIECES_APART_M * np.maximum(piece, 0)
    uv_m[piece < 0] = np.nan
    # 9. Deviations: errors of pairs as smooth random fields, through the same equations. With a noisy sensor
    #    also what each node is off by itself, and what hangs on doubtful joints.
    std_m = deviations_m(laid.at, graph, np.where(main, 0, -1), ripples=ripples)
    if is_noisy:
        evidence = seen_often(np.where(laid.holds, graph.evidence, 0.0), graph.views)
        std_m = np.hypot(
            np.hypot(std_m, PLACE_STD_M),
            doubt_m(graph.pairs, evidence, laid.piece == 0, laid.z, kept=kept),
        )
    return Shape(
        nodes=seen.nodes,
        observations=seen.observations,
        object_from_camera=seen.object_from_camera,
        graph=graph,
        links=links,
        holds=laid.holds,
        piece=piece,
        all_uv_m=uv_m,
        std_m=std_m,
        vouched=vouched,
        scale=scale,
        kept=kept,
    )


def _upright(seen: Observed | Shape, laid: LaidOut, upright: int) -> Complex128:
    """Return the places (N,) with each piece turned upright, around the nodes that the same view shows.

    It is the view ``upright`` if it shows the piece, otherwise the one that shows most of it.
    """
    z = np.full(len(laid.z), np.nan + 0j)
    for number in range(int(laid.piece.max(initial=-1)) + 1):
        own = laid.piece == number
        shown = [own[view.node] * (1 + len(own) * (view.view_index == upright)) for view in seen.observations]
        best = int(np.argmax([each.sum() for each in shown]))
        view, at = seen.observations[best], own[seen.observations[best].node]
        node = view.node[at]
        right = laid.rotation[node] * view_frames(seen.nodes, view, seen.object_from_camera[best])[at]
        turn = np.conj(right.sum())
        z[own] = (laid.z[own] - laid.z[node].mean()) * turn / max(abs(turn), 1e-12)
    return z
