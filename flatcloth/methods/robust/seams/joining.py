"""Both sides of an item as one shape: the algorithm.

Nodes and pairs of the two joint shapes stand in one list, those of the other side mirrored. Each place where
rims meet is a node of its own, which pairs join to the cloth of both sides: it has one place on the plane, as
on a sewing pattern. All positions then follow from Eq. (2) over both sides, as those of one side do.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from flatcloth.core.errors import FlatclothError
from flatcloth.core.geometry import fit_rigid2
from flatcloth.core.types import MIRROR, Bool, FlattenedView, Float64, Int64, LaidPiece
from flatcloth.methods.answers import Ends, Seam
from flatcloth.methods.robust.connectivity import Links, both_ends, pairs_once
from flatcloth.methods.robust.joint import flatten_jointly
from flatcloth.methods.robust.joint_shape import PIECES_APART_M, JointShape
from flatcloth.methods.robust.layout import MOST_DRIFT_M
from flatcloth.methods.robust.observations import PAIR_INTERVALS, Nodes
from flatcloth.methods.robust.scoring import PLACE_STD_M
from flatcloth.methods.robust.seams.decisions import CUT, with_decisions
from flatcloth.methods.robust.seams.laying import joined_pieces, laid_piece, nodes_on, with_laid
from flatcloth.methods.robust.seams.links import (
    Matches,
    SeamLink,
    linked,
    matches_of,
    motion_onto,
    sets_of,
)
from flatcloth.methods.robust.uncertainty import (
    MOST_STD_M,
    placement_std_m,
    strain_by_ripples,
    undetermined,
)
from flatcloth.session.garment import DecidedSeam

_SEAM_EVIDENCE = 0.1
"""Evidence of each pair at a seam. Chosen: the 30 matches that join pieces have more than joins any two."""
_TO_COMPLEX = np.array([1.0, 1j])
"""From (u, v) to u + iv. By definition."""


@dataclass(frozen=True, kw_only=True)
class JoinedSide:
    """The other side of an item, laid out together with this one.

    ``shape`` is on its own plane, seen from its own outside; with ``MIRROR`` it lies on the plane of this
    side if it ``is_related``: seams join its main piece to that of this side. ``std_m`` (N,) are the standard
    deviations of its nodes relative to the main piece of this side, NaN if it is not related to that;
    ``unreliable`` (N,) are the nodes not determined.
    ``matches`` are where rims meet, ``links`` their sets; ``laid`` the floating pieces of
    this side that seams join to its main piece.
    """

    shape: JointShape
    std_m: Float64
    unreliable: Bool
    matches: Matches
    links: tuple[SeamLink, ...]
    is_related: bool
    laid: tuple[LaidPiece, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Seamed:
    """Both sides joined along the seams, before floating pieces of this side are laid anywhere.

    ``both`` has the nodes of ``this``, of the ``other`` and of the places on seams, in this order;
    ``std_m`` are the deviations of the nodes of each side; ``joining`` (K,) of the ``matches`` join.
    ``floating`` are the nodes of each floating piece of this side, as it is drawn.
    """

    floating: tuple[Int64, ...]
    both: JointShape
    this: JointShape
    other: JointShape
    std_m: tuple[Float64, Float64]
    joining: Int64
    matches: Matches
    links: tuple[SeamLink, ...]


def join_sides(
    this: JointShape,
    other: JointShape,
    pieces: tuple[Sequence[FlattenedView], Sequence[FlattenedView]],
    ends: tuple[Sequence[Ends], Sequence[Ends]],
    held_point_m: Float64,
    decided: Sequence[DecidedSeam] = (),
    check: Callable[[], None] = lambda: None,
) -> Seamed:
    """Join the settled shapes of both sides along the seams.

    Parameters
    ----------
    this, other : JointShape
        This side and the other one, each on its own plane, seen from its own outside.
    pieces : two sequences of FlattenedView
        All pieces of each side, rasterised where their nodes lie.
    ends : two sequences of Ends
        Where the cloth of these pieces truly ends.
    held_point_m : (3,) float64
        Held point, object frame.
    decided : sequence of DecidedSeam
        The operator's decisions about seams.
    check : callable
        Called between the steps; what it raises ends them.
    """
    matches = matches_of(*pieces)  # 1. where the rims of both sides meet in space (rims.py)
    # 2. Sets that agree on one motion; the other side taken apart where they contradict it (links.py).
    sets = with_decisions(sets_of(this, other, matches), matches, decided)
    other, matches, links = linked(this, other, matches, sets, ends)
    joining = np.concatenate(
        [link.members for link in links if not link.why] or [np.zeros(0, dtype=np.int64)]
    )
    joining = joining[np.isfinite(matches.other_uv_m[joining, 0])]
    # 3. Poses of all pieces by the largest sets; one shape, with a node for each place on a seam.
    own, mirrored, places, std_m = _posed(this, other, matches, links)
    both = _one_shape(own, mirrored, matches.chosen(joining), (places[0][joining], places[1][joining]))
    check()
    # 4. Eq. (2) over both sides (joint.py).
    both = _with_main_of(this, flatten_jointly(both, most_cut=None, precise=True))
    check()
    joint_std_m, n = placement_std_m(both, held_point_m), len(this.nodes)
    return Seamed(
        floating=tuple(nodes_on(this, piece) for piece in pieces[0][1:]),
        both=both,
        this=this,
        other=other,
        std_m=(
            np.hypot(std_m[0], joint_std_m[:n]),
            np.hypot(std_m[1], joint_std_m[n : n + len(other.nodes)]),
        ),
        joining=joining,
        matches=matches,
        links=tuple(links),
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
    laid_before = joined_pieces(both, this, seamed.floating, std_m[0])
    for piece in laid:
        both = with_laid(both, this, seamed.floating[piece.index], piece, std_m)
    joined_now = set(joined_pieces(both, this, seamed.floating, std_m[0])) - {piece.index for piece in laid}
    found = tuple(
        laid_piece(both, this, seamed.floating[k], k, std_m[0]) for k in sorted(joined_now.union(laid_before))
    )
    joined = _other_of(both, this, seamed.other, std_m[1], seamed.joining, seamed.matches, seamed.links)
    return replace(joined, laid=found)


def _posed(
    this: JointShape, other: JointShape, matches: Matches, links: Sequence[SeamLink]
) -> tuple[JointShape, JointShape, tuple[Float64, Float64], list[Float64]]:
    """Move the pieces of both sides to where the largest sets of matches lead, and number them by group.

    The other side is returned mirrored, on the plane of this side, with the places of the matches on both,
    and the standard deviations that the motions give to the nodes of each side. The residuals of a set are
    not independent: each set counts as one place and one direction, known to ``PLACE_STD_M`` over its extent.
    """
    uv = [this.all_uv_m.copy(), other.all_uv_m * MIRROR]
    variance = [np.zeros(len(this.nodes)), np.zeros(len(other.nodes))]
    first = int(this.piece.max()) + 1
    number = [this.piece.copy(), np.where(other.piece >= 0, other.piece + first, -1).astype(np.int32)]
    uv[1][:, 0] -= PIECES_APART_M * first
    members: dict[tuple[int, int], list[Int64]] = {}
    for link in links:
        if not link.why:
            members.setdefault((link.this_piece, link.other_piece), []).append(link.members)
    places = [matches.this_uv_m.copy(), matches.other_uv_m * MIRROR - (PIECES_APART_M * first, 0.0)]
    of_match = [np.full(len(matches), -1), np.full(len(matches), -1)]
    for ends, sets in members.items():
        for side, end, begin in ((0, ends[0], 0), (1, ends[1], first)):
            of_match[side][np.concatenate(sets)] = end + begin
    for sets in sorted(members.values(), key=lambda sets: -sum(map(len, sets))):
        own = np.concatenate(sets)
        own = own[np.isfinite(places[1][own, 0])]
        groups = [int(of_match[side][own[0]]) for side in (0, 1)]
        if groups[0] == groups[1]:
            continue
        # The group with the smaller number stays where it lies: this side's main piece is 0.
        stays, moves = (0, 1) if groups[0] < groups[1] else (1, 0)
        motion = motion_onto(places[moves][own], places[stays][own])
        there = np.flatnonzero(number[stays] == groups[stays])
        its_variance = variance[stays][there[cKDTree(uv[stays][there]).query(places[stays][own])[1]]].mean()
        middle, extent_m2 = places[stays][own].mean(axis=0), places[stays][own].var(axis=0).sum()
        for side in (0, 1):
            moved = number[side] == groups[moves]
            uv[side][moved] = motion.apply(uv[side][moved])
            away_m2 = np.square(uv[side][moved] - middle).sum(axis=1)
            variance[side][moved] += its_variance + PLACE_STD_M**2 * (1.0 + away_m2 / extent_m2)
            number[side][moved] = groups[stays]
            moved = of_match[side] == groups[moves]
            places[side][moved] = motion.apply(places[side][moved])
            of_match[side][moved] = groups[stays]
    posed = replace(this, all_uv_m=uv[0], piece=number[0]), replace(other, all_uv_m=uv[1], piece=number[1])
    return *posed, (places[0], places[1]), [np.sqrt(each) for each in variance]


def _one_shape(
    this: JointShape, mirrored: JointShape, seams: Matches, places: tuple[Float64, Float64]
) -> JointShape:
    """Return both sides, which lie on one plane, as one shape; ``places`` are those of the seams on each."""
    n, m, count = len(this.nodes), len(mirrored.nodes), len(seams)
    turned = replace(
        mirrored.links, edges=mirrored.links.edges + np.int32(n), offset=-np.conj(mirrored.links.offset)
    )
    own, its = _pairs_at(this, places[0], 0, n + m), _pairs_at(mirrored, places[1], n, n + m)
    placed = np.flatnonzero(this.has_place & (this.piece >= 0))
    at = placed[cKDTree(this.all_uv_m[placed]).query(places[0])[1]]
    links = _listed((this.links, turned, own, its), n + m + count)
    uv = np.concatenate([this.all_uv_m, mirrored.all_uv_m, places[0]])
    new = np.ones(len(own.edges) + len(its.edges), dtype=np.float32)
    weight = np.concatenate([this.weight, mirrored.weight, new])
    apart_m = np.linalg.norm(uv[links.edges[:, 0]] - uv[links.edges[:, 1]], axis=1)
    weight[len(this.weight) + len(mirrored.weight) :][
        np.abs(apart_m - links.length_m)[len(this.weight) + len(mirrored.weight) :] > MOST_DRIFT_M
    ] = 0.0
    return JointShape(
        nodes=Nodes(
            xyz_m=np.concatenate([this.nodes.xyz_m, mirrored.nodes.xyz_m, seams.xyz_m]),
            normal=np.concatenate([this.nodes.normal, mirrored.nodes.normal, this.nodes.normal[at]]),
            weight=np.concatenate([this.nodes.weight, mirrored.nodes.weight, np.ones(count)]),
        ),
        observations=(
            *this.observations,
            *(replace(seen, node=seen.node + np.int32(n)) for seen in mirrored.observations),
        ),
        object_from_camera=(*this.object_from_camera, *mirrored.object_from_camera),
        links=links,
        piece=np.concatenate([this.piece, mirrored.piece, this.piece[at]]).astype(np.int32),
        all_uv_m=uv,
        anchor=this.anchor,
        anchor_uv_m=this.anchor_uv_m,
        weight=weight,
        # Nodes that a side by itself could not place would join what it keeps apart.
        is_cut=np.concatenate(
            [_unused(this), _unused(mirrored), np.zeros(len(own.edges) + len(its.edges), dtype=np.bool_)]
        ),
        by_hand=np.concatenate([this.by_hand, mirrored.by_hand, np.zeros(count, dtype=np.bool_)]),
    )


def _with_main_of(this: JointShape, both: JointShape) -> JointShape:
    """Return both sides with the main piece of this side as theirs, where a floating one is larger."""
    own = np.flatnonzero((this.piece == 0) & (both.piece[: len(this.nodes)] >= 0))
    main = int(np.bincount(both.piece[own]).argmax())
    if main == 0:
        return both
    uv, piece = both.all_uv_m.copy(), both.piece.copy()
    own = own[both.piece[own] == main]
    motion = fit_rigid2(uv[own], this.all_uv_m[own])
    larger, is_main = both.piece == 0, both.piece == main
    uv[larger] += (PIECES_APART_M * main, 0.0) - uv[larger].mean(axis=0)
    uv[is_main] = motion.apply(uv[is_main])
    piece[larger], piece[is_main] = main, 0
    return replace(both, all_uv_m=uv, piece=piece)


def _unused(shape: JointShape) -> Bool:
    """Return which pairs (M,) of a side are cut, or have an end without a place."""
    unused: Bool = shape.is_cut | ~shape.links.both_ends(shape.has_place & (shape.piece >= 0))
    return unused


def _pairs_at(shape: JointShape, seam_uv_m: Float64, first_node: int, first_seam: int) -> Links:
    """Return the pairs between places (K, 2) on seams and the cloth of one side around them.

    They are those of one more view that sees only the rim: lengths and directions as the side lies.
    Its nodes are numbered from ``first_node``, the places from ``first_seam``.
    """
    placed = np.flatnonzero(shape.has_place & (shape.piece >= 0))
    reach_m = PAIR_INTERVALS * float(np.median(shape.links.length_m))
    tree = cKDTree(shape.all_uv_m[placed])
    near = np.unique(np.concatenate([[], *tree.query_ball_point(seam_uv_m, reach_m)]).astype(np.int64))
    uv = np.concatenate([shape.all_uv_m[placed[near]], seam_uv_m])
    node = np.concatenate([first_node + placed[near], first_seam + np.arange(len(seam_uv_m))])
    pairs = cKDTree(uv).query_pairs(reach_m, output_type="ndarray")
    # Nodes that are near on the plane need not be joined: only the side's own pairs count. Those that are
    # cut or join two of its pieces, which lie metres apart, have no length here.
    number = np.full(len(shape.nodes), -1, dtype=np.int64)
    number[placed[near]] = np.arange(near.size)
    once = shape.links.once[np.unique(shape.links.pair[~shape.is_cut])]
    once = once[np.ptp(shape.piece[once], axis=1) == 0]
    joined = number[once[both_ends(number >= 0, once)]]
    pairs = np.concatenate([pairs[(pairs >= near.size).any(axis=1)], joined])
    along = uv[pairs[:, 1]] - uv[pairs[:, 0]]
    length_m = np.linalg.norm(along, axis=1)
    is_pair = length_m > 1e-6
    pairs, along, length_m = pairs[is_pair], along[is_pair], length_m[is_pair]
    return Links(
        edges=node[pairs].astype(np.int32),
        member=pairs.astype(np.int32),
        n_members=len(uv),
        length_m=length_m,
        std_m=np.full(len(pairs), PLACE_STD_M),
        evidence=np.full(len(pairs), _SEAM_EVIDENCE),
        offset=np.repeat((along @ _TO_COMPLEX)[:, None], 2, axis=1),
        observation=np.zeros(len(pairs), dtype=np.int32),
        once=np.zeros((0, 2), dtype=np.int32),
        pair=np.zeros(0, dtype=np.int32),
    )


def _listed(parts: Sequence[Links], n: int) -> Links:
    """Return several lists of pairs of ``n`` nodes as one, each after the views of those before it."""
    members = np.cumsum([0, *(part.n_members for part in parts)])
    views = np.cumsum([0, *(int(part.observation.max(initial=-1)) + 1 for part in parts)])
    edges = np.concatenate([part.edges for part in parts])
    first, pair = pairs_once(n, edges)
    return Links(
        edges=edges,
        member=np.concatenate([p.member + np.int32(b) for p, b in zip(parts, members, strict=False)]),
        n_members=int(members[-1]),
        length_m=np.concatenate([part.length_m for part in parts]),
        std_m=np.concatenate([part.std_m for part in parts]),
        evidence=np.concatenate([part.evidence for part in parts]),
        offset=np.concatenate([part.offset for part in parts]),
        observation=np.concatenate([p.observation + np.int32(b) for p, b in zip(parts, views, strict=False)]),
        once=np.sort(edges[first], axis=1),
        pair=pair,
    )


def _other_of(
    both: JointShape,
    this: JointShape,
    other: JointShape,
    other_std_m: Float64,
    joining: Int64,
    matches: Matches,
    links: Sequence[SeamLink],
) -> JoinedSide:
    n, m = len(this.nodes), len(other.nodes)
    own, pairs = np.s_[n : n + m], np.s_[len(this.weight) : len(this.weight) + len(other.weight)]
    piece = both.piece[own]
    if not (piece >= 0).any():
        raise FlatclothError("too little cloth of the other side hangs together.")
    is_related = bool((piece == 0).any())
    if not is_related and (piece > 0).any():  # its largest piece is the main one, on a plane of its own
        piece = np.where(piece == np.bincount(piece[piece > 0]).argmax(), 0, piece)
    made = replace(
        other,
        piece=piece,
        all_uv_m=both.all_uv_m[own] * MIRROR,
        weight=both.weight[pairs],
        anchor=np.zeros(0, dtype=np.int32),
        anchor_uv_m=np.zeros((0, 2)),
    )
    std_m, unreliable = np.full(m, np.nan), np.zeros(m, dtype=np.bool_)
    if is_related:
        # The joint layout may move this side at a seam: that distance is added at what lies nearest to it.
        seam = np.flatnonzero(both.placed[n + m :] & (matches.pieces[joining, 0] == 0))
        at = both.all_uv_m[n + m :][seam]
        shift_m = np.linalg.norm(at - matches.this_uv_m[joining[seam]], axis=1)
        std_m = other_std_m.copy()
        if seam.size:
            std_m = np.hypot(other_std_m, shift_m[cKDTree(at).query(np.nan_to_num(both.all_uv_m[own]))[1]])
        # Ripples make lengths unsure; seams hold both sides all the same.
        unreliable = undetermined(
            made, std_m, MOST_STD_M * float(np.median(strain_by_ripples(both)[both.placed]))
        )
    return JoinedSide(
        shape=made,
        std_m=std_m,
        unreliable=unreliable,
        matches=_moved(matches, links, other, made),
        links=tuple(links),
        is_related=is_related,
    )


def _moved(matches: Matches, links: Sequence[SeamLink], before: JointShape, now: JointShape) -> Matches:
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
                is_bridge=link.is_bridge,
                tears=link.tears,
                decided="keep" if link.is_kept else "cut" if link.why == CUT else None,
            )
        )
    return tuple(found)
