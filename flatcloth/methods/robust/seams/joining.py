"""Both sides of an item as one shape: the algorithm.

Nodes and pairs of the shapes of both stand in one graph, those of the other side mirrored. Each place where
rims meet is a node of its own, which pairs join to the cloth of both sides: it has one place on the plane, as
on a sewing pattern. All places then follow from one layout, as those of one side do.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from flatcloth.core.errors import FlatclothError
from flatcloth.core.geometry import fit_rigid2
from flatcloth.core.types import MIRROR, Bool, FlattenedView, Float64, Int32, Int64, LaidPiece
from flatcloth.flattening.borders import SPACING_M
from flatcloth.methods.answers import Ends, OtherJoint, Seam
from flatcloth.methods.robust.seams.links import (
    Matches,
    SeamLink,
    SideJoint,
    linked,
    matches_of,
    sets_of,
)
from flatcloth.methods.robust.seams.rims import rim_of
from flatcloth.session.garment import DecidedSeam
from flatcloth.shape.algorithm import LaidOut, laid_out
from flatcloth.shape.deviations import deviations_m
from flatcloth.shape.graph import Graph, merged, pairs_as_laid, pairs_within, rotations_at, uv_of, z_of
from flatcloth.shape.joints import WeakJoint, doubt_m, evidence_of, seen_often, weak_joints
from flatcloth.shape.observations import PAIR_INTERVALS
from flatcloth.shape.shape import PIECES_APART_M, PLACE_STD_M, Shape

_SEAM_EVIDENCE = 0.1
"""Evidence of each pair at a seam. Chosen: all pairs of the smallest set have what joins two pieces."""
CUT = "cut by the operator"


@dataclass(frozen=True, kw_only=True)
class JoinedSide:
    """The other side of an item, laid out together with this one.

    ``shape`` is on its own plane, seen from its own outside; with ``MIRROR`` it lies on the plane of this
    side if it ``is_related``: seams join its main piece to that of this side. The deviations of its nodes are
    relative to the main piece of this side, NaN if it is not related to that. ``matches`` are where rims
    meet, ``links`` their sets; ``laid`` the floating pieces of this side that seams join to its main piece.
    """

    shape: Shape
    matches: Matches
    links: tuple[SeamLink, ...]
    is_related: bool
    laid: tuple[LaidPiece, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Seamed:
    """Both sides joined along the seams, before floating pieces of this side are laid anywhere.

    ``both`` has the nodes of ``this``, of the ``other`` and of the places on seams, in this order; ``std_m``
    are the deviations of the nodes of each side; ``joining`` (K,) of the ``matches`` join. ``floating`` are
    the nodes of each floating piece of this side, as it is drawn; ``weak`` where cloth of the other side may
    hang falsely.
    """

    floating: tuple[Int64, ...]
    both: Both
    this: Shape
    other: Shape
    std_m: tuple[Float64, Float64]
    joining: Int64
    matches: Matches
    links: tuple[SeamLink, ...]
    weak: tuple[OtherJoint, ...]


def join_sides(
    this: Shape,
    other: Shape,
    pieces: tuple[Sequence[FlattenedView], Sequence[FlattenedView]],
    ends: tuple[Sequence[Ends], Sequence[Ends]],
    decided: Sequence[DecidedSeam] = (),
    check: Callable[[], None] = lambda: None,
) -> Seamed:
    """Join the shapes of both sides along the seams.

    Parameters
    ----------
    this, other : Shape
        This side and the other one, each on its own plane, seen from its own outside.
    pieces : two sequences of FlattenedView
        All pieces of each side, rasterised where their nodes lie.
    ends : two sequences of Ends
        Where the cloth of these pieces truly ends.
    decided : sequence of DecidedSeam
        The operator's decisions about seams.
    check : callable
        Called between the steps; what it raises ends them.
    """
    # 1. Where both sides truly end and their rims meet in space (rims.py).
    matches = matches_of(*map(rim_of, pieces, ends))
    # 2. Sets that agree on one motion; the other side taken apart where they contradict it (links.py).
    sets = with_decisions(sets_of(this, other, matches), matches, decided)
    other, matches, links, joints = linked(this, other, matches, sets, ends)
    true = [link for link in links if not link.why]
    joining = np.concatenate([np.zeros(0, dtype=np.int64), *(link.members for link in true)])
    link_of_seam = np.repeat(np.arange(len(true)), np.array([len(link.members) for link in true], dtype=int))
    known = np.isfinite(matches.other_uv_m[joining, 0])
    joining, link_of_seam = joining[known], link_of_seam[known]
    # 3. Both sides in one graph, the other mirrored, with a node for each place on a seam.
    mirrored = replace(other, all_uv_m=other.all_uv_m * MIRROR)
    graph = _one_graph(
        (this, mirrored),
        np.array([(link.this_piece, link.other_piece) for link in true], dtype=int).reshape(-1, 2)[
            link_of_seam
        ],
        matches.xyz_m[joining],
        (matches.this_uv_m[joining], matches.other_uv_m[joining] * MIRROR),
    )
    check()
    # 4. The layout of both sides (shape/layout.py), and its deviations from the main piece of this one.
    n, m = len(this.nodes), len(other.nodes)
    laid = laid_out(graph, np.ones(len(graph.pairs), dtype=np.bool_), seams=graph.pairs[:, 1] >= n + m)
    evidence = _doubted(graph, laid.holds, (n, m), link_of_seam, true, joints)
    both, joint_std_m, weak = _on_plane(this, graph, laid, evidence)
    std_m = _seams_std_m(this, other, true, link_of_seam, both)
    check()
    return Seamed(
        floating=tuple(nodes_on(this, piece) for piece in pieces[0][1:]),
        both=both,
        this=this,
        other=other,
        std_m=(np.hypot(std_m[0], joint_std_m[:n]), np.hypot(std_m[1], joint_std_m[n : n + m])),
        joining=joining,
        matches=matches,
        links=tuple(links),
        weak=tuple(
            OtherJoint(share=share, probability=1.0 - joint.false, evidence=joint.evidence)
            for joint in weak
            if (share := joint.part[n : n + m].sum() / max((both.piece[n : n + m] == 0).sum(), 1))
        ),
    )


def other_of(seamed: Seamed, laid: Sequence[LaidPiece] = ()) -> JoinedSide:
    """Return the other side on its own plane.

    ``laid`` are floating pieces of this side with a known place: what seams join to them has one, too.

    Raises
    ------
    FlatclothError
        If no cloth of the other side has a place.
    """
    # 5. What hangs on floating pieces with a known place; the other side again on its own plane.
    both, this, std_m = seamed.both, seamed.this, [each.copy() for each in seamed.std_m]
    laid_before = joined_pieces(both, seamed.floating)
    for known in laid:
        both = with_laid(both, this, seamed.floating[known.index], known, std_m)
    joined_now = set(joined_pieces(both, seamed.floating)) - {known.index for known in laid}
    found = tuple(
        laid_piece(both, this, seamed.floating[k], k, std_m[0]) for k in sorted(joined_now.union(laid_before))
    )
    n, m = len(this.nodes), len(seamed.other.nodes)
    own, on_seams = np.s_[n : n + m], np.s_[n + m :]
    piece = both.piece[own]
    if not (piece >= 0).any():
        raise FlatclothError("too little cloth of the other side hangs together.")
    is_related = bool((piece == 0).any())
    if not is_related and (piece > 0).any():  # its largest piece is the main one, on a plane of its own
        piece = np.where(piece == np.bincount(piece[piece > 0]).argmax(), 0, piece)
    # The joint layout may move this side at a seam: that distance is added at what lies nearest to it.
    seam = np.flatnonzero((both.piece[on_seams] == 0) & (seamed.matches.pieces[seamed.joining, 0] == 0))
    if seam.size:
        at = both.all_uv_m[on_seams][seam]
        shift_m = np.linalg.norm(at - seamed.matches.this_uv_m[seamed.joining[seam]], axis=1)
        nearest = cKDTree(at).query(np.nan_to_num(both.all_uv_m[own]))[1]
        std_m[1] = np.hypot(std_m[1], shift_m[nearest])
    shape = replace(
        seamed.other,
        piece=piece,
        all_uv_m=both.all_uv_m[own] * MIRROR,
        std_m=std_m[1] if is_related else np.full(m, np.nan),
    )
    return JoinedSide(
        shape=shape,
        matches=_moved(seamed.matches, seamed.links, seamed.other, shape),
        links=seamed.links,
        is_related=is_related,
        laid=found,
    )


def with_decisions(
    links: Sequence[SeamLink], matches: Matches, decided: Sequence[DecidedSeam]
) -> list[SeamLink]:
    """Return the sets as they were decided: those cut join nothing, those kept come first.

    The places of a decision are those of a set if at least half of them are within two spacings of it: the
    shape may have changed since. Of several decisions about a set, the last one counts.
    """
    found = list(links)
    trees = [cKDTree(matches.xyz_m[link.members]) for link in found]
    for seam in decided if found else ():
        off_m = np.array([tree.query(np.array(seam.points_m))[0] for tree in trees])
        near = (off_m < 2 * SPACING_M).mean(axis=1)
        best = int(near.argmax())
        if near[best] >= 0.5:
            found[best] = replace(found[best], is_kept=seam.kept, why="" if seam.kept else CUT)
    return sorted(found, key=lambda link: not link.is_kept)


def _seams_std_m(
    this: Shape, other: Shape, links: Sequence[SeamLink], link_of_seam: Int64, both: Both
) -> list[Float64]:
    """Return what the largest sets leave open of the places of each side's nodes, from piece to piece.

    The residuals of a set are not independent: each pair of pieces is joined by one place and one direction,
    known to ``PLACE_STD_M`` over the extent of its sets.
    """
    n, first = len(this.nodes), int(this.piece.max()) + 1
    piece = np.concatenate([this.piece, np.where(other.piece >= 0, other.piece + first, -1)])
    uv, at_seams = both.all_uv_m[: len(piece)], both.all_uv_m[len(piece) :]
    group = np.where(np.isfinite(uv[:, 0]), piece, -1)  # of each node: the pieces that sets join to one
    ends = np.array([(link.this_piece, link.other_piece + first) for link in links]).reshape(-1, 2)
    joined, which, size = np.unique(ends[link_of_seam], axis=0, return_inverse=True, return_counts=True)
    variance_m2 = np.zeros(len(piece))
    for k in np.argsort(-size, kind="stable").tolist():
        seam = at_seams[which.ravel() == k]
        seam = seam[np.isfinite(seam[:, 0])]
        numbers = sorted({int(group[piece == end].max(initial=-1)) for end in joined[k]})
        if len(numbers) < 2 or numbers[0] < 0 or not len(seam):
            continue
        # The group with the smaller number stays where it lies: this side's main piece is 0.
        stays, moves = (np.flatnonzero(group == number) for number in numbers)
        its_m2 = variance_m2[stays[cKDTree(uv[stays]).query(seam)[1]]].mean()
        away_m2 = np.square(uv[moves] - seam.mean(axis=0)).sum(axis=1) / seam.var(axis=0).sum()
        variance_m2[moves] += its_m2 + PLACE_STD_M**2 * (1.0 + away_m2)
        group[moves] = numbers[0]
    return np.split(np.sqrt(variance_m2), [n])


def _one_graph(
    sides: tuple[Shape, Shape],
    piece_of_seam: Int64,
    seams_xyz_m: Float64,
    places: tuple[Float64, Float64],
) -> Graph:
    """Return both sides as one graph; ``places`` (K, 2) are those of the seams on each one's plane.

    ``piece_of_seam`` (K, 2) are the pieces that each seam joins: it holds them as they lie.
    """
    this, mirrored = sides
    n, m = len(this.nodes), len(mirrored.nodes)
    own, its = _own_graph(this), _own_graph(mirrored)
    its = replace(its, pairs=its.pairs + np.int32(n), offset_m=-np.conj(its.offset_m))
    parts = [own, its]
    for side, (shape, graph, first) in enumerate(((this, own, 0), (mirrored, its, n))):
        z = np.full(n + m + len(seams_xyz_m), np.nan + 0j)
        z[first : first + len(shape.nodes)] = z_of(shape.all_uv_m)
        z[n + m :] = z_of(places[side])
        rotation = np.ones(len(z), dtype=complex)
        rotation[: n + m] = rotations_at(graph, z[: n + m])
        reach_m = PAIR_INTERVALS * float(np.median(graph.length_m))
        for piece in np.unique(piece_of_seam[:, side]).tolist():
            seam = np.flatnonzero(piece_of_seam[:, side] == piece)
            node = np.flatnonzero(shape.has_place & (shape.piece == piece))
            near_seam, near = pairs_within(places[side][seam], shape.all_uv_m[node], reach_m)
            pairs = np.stack([first + node[near], n + m + seam[near_seam]], axis=1)
            parts.append(pairs_as_laid(graph, pairs, z, rotation, PLACE_STD_M, _SEAM_EVIDENCE))
    return merged(parts, np.concatenate([this.nodes.xyz_m, mirrored.nodes.xyz_m, seams_xyz_m]))[0]


def _own_graph(shape: Shape) -> Graph:
    """Return the pairs of a side that hold, at the scale of its layout.

    Nodes that a side by itself could not place would join what it keeps apart.
    """
    graph = shape.graph
    used = shape.holds & shape.has_place[graph.pairs].all(axis=1)
    return replace(
        graph,
        pairs=graph.pairs[used],
        length_m=shape.scale * graph.length_m[used],
        offset_m=shape.scale * graph.offset_m[used],
        variance_m2=graph.variance_m2[used],
        evidence=graph.evidence[used],
        views=graph.views[used],
    )


def _doubted(
    graph: Graph,
    holds: Bool,
    nodes: tuple[int, int],
    link_of_seam: Int64,
    links: Sequence[SeamLink],
    joints: Sequence[SideJoint],
) -> Float64:
    """Return the evidence of the pairs (P,) of both sides: of seams and of joints as probable as they are."""
    evidence = seen_often(np.where(holds, graph.evidence, 0.0), graph.views)
    first, second = graph.pairs.T
    n, m = nodes
    number = np.full(len(second), -1)
    number[second >= n + m] = link_of_seam[second[second >= n + m] - n - m]

    def joined(pairs: Bool, false: float, *, at_most: bool) -> None:
        total, wanted = evidence[pairs].sum(), evidence_of(false)
        if total > 0.0 and not (at_most and wanted >= total):
            evidence[pairs] = np.maximum(evidence[pairs] * wanted / total, 1e-9)

    for k, link in enumerate(links):
        for is_this in (True, False):
            joined((number == k) & ((first < n) == is_this) & holds, 1.0 - link.probability, at_most=False)
    for joint in joints:
        at, begin = (n, 0) if joint.side == 0 else (m, n)
        inside = holds & (first >= begin) & (second < begin + at)
        part = joint.part[np.clip(graph.pairs - begin, 0, at - 1)]
        joined(inside & (part[:, 0] != part[:, 1]), joint.false, at_most=True)
    return evidence


def _on_plane(
    this: Shape, graph: Graph, laid: LaidOut, evidence: Float64
) -> tuple[Both, Float64, list[WeakJoint]]:
    """Return the layout of both sides on the plane of this one, the deviations (N,) of their nodes, and the
    weak joints of the main piece.

    The main piece is that of this side, where a floating one is larger. ``evidence`` is of :func:`_doubted`.
    Deviations are relative to the nodes of this side's main piece, or of its floating ones in each piece.
    """
    n = len(this.nodes)
    piece, uv = laid.piece.copy(), uv_of(laid.z)
    own = np.flatnonzero((this.piece == 0) & (piece[:n] >= 0))
    main = int(np.bincount(piece[own]).argmax())
    piece[laid.piece == main], piece[laid.piece == 0] = 0, main
    own = own[piece[own] == 0]
    motion = fit_rigid2(uv[own], this.all_uv_m[own])
    for number in range(int(piece.max()) + 1):
        at = piece == number
        uv[at] = (
            motion.apply(uv[at])
            if number == 0
            else uv[at] - uv[at].mean(axis=0) + (PIECES_APART_M * number, 0.0)
        )
    uv[piece < 0] = np.nan
    reference = np.zeros(len(graph), dtype=np.bool_)
    reference[:n] = piece[:n] > 0
    reference[own] = True
    kept = [np.pad(part, (0, len(graph) - n)) for part in this.kept]
    std_m, weak = deviations_m(laid.at, graph, piece, reference), list[WeakJoint]()
    if any(view.is_noisy for view in this.observations):
        std_m = np.hypot(std_m, PLACE_STD_M)
        for number in np.unique(piece[reference]).tolist():
            doubt = doubt_m(graph.pairs, evidence, piece == number, laid.z, reference, kept)
            std_m = np.hypot(std_m, doubt)
        weak = weak_joints(graph.pairs, evidence, piece == 0, reference, kept)
    return Both(all_uv_m=uv, piece=piece), std_m, weak


def _moved(matches: Matches, links: Sequence[SeamLink], before: Shape, now: Shape) -> Matches:
    """Return the matches at their places on the present plane of the other side, piece by piece."""
    uv = np.full_like(matches.other_uv_m, np.nan)
    for link in links:
        own = np.flatnonzero((before.piece == link.other_piece) & now.has_place & before.has_place)
        if own.size > 2:
            motion = fit_rigid2(before.all_uv_m[own], now.all_uv_m[own])
            uv[link.members] = motion.apply(matches.other_uv_m[link.members])
    return replace(matches, other_uv_m=uv)


def seams_of(joined: JoinedSide, pieces: Sequence[FlattenedView]) -> tuple[Seam, ...]:
    """Return the sets of matches as seams, at their places on the present planes.

    ``pieces`` are the other side's canonical view and its floating pieces, which joining may have changed.
    A set on cloth that is too small to be one of them joins nothing that is shown, and is left out.
    """
    matches, found = joined.matches, []
    cloth = [cKDTree(piece.uv_from_rc(np.argwhere(piece.valid))) for piece in pieces]
    for link in joined.links:
        has_place = np.isfinite(matches.other_uv_m[link.members, 0])
        own = link.members[has_place] if has_place.any() else link.members
        there = np.nan_to_num(matches.other_uv_m[own])
        away_m = [float(np.median(tree.query(there)[0])) for tree in cloth]
        if min(away_m) > 0.5 * PIECES_APART_M:
            continue  # the nearest cloth is another piece
        found.append(
            Seam(
                this_piece=int(np.bincount(matches.pieces[own, 0]).argmax()),
                other_piece=int(np.argmin(away_m)),
                this_uv_m=matches.this_uv_m[own],
                other_uv_m=matches.other_uv_m[own],
                xyz_m=matches.xyz_m[own],
                views=matches.views[own],
                residual_m=matches.misfit_m(own, matches.motion(own)),
                why=link.why,
                probability=link.probability,
                decided="keep" if link.is_kept else "cut" if link.why == CUT else None,
            )
        )
    return tuple(found)


# --- floating pieces of this side ------------------------------------------------------------------


MOST_STD_M = 0.034
"""A piece whose deviation is larger has no place that anything determines. Set by hand."""


@dataclass(frozen=True, kw_only=True)
class Both:
    """Both sides on one plane: places ``all_uv_m`` (N, 2) of the nodes of this side, of the other, and of
    seams.

    ``piece`` (N,) int32 is the piece of each, 0 for that of this side's main piece, -1 for none.
    """

    all_uv_m: Float64
    piece: Int32


def nodes_on(shape: Shape, piece: FlattenedView) -> Int64:
    """Return the nodes of a shape that lie on the cloth of a piece of it, as it is drawn."""
    placed = np.flatnonzero(shape.has_place)
    rc = np.rint(piece.rc_from_uv(shape.all_uv_m[placed])).astype(np.int64)
    kept = ((rc >= 0) & (rc < piece.shape)).all(axis=1)
    on_cloth: Int64 = placed[kept][piece.valid[tuple(rc[kept].T)]]
    return on_cloth


def joined_pieces(both: Both, floating: Sequence[Int64]) -> list[int]:
    """Return those of the floating pieces of this side, by index, that are in the main piece of both.

    ``floating`` are the nodes of each.
    """
    return [k for k, own in enumerate(floating) if own.size > 2 and (both.piece[own] == 0).mean() > 0.5]


def laid_piece(both: Both, this: Shape, nodes: Int64, index: int, std_m: Float64) -> LaidPiece:
    """Return a floating piece of this side where the main piece of both sides lays it."""
    own = nodes[both.piece[nodes] == 0]
    return LaidPiece(
        index=index,
        shape_from_piece=fit_rigid2(this.all_uv_m[own], both.all_uv_m[own]),
        std_m=float(np.sqrt(np.square(std_m[own]).mean())),
    )


def with_laid(both: Both, this: Shape, nodes: Int64, piece: LaidPiece, std_m: Sequence[Float64]) -> Both:
    """Return both sides with a floating piece of this side, and what seams join to it, at a known place.

    ``nodes`` are those of the piece. Its standard deviation is added to those of the nodes (N,) of this side
    and (M,) of the other one.
    """
    own, n = nodes[both.piece[nodes] > 0], len(this.nodes)
    if not own.size:
        return both  # seams join it to the shape
    group = both.piece == np.bincount(both.piece[own]).argmax()
    motion = fit_rigid2(both.all_uv_m[own], piece.shape_from_piece.apply(this.all_uv_m[own]))
    uv = both.all_uv_m.copy()
    uv[group] = motion.apply(uv[group])
    for side, begin in zip(std_m, (0, n), strict=True):
        moved = group[begin : begin + len(side)]
        side[moved] = np.hypot(np.nan_to_num(side[moved]), piece.std_m)
    return replace(both, all_uv_m=uv, piece=np.where(group, 0, both.piece).astype(np.int32))
