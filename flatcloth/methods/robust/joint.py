"""The joint flattening of all accepted views (a departure from the paper, which places views rigidly).

Nodes are points of the cloth, shared by the views that see them; every view contributes its pairs.
Eq. (2) is minimised over all pairs together, each weighted by its accuracy; pairs that contradict the
others lose their weight. Minimisation from a poor start would fold the sheet. Therefore each new node is
first initialised from its placed neighbours, and the whole is relaxed as rigidly as possible: every view
determines the arrangement of the neighbours around a node, with mirror images excluded.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.config import FlatteningConfig
from flatcloth.core.geometry import Rigid3, fit_rigid2
from flatcloth.core.types import Bool, Float64, Int32
from flatcloth.flattening.surface import Surface
from flatcloth.methods.robust.articulated import LEAST_RIGID_PART_NODES
from flatcloth.methods.robust.connectivity import (
    LEAST_EVIDENCE,
    Links,
    connected_pieces,
    links_of,
    without_weak,
)
from flatcloth.methods.robust.consistency import (
    LEAST_PIECE,
    MOST_CUT_EVIDENCE,
    Hinge,
    contradicted_pairs,
    hinges_within,
    overlaps,
    with_better_cuts,
    without_overlap,
)
from flatcloth.methods.robust.layout import (
    lay_out,
    lay_pieces,
    minimise_piece,
    relax_around,
    seed_pair,
    seeded_anew,
)
from flatcloth.methods.robust.observations import (
    Association,
    Complex128,
    Nodes,
    Observation,
    associate,
    averaged,
    no_nodes,
    observe,
)

OUTGROWN = 1.3
"""A piece or part with this many times the nodes of the main one becomes the main one. Set by hand."""

_MOST_GROWTH = 1.35
"""With this many times the pairs of the last time every piece is relaxed as a whole again, ..."""
_MOST_NEW = 0.2
"""... as is a piece of which the last view adds more than this share of nodes ..."""
_MOST_STRAINED = 0.03
"""... or contradicts more than this share of pairs, as they lie. Set by hand."""

Int64 = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class JointShape:
    """All accepted views, flattened together.

    ``observations`` and ``held_from_camera`` are in the order of acceptance. ``piece`` (N,) int32 is
    the piece of cloth of each node: 0 for the main piece, positive for floating pieces (which no view
    connects to it), -1 if too small. ``all_uv_m`` (N, 2) are the positions of the nodes; floating
    pieces lie far beside the main one. ``anchor`` (A,) int32 are nodes of the main piece seen by one
    of the first views, with their positions ``anchor_uv_m`` (A, 2) at that time, which fix the plane.
    ``weight`` (M,) of the pairs of ``links`` is from 0 to 1 relative to their accuracy: small where a
    pair contradicts the others. ``is_cut`` (M,) are the pairs that are not used, because they join parts
    of the cloth that would overlap. ``by_hand`` (N,) are nodes of components that the operator placed where
    space does not: they lie beside others without being near them in space, which contradicts nothing.
    ``hinges`` are those whose angle follows from cloth that must not overlap. ``settled_pairs`` is the number
    of pairs when all pieces were last relaxed as a whole. ``cuts_tried`` is the evidence that was cut when
    others were last tried.
    """

    nodes: Nodes
    observations: tuple[Observation, ...]
    held_from_camera: tuple[Rigid3, ...]
    piece: Int32
    all_uv_m: Float64
    anchor: Int32
    anchor_uv_m: Float64
    weight: Float64
    is_cut: Bool
    by_hand: Bool
    hinges: tuple[Hinge, ...] = ()
    settled_pairs: int = 0
    cuts_tried: float = 0.0

    @cached_property
    def uv_m(self) -> Float64:
        """(N, 2) positions of the nodes of the main piece; NaN for all others."""
        return np.where((self.piece == 0)[:, None], self.all_uv_m, np.nan)

    @property
    def has_place(self) -> Bool:
        """(N,) whether a node has a position, on the main piece or a floating one."""
        found: Bool = np.isfinite(self.all_uv_m[:, 0])
        return found

    @cached_property
    def links(self) -> Links:
        """The pairs of all views."""
        return links_of(self.observations)

    @property
    def evidence(self) -> Float64:
        """(M,) evidence of the pairs that their ends are one piece of cloth; 0 for those that are cut."""
        return np.where(self.is_cut, 0.0, self.weight * self.links.evidence)

    @property
    def node_evidence(self) -> Float64:
        """(N,) evidence that joins each node to others."""
        ends, twice = self.links.edges.ravel(), np.repeat(self.evidence, 2)
        return np.bincount(ends, twice, len(self.nodes)).astype(np.float64)

    @property
    def placed(self) -> Bool:
        """(N,) whether a node is on the main piece."""
        found: Bool = (self.piece == 0) & np.isfinite(self.all_uv_m[:, 0])
        return found

    @property
    def views(self) -> tuple[int, ...]:
        """The accepted views."""
        return tuple(s.view_index for s in self.observations)

    def not_laid_out(self, is_cut: Bool) -> JointShape:
        """Return it before any node had a place, with the pairs ``is_cut`` (M,) cut and no weight lost.

        A layout that a false link has bent would stay so: what is right contradicts it, and has no weight.
        """
        return self.with_same_pairs(
            piece=np.where(self.piece == 0, 0, -1).astype(np.int32),
            all_uv_m=np.full_like(self.all_uv_m, np.nan),
            weight=np.where(is_cut, 0.0, 1.0),
            is_cut=is_cut,
            hinges=(),
            settled_pairs=0,
        )

    def with_same_pairs(self, **changed: Any) -> JointShape:
        """Return it with other fields but the same observations: their pairs take most of its memory."""
        made = replace(self, **changed)
        made.__dict__["links"] = self.links
        return made


def begin_joint(
    surface: Surface,
    held_from_camera: Rigid3,
    start_uv_m: Float64,
    flattening: FlatteningConfig,
) -> JointShape:
    """Return the joint shape of the start view alone.

    Parameters
    ----------
    surface : Surface
        The start view's surface.
    held_from_camera : Rigid3
        Pose of its camera.
    start_uv_m : (H, W, 2) float64
        Position of each pixel of its main component on the plane; NaN elsewhere.
    flattening : FlatteningConfig
        Sampling interval.
    """
    nodes, first = observe(no_nodes(), _NONE, surface, held_from_camera, flattening)
    at = np.rint(first.rc).astype(np.int32)
    uv = start_uv_m[at[:, 0], at[:, 1]]
    shape = JointShape(
        nodes=nodes,
        observations=(first,),
        held_from_camera=(held_from_camera,),
        piece=np.where(np.isfinite(uv[:, 0]), 0, -1).astype(np.int32),
        all_uv_m=uv,
        anchor=np.zeros(0, dtype=np.int32),
        anchor_uv_m=np.zeros((0, 2)),
        weight=np.ones(len(first.edges)),
        is_cut=np.zeros(len(first.edges), dtype=np.bool_),
        by_hand=np.zeros(len(nodes), dtype=np.bool_),
    )
    return _solved(shape)


_NONE = Association(node=np.zeros(0, dtype=np.int32), rc=np.zeros((0, 2)), incidence_deg=np.zeros(0))
"""No nodes were found again. By definition."""


def extend_joint(
    shape: JointShape,
    surface: Surface,
    held_from_camera: Rigid3,
    flattening: FlatteningConfig,
    associated: Association | None = None,
    placed_by_hand: Bool | None = None,
) -> JointShape:
    """Return the shape with one more view, with all views flattened again.

    Parameters
    ----------
    shape : JointShape
        The shape so far.
    surface, held_from_camera
        The view to add, and the pose of its camera.
    flattening : FlatteningConfig
        Sampling interval.
    associated : Association, optional
        The nodes that the view shows; by default they are found by place and normal.
    placed_by_hand : (H, W) bool, optional
        Pixels of the view that the operator placed where they share no cloth with the shape in space.
    """
    if associated is None:
        associated = associate(shape.nodes, surface, held_from_camera)
    nodes, added = observe(shape.nodes, associated, surface, held_from_camera, flattening)
    more = len(nodes) - len(shape.nodes)
    before_uv = np.concatenate([shape.all_uv_m, np.full((more, 2), np.nan)])
    contradicted = contradicted_pairs(
        before_uv, added.node[added.edges], added.edge_length_m, added.edge_evidence
    )
    by_hand = np.concatenate([shape.by_hand, np.zeros(more, dtype=np.bool_)])
    if placed_by_hand is not None:
        row, col = np.rint(added.rc).astype(np.int32).T
        by_hand[added.node] |= placed_by_hand[row, col]
    grown = JointShape(
        nodes=nodes,
        observations=(*shape.observations, added),
        held_from_camera=(*shape.held_from_camera, held_from_camera),
        piece=np.concatenate([shape.piece, np.full(more, -1, dtype=np.int32)]),
        all_uv_m=before_uv,
        anchor=shape.anchor,
        anchor_uv_m=shape.anchor_uv_m,
        weight=np.concatenate([shape.weight, np.ones(len(added.edges))]),
        is_cut=np.concatenate([shape.is_cut, contradicted]),
        by_hand=by_hand,
        hinges=shape.hinges,
        settled_pairs=shape.settled_pairs,
        cuts_tried=shape.cuts_tried,
    )
    grown.__dict__["links"] = shape.links.with_view(added)
    return with_better_cuts(_solved(grown), _solved)


def with_poses(shape: JointShape, held_from_camera: tuple[Rigid3, ...]) -> JointShape:
    """Return the shape with other camera poses: its nodes move in space, not on the plane."""
    if all(a is b for a, b in zip(held_from_camera, shape.held_from_camera, strict=True)):
        return shape
    nodes = no_nodes()
    for observation, held in zip(shape.observations, held_from_camera, strict=True):
        nodes = averaged(nodes, observation, held)
    return shape.with_same_pairs(nodes=nodes, held_from_camera=held_from_camera)


def largest_piece(shape: JointShape) -> int:
    """Return the number of the piece with the most nodes: 0 if it is the main one."""
    sizes = np.bincount(shape.piece[shape.piece >= 0])
    return int(sizes.argmax()) if sizes.size else 0


def with_largest_piece(shape: JointShape) -> JointShape:
    """Return the shape with its largest piece as the main one; the main piece floats in its place."""
    largest = largest_piece(shape)
    if largest == 0:
        return shape
    piece, uv = shape.piece.copy(), shape.all_uv_m.copy()
    main, floating = piece == 0, piece == largest
    piece[main], piece[floating] = largest, 0
    uv[main] += np.nanmean(uv[floating], axis=0) - np.nanmean(uv[main], axis=0)
    return _anchored(shape.with_same_pairs(piece=piece, all_uv_m=uv))


def settled(shape: JointShape) -> JointShape:
    """Return the shape, relaxed as a whole up to the minimum of Eq. (2), without nodes that little joins."""
    return without_weak(_solved(shape.with_same_pairs(settled_pairs=0), precise=True))


def taken_apart(shape: JointShape, parts: Sequence[Bool]) -> JointShape:
    """Return the shape with each of ``parts`` (N,) of its nodes as a piece of its own, all relaxed again.

    Nodes beside the cut that little evidence joins to their side may belong to either, and have no place.
    """
    edges = shape.links.edges
    of_part = np.array(parts)[:, edges]
    between = (of_part[:, :, 0] != of_part[:, :, 1]).any(axis=0)
    cut = shape.not_laid_out(shape.is_cut | between)
    if shape.by_hand.any():  # what the operator placed stays as it lies
        cut = shape.with_same_pairs(is_cut=cut.is_cut, weight=cut.weight * shape.weight, settled_pairs=0)
    made = settled(_solved(cut))
    beside = np.zeros(len(made.nodes), dtype=np.bool_)
    beside[edges[between]] = True
    beside[edges[beside[edges].any(axis=1)]] = True
    return without_weak(made, beside)


def _solved(shape: JointShape, *, most_cut: float = MOST_CUT_EVIDENCE, precise: bool = False) -> JointShape:
    """Initialise and minimise each connected piece; the largest is the main one.

    The main piece stays the main one unless another is clearly larger. A piece that overlaps itself is laid
    out anew; if it still does, a part is turned about where the least evidence joins it, or cut off if
    that is at most ``most_cut``. If ``precise``, the shape is minimised already, but for the last bit.
    """
    links, before = shape.links, shape.piece
    whole = len(links.edges) > _MOST_GROWTH * shape.settled_pairs
    label = _pieces(shape)
    touched = np.ones(int(label.max()) + 1, dtype=bool)
    if not whole or shape.settled_pairs == len(links.edges) - len(shape.observations[-1].edges):
        touched[:] = False
        touched[label[shape.observations[-1].node]] = True
    sizes = np.bincount(label)
    order = np.flatnonzero(sizes >= LEAST_PIECE)
    main = int(np.bincount(label[before == 0], minlength=sizes.size).argmax())
    if sizes.max() > OUTGROWN * sizes[main]:
        main = int(sizes.argmax())
    order = np.array([main, *sorted(set(order.tolist()) - {main}, key=lambda k: -sizes[k])], dtype=int)
    piece = np.full(len(label), -1, dtype=np.int32)
    uv, weight = np.full((len(label), 2), np.nan), shape.weight.copy()
    hinges: list[Hinge] = []
    for n, own in enumerate(order):
        members = label == own
        known = _known(members & shape.has_place, before)
        if not touched[own] and n and known.any() and (known == members).all():
            uv[members] = shape.all_uv_m[members]
            hinges += hinges_within(shape, members)
        else:
            within = np.flatnonzero(links.both_ends(members) & ~shape.is_cut)
            z = np.where(known, shape.all_uv_m @ np.array([1.0, 1j]), np.nan)
            if not known.any():
                seed_pair(z, links, within)
            z = lay_out(_with_pieces(z, shape, links, within, members), links, within)
            if n:
                z = seeded_anew(z, members, links, within)
            inside = within[links.both_ends(np.isfinite(z.real))[within]]
            quick = None if whole else _relaxed_around(shape, z, members, known, inside)
            if quick is not None:
                own_uv, weight[inside] = quick
            else:
                own_uv, weight[inside] = minimise_piece(
                    z, links, inside, shape.weight[inside], precise=precise
                )
                own_uv, held, cut = without_overlap(shape, own_uv, members, within, weight, most_cut)
                if cut.size:
                    is_cut = shape.is_cut.copy()
                    is_cut[cut] = True
                    kept = np.where(is_cut, 0.0, shape.weight)
                    anew = shape.with_same_pairs(is_cut=is_cut, weight=kept, settled_pairs=0)
                    return _solved(anew, most_cut=0.0)
                hinges += held
            uv[members] = own_uv[members]
        piece[members & np.isfinite(uv[:, 0])] = n
        if n:
            uv[members] += (_APART_M * n, 0.0) - np.nanmean(uv[members], axis=0)
    return _anchored(
        shape.with_same_pairs(
            piece=piece,
            all_uv_m=uv,
            weight=weight,
            hinges=tuple(hinges),
            settled_pairs=len(links.edges) if whole else shape.settled_pairs,
        )
    )


def _relaxed_around(
    shape: JointShape, z: Complex128, members: Bool, known: Bool, inside: Int64
) -> tuple[Float64, Float64] | None:
    """Relax a piece (its pairs ``inside``) around its new nodes only.

    Returns places (N, 2) and weights as :func:`minimise_piece`; None if that is not enough: much of the piece
    is new or was another piece, many pairs of the last view contradict the places, a part was turned about a
    hinge (which sees to its nodes), or cloth overlaps.
    """
    new = np.isfinite(z.real) & ~known
    if new.sum() > _MOST_NEW * known.sum() or hinges_within(shape, members):
        return None
    uv, weight = relax_around(z, shape.links, inside, shape.weight[inside], new)
    of_last = weight[shape.links.of_last_view(inside)]
    is_strained = (of_last < 0.25).sum() > _MOST_STRAINED * of_last.size
    if is_strained or np.unique(overlaps(shape, uv)).size >= LEAST_PIECE:
        return None
    return uv, weight


def _with_pieces(z: Complex128, shape: JointShape, links: Links, within: Int64, members: Bool) -> Complex128:
    """Place pieces that were laid out before, and are now joined to what is placed, as they were."""
    apart = members & shape.has_place & (shape.piece >= 0) & ~np.isfinite(z.real)
    if not apart.any() or not np.isfinite(z.real).any():
        return z
    new = within[~apart[links.edges[within]].any(axis=1)]
    laid = np.where(apart, shape.all_uv_m @ np.array([1.0, 1j]), np.nan)
    return lay_pieces(lay_out(z, links, new), links, within, laid, shape.piece)


_APART_M = 10.0
"""Distance of floating pieces on the plane. Set by hand."""


def _known(members: Bool, before: Int32) -> Bool:
    """Of a piece's members that have positions, return the largest set that was one piece before."""
    if not members.any():
        return members
    was = before[members]
    most = int(np.bincount(was + 1).argmax()) - 1
    largest: Bool = members & (before == most)
    return largest


def _anchored(shape: JointShape) -> JointShape:
    """Move the main piece onto its anchor; a main piece without an anchor gets one."""
    kept = shape.placed[shape.anchor]
    if kept.sum() >= 3:
        motion = fit_rigid2(shape.all_uv_m[shape.anchor[kept]], shape.anchor_uv_m[kept])
        uv = shape.all_uv_m.copy()
        uv[shape.placed] = motion.apply(uv[shape.placed])
        return shape.with_same_pairs(all_uv_m=uv)
    if shape.anchor.size and shape.placed.any():
        # A floating piece has become the main one: move it to the middle of the plane.
        uv = shape.all_uv_m.copy()
        uv[shape.placed] -= uv[shape.placed].mean(axis=0)
        shape = shape.with_same_pairs(all_uv_m=uv)
    for observation in shape.observations:
        anchor = observation.node[shape.placed[observation.node]]
        if anchor.size >= 3:
            break
    return shape.with_same_pairs(anchor=anchor, anchor_uv_m=shape.all_uv_m[anchor])


def _pieces(shape: JointShape) -> Int32:
    """Return the piece of each node (N,)."""
    pair, edges = shape.links.pair, shape.links.once
    evidence: Float64 = np.bincount(pair, shape.evidence, len(edges)).astype(np.float64)
    if shape.is_cut.any():
        left = np.bincount(pair[~shape.is_cut], minlength=len(edges)) > 0
        edges, evidence = edges[left], evidence[left]
    return connected_pieces(len(shape.nodes), edges, evidence, LEAST_RIGID_PART_NODES, LEAST_EVIDENCE)
