"""The method ``robust``: placements from 3D, several hypotheses, one joint flattening of all views.

Start here: :class:`RobustMethod` has the steps of ``docs/robust.md``, by the
numbers that they have there. A step that takes a document
is cached by the part of the document that it depends on (:mod:`flatcloth.methods.robust.shapes`). The plane
is always the start view's: a placement ``current_from_new`` maps to it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from flatcloth.core.cache import Cache
from flatcloth.core.geometry import Rigid3, wrapped_deg
from flatcloth.core.types import Bool, Float64, LaidPiece, Progress, RgbdFrame, Rigid2, Uint8, no_progress
from flatcloth.flattening.cloth import Cloth
from flatcloth.flattening.pixel_states import states_of_view
from flatcloth.methods.answers import (
    AlignmentScore,
    Candidate,
    Canonical,
    ClothPairs,
    JoinedPiece,
    JoinedSides,
    OneSide,
    Placement,
    Plan,
    Seam,
)
from flatcloth.methods.base import Focus, Method, Views
from flatcloth.methods.robust.acceptance import joined_piece, same_cloth, with_piece_moved
from flatcloth.methods.robust.compositing import draw, states_of_nodes, states_on_surface
from flatcloth.methods.robust.connectivity import both_ends
from flatcloth.methods.robust.joint import MOST_CONTRADICTION, begin_joint, extend_joint, taken_apart
from flatcloth.methods.robust.joint_shape import JointShape, largest_piece, without_weak
from flatcloth.methods.robust.layout import CONTRADICTED_WEIGHT, misfit
from flatcloth.methods.robust.next_best_view import inner_area_m2, rate_candidates, seams_ahead
from flatcloth.methods.robust.placement_search import PlacementSearch, choose_placement
from flatcloth.methods.robust.scoring import cloth_pairs, refine, score_placement
from flatcloth.methods.robust.seams.joining import Seamed, join_sides, other_of, seams_of
from flatcloth.methods.robust.shapes import (
    MOST_KEPT,
    Certainty,
    JointShapes,
    RegisteredViews,
    prefix,
)
from flatcloth.methods.starting import overlap_area_m2, start_by_view
from flatcloth.registration.registered import Registered
from flatcloth.session.document import Accepted, Document, Later, Side


class RobustMethod(Method):
    """The algorithm of ``docs/robust.md``; see :class:`flatcloth.methods.base.Method`."""

    name = "robust"
    joins_sides = True

    def __init__(self, views: Views, angles_deg: Sequence[float]) -> None:
        self.angles_deg = angles_deg
        self._views, self._config = views, views.config
        self.seen = RegisteredViews(views)
        self.shapes = JointShapes(self.begin, self.extend, views.held_point_m)
        self.search = PlacementSearch(views, self.seen, self.shapes, angles_deg)
        self._scores: Cache[AlignmentScore] = Cache(MOST_KEPT)
        self._drawn: Cache[Canonical] = Cache(2)
        self._apart: Cache[JointShape] = Cache(2)
        self._relaid: Cache[JointShape] = Cache(2)  # by both sides
        self._seamed: Cache[Seamed] = Cache(1)

    # ------------------------------------------------- 1. next best view (in place of the paper's 4.1)

    def start_view(self, progress: Progress = no_progress) -> int | None:
        """Start with the largest observed area, as the paper does."""
        return start_by_view(self._views, progress)

    def plan(self, document: Document, unusable: set[int]) -> Plan:
        """Choose the view with the largest expected new area, given enough overlap."""
        c = self._config.robust
        used = document.used_views
        looked = used | document.refused_views | unusable
        rest = [v for v in range(len(self.angles_deg)) if v not in looked]
        if not rest:
            return _no_plan("No view is left.")
        shape, around = self.shapes.shape(document), self.search.around(document)
        overlap_m2 = overlap_area_m2(self._views)
        rated = rate_candidates(shape, self._views.axis, self.angles_deg, rest, looked, overlap_m2, around)
        best = rated[0]
        if best.new_m2 < c.least_new_m2:
            reason = f"No other view is expected to add more than {1e4 * best.new_m2:.0f} cm2."
            return _no_plan(reason, rated)
        if len(used) >= c.most_views and self.is_limited:
            more = sum(candidate.new_m2 >= c.least_new_m2 for candidate in rated)
            reason = f"The limit of {len(used)} views is reached; {more} more may show cloth that is missing."
            return _no_plan(f"{reason} Choose one to continue.", rated)
        return Plan(
            view_index=best.view_index,
            side=None,
            rotation_deg=self._turn_deg(used, best),
            reason=(
                f"{1e4 * best.new_m2:.0f} cm2 new, {1e4 * best.overlap_m2:.0f} cm2 in common"
                + ("" if best.overlap_m2 >= overlap_m2 else ", less than desired")
            ),
            sides=(),
            candidates=tuple(rated),
        )

    def look_ahead(self, document: Document, angles_deg: Sequence[float], focus: Focus | None = None) -> Plan:
        """Rate rotations at which no view was taken yet by the expected new area."""
        recorded, overlap_m2 = len(self.angles_deg), overlap_area_m2(self._views)
        shape, free = self.shapes.shape(document), range(recorded, len(angles_deg))
        rated = rate_candidates(
            shape, self._views.axis, angles_deg, free, range(recorded), overlap_m2, focus=focus
        )
        return Plan(
            view_index=rated[0].view_index,
            side=None,
            rotation_deg=rated[0].gap_deg,
            reason=f"{1e4 * rated[0].new_m2:.0f} cm2 new",
            sides=(),
            candidates=tuple(rated),
        )

    def least_m2(self, document: Document) -> float:
        """Return the area of the canonical view but for its border, by the nodes as views extended them."""
        return inner_area_m2(self.shapes.shape(document))

    def seams_ahead(
        self, document: Document, other: Method, its: Document, angles_deg: Sequence[float], *, related: bool
    ) -> Float64:
        """Return the floating cloth (K,), m2, of which views at angles are expected to show seams."""
        assert isinstance(other, RobustMethod)
        shapes = self.shapes.settled(document), other.shapes.settled(its)
        return seams_ahead(shapes, self._views.axis, angles_deg, related=related)

    def _turn_deg(self, used: frozenset[int], best: Candidate) -> float:
        angles = self.angles_deg
        turns = [wrapped_deg(angles[best.view_index] - angles[v]) for v in used]
        return min(turns, key=abs)

    # ------------------------------------------------- 2. placement of a view (in place of 4.2)

    def propose(
        self, document: Document, view_index: int, side: Side | None, progress: Progress = no_progress
    ) -> Placement:
        """Register the view's camera, find hypotheses for each component, and choose the best."""
        progress(0.1, f"flattening view {view_index}")
        self._views.flattening(view_index)
        shape = self.shapes.shape(document)
        progress(0.4, "searching the placement")
        components = self.search.components(document, view_index)  # 2a. register, associate, sample
        found = self.search.search(document, view_index)  # 2b. estimate, refine, score
        cameras = self.seen.registered((*shape.views, view_index))
        chosen = choose_placement(components, found, view_index, cameras)  # 2c. choose
        alignment = chosen.alignment
        key = (prefix(document), view_index, chosen.component, alignment.current_from_new)
        self._scores.put(key, alignment.score)  # whoever decides asks for it at once
        return chosen

    def score(self, document: Document, view_index: int, component: int, motion: Rigid2) -> AlignmentScore:
        """Score a placement by the probability that it is right (cached)."""

        def make() -> AlignmentScore:
            sampled = self.search.components(document, view_index).get(component)
            if sampled is None:
                return AlignmentScore(0.0, {})
            return score_placement(self.search.reference(document), sampled, motion)

        return self._scores.get((prefix(document), view_index, component, motion), make)

    def refined(self, document: Document, view_index: int, component: int, motion: Rigid2) -> Rigid2:
        """Refine a placement by fitting its points to the surface that they cover in space."""
        sampled = self.search.components(document, view_index).get(component)
        if sampled is None:
            return motion
        return refine(self.search.reference(document), sampled, motion).shape_from_component

    def pairs(self, document: Document, view_index: int, component: int) -> ClothPairs | None:
        """Return the nodes of the shape that the view shows, each with its place on the component."""
        sampled = self.search.components(document, view_index).get(component)
        return None if sampled is None else cloth_pairs(self.search.reference(document), sampled)

    # ------------------------------------------------- 3. joint flattening (in place of 4.3)

    def begin(self, start_view: int) -> JointShape:
        """Return the joint shape of the start view: its nodes, and the pairs between them."""
        flattening = self._views.flattening(start_view)
        uv, _ = flattening.carrier.place_all()
        uv[self.seen.component_of_pixel(start_view) != 0] = np.nan
        (pose,) = self.seen.poses((start_view,))
        made = begin_joint(flattening.surface, pose, uv, self._config.flattening)
        self.seen.observed_places(made.observations[-1])  # while the view's flattening is cached
        return made

    def extend(self, shape: JointShape, added: Accepted) -> JointShape:
        """Add an accepted view to the joint shape."""
        view, flattening = added.view_index, self._views.flattening(added.view_index)
        shape, pose, shown = self.seen.associated(shape, view)  # 3a. register the camera; association
        places = self.seen.places(view, shown.rc)
        joined = joined_piece(shape, shown, places, added, flattening)
        if joined is not None:
            shape = with_piece_moved(shape, joined)
        shown, by_hand = same_cloth(  # 3b. the nodes that fit the accepted placement
            shape, shown, places, added, flattening, joins_piece=joined is not None
        )
        placed = self.seen.component_of_pixel(view) == added.component if by_hand else None
        made = extend_joint(  # 3c to 3h: joint.py
            shape, flattening.surface, pose, self._config.flattening, shown, placed
        )
        self.seen.observed_places(made.observations[-1])  # while the view's flattening is cached
        return made

    def canonical(self, document: Document) -> Canonical:
        """Return the canonical view, composited from the joint shape, with its floating pieces."""
        return self._drawn_of(document, *self._shown(document))

    def alone(self, document: Document) -> Canonical:
        """Return the canonical view as this side alone lays it out."""
        return self._drawn_of(document, *self._shown(document, alone=True))

    def _settled(self, document: Document, parts: Sequence[Bool] = ()) -> JointShape:
        """Return the shape at its minimum, without some parts, which float (cached)."""
        settled = self.shapes.settled(document)
        if not parts:
            return settled
        key = settled, *(part.tobytes() for part in parts)
        return self._apart.get(key, lambda: taken_apart(settled, parts))

    def _shown(
        self, document: Document, parts: Sequence[Bool] = (), *, alone: bool = False
    ) -> tuple[JointShape, Certainty]:
        """Return the shape as it is shown, without some parts, and how certain its nodes are.

        Once both sides are joined, it is the layout of both if that is the better one; not if ``alone``.
        """
        shape = self._settled(document, parts)  # 3d to 3h again, to the minimum of Eq. (2)
        relaid = None if alone else self._relaid.kept((shape, document.garment.seams))
        return relaid or shape, self.shapes.certainty_of(shape)

    def _drawn_of(
        self,
        document: Document,
        shape: JointShape,
        certainty: Certainty,
        taken_off: Bool | None = None,
    ) -> Canonical:
        return self._drawn.get(shape, lambda: self._draw(document, shape, certainty, taken_off))

    def release(self, *, surfaces: bool = False) -> None:
        """Free what only further views or earlier shapes need; with ``surfaces``, those of the views too."""
        for kept in (self.shapes, self.search):
            kept.release()
        self._seamed.drop()
        self.seen.release(surfaces=surfaces)

    def earlier(self, earlier: Document, document: Document) -> Canonical:
        """Return the canonical view as views extended it, without the minimum over all pairs.

        What floats because its place is not determined is that of the ``document``.
        """
        _, unreliable = self.shapes.certainty(document)
        shape = without_weak(self.shapes.shape(earlier))
        known = unreliable[: len(shape.nodes)]  # nodes of later views follow
        return self._draw(earlier, shape, (None, known))

    def _draw(
        self,
        document: Document,
        shape: JointShape,
        certainty: tuple[Float64 | None, Bool],
        taken_off: Bool | None = None,
    ) -> Canonical:
        """Composite a shape (3i), with its placement uncertainty (3j); some nodes (N,) were taken off it."""
        surfaces = self.seen.surfaces(shape)
        costs = self.seen.pixel_costs(surfaces)
        motions = self.seen.current_from_view(shape, document.placed_components)
        return draw(shape, surfaces, self._views.axis, self._config, costs, certainty, motions, taken_off)

    def apart(
        self, document: Document, parts: Sequence[Bool], *, alone: bool = False
    ) -> tuple[Canonical, Cloth]:
        """Return the canonical view without some parts, which float, and its edges (doubted links)."""
        shape, certainty = self._shown(document, parts, alone=alone)
        return self._drawn_of(document, shape, certainty, np.any(parts, axis=0)), _edges_of(shape)

    # ------------------------------------------------- the other side

    def take_confirmed(self, cameras: Registered) -> None:
        """Compare no views: the cameras stand as recorded."""
        self.seen.confirmed = cameras

    def with_other_side(
        self,
        own: OneSide,
        laid: Sequence[LaidPiece],
        other: Method,
        its: OneSide,
        check: Callable[[], None],
    ) -> JoinedSides:
        """Join the other side, integrated by itself, along the seams (``docs/robust.md``, "Both sides")."""
        assert isinstance(other, RobustMethod)
        pieces = [(side.canonical.view, *side.canonical.floating) for side in (own, its)]
        held_point_m, seams = self._views.held_point_m, own.document.garment.seams
        check()
        shapes = self._settled(own.document, own.parts), other._settled(its.document, its.parts)
        ends = own.ends, its.ends
        seamed = other._seamed.get(  # where a garment lays floating pieces changes no seam
            (*shapes, seams),
            lambda: join_sides(*shapes, (pieces[0], pieces[1]), ends, held_point_m, seams, check),
        )
        joined, key = other_of(seamed, laid), (shapes[0], seams)
        shown = self._relaid.kept(key)
        if shown is None:
            shown = self._relaid.put(key, _relaid_by(seamed))
            self.times_joined += 1
        check()
        drawn = other._draw(its.document, joined.shape, (np.nan_to_num(joined.std_m), joined.unreliable))
        if not joined.is_related:  # it floats, and has no deviation from this side's shape
            drawn = replace(drawn, view=replace(drawn.view, placement_std_m=None))
        return JoinedSides(
            other=drawn,
            seams=_on_shown(seams_of(joined, (drawn.view, *drawn.floating)), shapes[0], shown),
            is_related=joined.is_related,
            laid=joined.laid,
        )

    # ------------------------------------------------- 4. acceptance without an operator

    @property
    def accept_score(self) -> float:
        """The smallest accepted confidence (``docs/robust.md``, "Placing a view")."""
        return self._config.robust.accept_confidence

    def contradiction(self, document: Document) -> float:
        """Return the share of the last accepted view's pairs that the other views contradict."""
        shape = self.shapes.shape(document)
        links = shape.links
        own = (links.observation == len(shape.observations) - 1) & both_ends(shape.placed, links.edges)
        return float((shape.weight[own] < CONTRADICTED_WEIGHT).mean()) if own.any() else 0.0

    def is_contradicted(self, document: Document) -> bool:
        """Return whether this share is too large for acceptance without an operator."""
        return self.contradiction(document) > MOST_CONTRADICTION

    def is_outgrown(self, document: Document) -> bool:
        """Return whether a floating piece has more nodes than the shape."""
        return largest_piece(self.shapes.shape(document)) != 0

    # ------------------------------------------------- what the rest of the program asks

    def carried(self, document: Document, later: Later) -> Rigid2:
        """Return the placement of a later decision, which is unchanged because the plane is fixed."""
        return later.decision.current_from_new

    def cameras(self, document: Document) -> Registered | None:
        """Return the registered cameras of the accepted views."""
        return self.seen.registered(document.views_in_order)

    def poses(self, document: Document) -> dict[int, Rigid3]:
        """Return the registered ``object_from_camera`` of each accepted view."""
        views = document.views_in_order
        return dict(zip(views, self.seen.poses(views), strict=True))

    def joined_piece(self, document: Document) -> JoinedPiece | None:
        """Return the floating piece that the pending view joins to the shape where it lies."""
        pending = document.pending
        if pending is None or not pending.moved:
            return None
        added = Accepted(
            pending.view_index, pending.current_from_new, fixed=True, component=pending.component
        )
        shape, _, shown = self.seen.associated(self.shapes.shape(document), added.view_index)
        places = self.seen.places(added.view_index, shown.rc)
        return joined_piece(shape, shown, places, added, self._views.flattening(added.view_index))

    def pixel_states(
        self, document: Document, frame: RgbdFrame, item: Bool, taken_off: Bool | None = None
    ) -> Uint8 | None:
        """Return what became of each pixel of an accepted view: that of the node that carries it."""
        shape, (_, unreliable) = self._shown(document)
        state = states_of_nodes(shape, unreliable, taken_off)
        observation = shape.observations[shape.views.index(frame.view_index)]
        surface = self.seen.surfaces(shape)[frame.view_index]
        carried = states_on_surface(observation, surface, state, self._config.flattening)
        return states_of_view(frame, item, surface, carried)

    def surface_edges(self, document: Document) -> Cloth:
        """Return the edges of the joint flattening, each once per view that saw it."""
        return _edges_of(self._shown(document)[0])

    def cloth_of_pieces(self, document: Document) -> list[Cloth]:
        """Return the edges of each piece, the shape first."""
        shape = self._shown(document)[0]
        return [_edges_of(shape, piece) for piece in np.unique(shape.piece[shape.piece >= 0]).tolist()]


def _relaid_by(seamed: Seamed) -> JointShape:
    """Return this side as in the joint layout of both sides, if its own pairs fit better there.

    A tube of two sheets is stiffer than one of them, whose separate minimisation may have ended in a local
    minimum.
    """
    both, this, n = seamed.both, seamed.this, len(seamed.this.nodes)
    held = this.placed & (both.piece[:n] == 0)
    relaid = replace(this, all_uv_m=np.where(held[:, None], both.all_uv_m[:n], this.all_uv_m))
    return relaid if _misfit(relaid) < _misfit(this) else this


def _misfit(shape: JointShape) -> float:
    used = both_ends(shape.placed, shape.links.edges) & ~shape.is_cut
    return misfit(shape.all_uv_m, shape.links, np.flatnonzero(used))


def _on_shown(seams: Sequence[Seam], alone: JointShape, shown: JointShape) -> tuple[Seam, ...]:
    """Return seams at their places on the shape as it is shown, moved as the nodes next to them."""
    placed = np.flatnonzero(alone.placed)
    tree, moved_m = cKDTree(alone.uv_m[placed]), (shown.all_uv_m - alone.all_uv_m)[placed]
    return tuple(
        seam
        if seam.this_piece
        else replace(seam, this_uv_m=seam.this_uv_m + moved_m[tree.query(seam.this_uv_m)[1]])
        for seam in seams
    )


def _edges_of(shape: JointShape, piece: int = 0) -> Cloth:
    uv_m = np.where((shape.piece == piece)[:, None], shape.all_uv_m, np.nan)
    return Cloth(
        uv_m=uv_m - np.nanmean(uv_m, axis=0) if piece else uv_m,  # floating pieces lie metres away
        xyz_m=shape.nodes.xyz_m,
        edges=shape.links.edges,
        length_m=shape.links.length_m,
        evidence=shape.evidence,
        view_index=np.array(shape.views, dtype=np.int32)[shape.links.observation],
    )


def _no_plan(reason: str, rated: Sequence[Candidate] = ()) -> Plan:
    candidates = tuple(rated)
    return Plan(view_index=None, side=None, rotation_deg=0.0, reason=reason, sides=(), candidates=candidates)
