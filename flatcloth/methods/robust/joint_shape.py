"""The data type of the method ``robust``: all accepted views, flattened together.

:mod:`flatcloth.methods.robust.joint` makes it; compositing, scoring and planning read it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from flatcloth.core.geometry import Rigid3, fit_rigid2
from flatcloth.core.types import Bool, Float32, Float64, Int32, Int64
from flatcloth.flattening.sampling import LEAST_INTERVAL_M
from flatcloth.methods.robust.connectivity import LEAST_EVIDENCE, Links
from flatcloth.methods.robust.observations import Nodes, Observation, averaged, no_nodes

LEAST_PIECE = 12
"""Fewest nodes of a floating piece that is kept, of an overlap that counts, and
of a second rigid motion in one component. Set by hand."""
TWICE_M = 0.015
"""The same cloth at two positions farther apart on the plane (a little more than the distance of nodes) is
present twice. Nodes nearer than this on the plane and more than three times as far apart in space lie on
one another: no noise explains that. Set by hand."""
PIECES_APART_M = 10.0
"""Distance of floating pieces on the plane. By definition: larger than any cloth."""
TWO_ROWS_M = 2 * LEAST_INTERVAL_M
"""Two rows of nodes. So far off its place a node may still be the same cloth; so much nearer a node covers
others; gaps between pieces are at most as wide, and so is the cloth that is expected beyond an outline.
Chosen."""
OUTGROWN = 1.3
"""A piece or part with this many times the nodes of the main one becomes the main one. Set by hand."""
_LEAST_OF_MEDIAN = 0.025
"""A node is not shown that a smaller share of the median node's evidence joins to others. Set by hand."""


@dataclass(frozen=True, kw_only=True, eq=False)
class JointShape:
    """All accepted views, flattened together. Two shapes are equal only if they are the same object.

    ``observations`` and ``object_from_camera`` are in the order of acceptance, ``links`` are the pairs of all
    observations. ``piece`` (N,) int32 is the piece of cloth of each node: 0 for the main piece, positive
    for floating pieces (which no view connects to it), -1 if too small. ``all_uv_m`` (N, 2) are the
    positions of the nodes; floating pieces lie far from the main one. ``anchor`` (A,) int32 are nodes of
    the main piece seen by one of the first views, with their positions ``anchor_uv_m`` (A, 2) at that time,
    which fix the plane. ``weight`` (M,) of the pairs is from 0 to 1 relative to their accuracy: small where
    a pair contradicts the others. ``is_cut`` (M,) are the pairs that are not used, because they join parts
    of the cloth that would overlap. ``by_hand`` (N,) are nodes of components that the operator placed where
    they share no cloth with the shape in space; overlaps of them contradict nothing. ``settled_pairs`` is
    the number of pairs when all pieces were last relaxed as a whole, ``cuts_tried`` the evidence that was
    cut when other cuts were last tried.
    """

    nodes: Nodes
    observations: tuple[Observation, ...]
    object_from_camera: tuple[Rigid3, ...]
    links: Links
    piece: Int32
    all_uv_m: Float64
    anchor: Int32
    anchor_uv_m: Float64
    weight: Float32
    is_cut: Bool
    by_hand: Bool
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

    @property
    def placed(self) -> Bool:
        """(N,) whether a node is on the main piece."""
        found: Bool = (self.piece == 0) & self.has_place
        return found

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
    def cut_evidence(self) -> float:
        """Evidence of the pairs that are cut."""
        return float(self.links.evidence[self.is_cut].sum())

    @property
    def views(self) -> tuple[int, ...]:
        """The accepted views."""
        return tuple(s.view_index for s in self.observations)


def with_observation(
    shape: JointShape,
    nodes: Nodes,
    added: Observation,
    object_from_camera: Rigid3,
    *,
    is_cut: Bool,
    by_hand: Bool,
) -> JointShape:
    """Return the shape with one more view, before it is flattened: its new nodes have no position.

    ``nodes`` are those of all views; ``is_cut`` (M,) are the pairs of the view that are not used, ``by_hand``
    (K,) the nodes that it shows where the operator placed them.
    """
    new = len(nodes) - len(shape.nodes)
    placed_by_hand = np.concatenate([shape.by_hand, np.zeros(new, dtype=np.bool_)])
    placed_by_hand[added.node] |= by_hand
    return replace(
        shape,
        nodes=nodes,
        observations=(*shape.observations, added),
        object_from_camera=(*shape.object_from_camera, object_from_camera),
        links=shape.links.with_view(added),
        piece=np.concatenate([shape.piece, np.full(new, -1, dtype=np.int32)]),
        all_uv_m=np.concatenate([shape.all_uv_m, np.full((new, 2), np.nan)]),
        weight=np.concatenate([shape.weight, np.ones(len(added.edges), dtype=np.float32)]),
        is_cut=np.concatenate([shape.is_cut, is_cut]),
        by_hand=placed_by_hand,
    )


def with_poses(shape: JointShape, object_from_camera: tuple[Rigid3, ...]) -> JointShape:
    """Return the shape with other camera poses: its nodes move in space, not on the plane."""
    if all(a is b for a, b in zip(object_from_camera, shape.object_from_camera, strict=True)):
        return shape
    nodes = no_nodes()
    for observation, held in zip(shape.observations, object_from_camera, strict=True):
        nodes = averaged(nodes, observation, held)
    return replace(shape, nodes=nodes, object_from_camera=object_from_camera)


def with_cut(shape: JointShape, cut: Int64) -> JointShape:
    """Return the shape with further pairs ``cut`` (K,), which must be flattened again."""
    is_cut = shape.is_cut.copy()
    is_cut[cut] = True
    return replace(shape, is_cut=is_cut, weight=np.where(is_cut, 0.0, shape.weight), settled_pairs=0)


def without_layout(shape: JointShape, is_cut: Bool) -> JointShape:
    """Return the shape without any positions, with the pairs ``is_cut`` (M,) cut and full weights.

    A layout that a false link has bent would stay bent: the right pairs contradict it, and have no weight.
    """
    return replace(
        shape,
        piece=np.where(shape.piece == 0, 0, -1).astype(np.int32),
        all_uv_m=np.full_like(shape.all_uv_m, np.nan),
        weight=(~is_cut).astype(np.float32),
        is_cut=is_cut,
        settled_pairs=0,
    )


def without_weak(shape: JointShape, at_cut: Bool | None = None) -> JointShape:
    """Return the shape without positions of nodes that little evidence joins to others.

    Of the nodes ``at_cut`` (N,), those need as much evidence as joins two pieces.
    """
    evidence = shape.node_evidence
    usual = float(np.median(evidence[shape.placed])) if shape.placed.any() else 0.0
    weak = evidence < _LEAST_OF_MEDIAN * usual
    if at_cut is not None:
        weak |= at_cut & (evidence < LEAST_EVIDENCE)
    if not (shape.placed & ~weak).any():
        return shape
    return replace(
        shape,
        piece=np.where(weak, -1, shape.piece).astype(np.int32),
        all_uv_m=np.where(weak[:, None], np.nan, shape.all_uv_m),
    )


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
    return anchored(replace(shape, piece=piece, all_uv_m=uv))


def anchored(shape: JointShape) -> JointShape:
    """Move the main piece onto its anchor; a main piece without an anchor gets one."""
    kept = shape.placed[shape.anchor]
    if kept.sum() >= 3:
        motion = fit_rigid2(shape.all_uv_m[shape.anchor[kept]], shape.anchor_uv_m[kept])
        uv = shape.all_uv_m.copy()
        uv[shape.placed] = motion.apply(uv[shape.placed])
        return replace(shape, all_uv_m=uv)
    if shape.anchor.size and shape.placed.any():
        # A floating piece has become the main one: move it to the middle of the plane.
        uv = shape.all_uv_m.copy()
        uv[shape.placed] -= uv[shape.placed].mean(axis=0)
        shape = replace(shape, all_uv_m=uv)
    for observation in shape.observations:
        anchor = observation.node[shape.placed[observation.node]]
        if anchor.size >= 3:
            break
    return replace(shape, anchor=anchor, anchor_uv_m=shape.all_uv_m[anchor])
