"""The method ``robust``: one shape of all views, computed from the set of them.

Start at :mod:`flatcloth.shape.algorithm`, which tells the computation in order; here is what a session asks
of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from flatcloth.core.cache import Cache
from flatcloth.core.errors import AlignmentError
from flatcloth.core.geometry import Rigid3
from flatcloth.core.types import (
    Bool,
    Float64,
    Int32,
    LaidPiece,
    Progress,
    RgbdFrame,
    Rigid2,
    Uint8,
    no_progress,
)
from flatcloth.flattening.cloth import Cloth
from flatcloth.flattening.pixel_states import states_of_view
from flatcloth.methods.answers import (
    Alignment,
    AlignmentScore,
    Canonical,
    ClothPairs,
    ComponentPlacement,
    JoinedPiece,
    JoinedSides,
    OneSide,
    Placement,
    Plan,
)
from flatcloth.methods.base import Focus, Method, Views
from flatcloth.methods.paper.matching import SEARCH_POINTS
from flatcloth.methods.robust.next_best_view import inner_area_m2, rate_candidates, seams_ahead
from flatcloth.methods.robust.scoring import SampledComponent, cloth_pairs, refined, score_placement
from flatcloth.methods.robust.seams.joining import MOST_STD_M, Seamed, join_sides, other_of, seams_of
from flatcloth.methods.robust.shapes import MOST_KEPT, RegisteredViews, Shapes, shape_key
from flatcloth.methods.starting import overlap_area_m2, start_by_view
from flatcloth.registration.registered import Registered
from flatcloth.session.document import Accepted, Document, Side
from flatcloth.shape.algorithm import as_decided
from flatcloth.shape.drawing import draw, states_of_nodes, states_on_surface
from flatcloth.shape.joints import DecidedParts
from flatcloth.shape.observations import associate
from flatcloth.shape.shape import Shape, change_by, of_views


class RobustMethod(Method):
    """The algorithm of ``docs/robust.md``; see :class:`flatcloth.methods.base.Method`."""

    name = "robust"
    joins_sides = True
    takes_all = True

    def __init__(self, views: Views, angles_deg: Sequence[float]) -> None:
        self.angles_deg = angles_deg
        self._views, self._config = views, views.config
        self.seen = RegisteredViews(views)
        self.shapes = Shapes(views, self.seen)
        self._components: Cache[dict[int, SampledComponent]] = Cache(4)
        self._alignments: Cache[dict[int, Alignment]] = Cache(4)
        self._scores: Cache[AlignmentScore] = Cache(MOST_KEPT)
        self._drawn: Cache[Canonical] = Cache(2)
        self._decided: Cache[Shape] = Cache(2)
        self._seamed: Cache[Seamed] = Cache(1)
        self._joined: Cache[JoinedSides] = Cache(2)

    # ------------------------------------------------- next best view (in place of the paper's 4.1)

    def start_view(self, progress: Progress = no_progress) -> int | None:
        """Start with the largest observed area, as the paper does."""
        return start_by_view(self._views, progress)

    def plan(self, document: Document, unusable: set[int]) -> Plan:
        """Choose the view with the largest expected new area, given enough overlap."""
        c = self._config.robust
        looked = document.used_views | document.refused_views | unusable
        rest = [v for v in range(len(self.angles_deg)) if v not in looked]
        if not rest:
            return Plan(view_index=None, reason="No view is left.")
        shape, overlap_m2 = self.shapes.of(document), overlap_area_m2(self._views)
        rated = rate_candidates(shape, self._views.axis, self.angles_deg, rest, looked, overlap_m2)
        best = rated[0]
        if best.new_m2 < c.least_new_m2:
            reason = f"No other view is expected to add more than {1e4 * best.new_m2:.0f} cm2."
            return Plan(view_index=None, reason=reason, candidates=tuple(rated))
        return Plan(
            view_index=best.view_index,
            reason=(
                f"{1e4 * best.new_m2:.0f} cm2 new, {1e4 * best.overlap_m2:.0f} cm2 in common"
                + ("" if best.overlap_m2 >= overlap_m2 else ", less than desired")
            ),
            candidates=tuple(rated),
        )

    def look_ahead(self, document: Document, angles_deg: Sequence[float], focus: Focus | None = None) -> Plan:
        """Rate rotations at which no view was taken yet by the expected new area."""
        recorded, overlap_m2 = len(self.angles_deg), overlap_area_m2(self._views)
        shape, free = self.shapes.of(document), range(recorded, len(angles_deg))
        rated = rate_candidates(
            shape, self._views.axis, angles_deg, free, range(recorded), overlap_m2, focus=focus
        )
        return Plan(
            view_index=rated[0].view_index,
            reason=f"{1e4 * rated[0].new_m2:.0f} cm2 new",
            candidates=tuple(rated),
        )

    def least_m2(self, document: Document) -> float:
        """Return the area of the canonical view but for its border, by its nodes."""
        return inner_area_m2(self.shapes.of(document))

    def seams_ahead(
        self, document: Document, other: Method, its: Document, angles_deg: Sequence[float], *, related: bool
    ) -> Float64:
        """Return the floating cloth (K,), m2, of which views at angles are expected to show seams."""
        assert isinstance(other, RobustMethod)
        shapes = self.shapes.of(document), other.shapes.of(its)
        return seams_ahead(shapes, self._views.axis, angles_deg, related=related)

    # ------------------------------------------------- a proposal: the shape with the view (in place of 4.2)

    def propose(
        self, document: Document, view_index: int, side: Side | None, progress: Progress = no_progress
    ) -> Placement:
        """Return where the shape with the view has each of its components, beside the shape without it."""
        progress(0.1, f"flattening view {view_index}")
        flattening = self._views.flattening(view_index)
        progress(0.4, "computing the shape with the view")
        shape, found = self.shapes.of(with_view(document, view_index)), self._found(document, view_index)
        sampled = self._sampled(document, view_index)
        parts = [
            ComponentPlacement(component=n, area_m2=own.area_m2, alignment=found.get(n))
            for n, own in sampled.items()
            if flattening.components[n].folded_share <= self._config.flattening.max_folded_share
        ]
        placed = [(part, part.alignment) for part in parts if part.alignment is not None]
        if not placed:
            folded = max((flattening.components[n].folded_share for n in sampled), default=0.0)
            raise AlignmentError(
                f"View {view_index}: its flattened view is folded ({folded:.0%} of it); choose another view."
                if sampled and not parts
                else f"View {view_index}: it has no cloth in common with the shape; choose another view."
            )
        best, alignment = max(placed, key=lambda of: of[1].score.total * math.sqrt(of[0].area_m2))
        return Placement(
            component=best.component,
            alignment=alignment,
            parts=tuple(parts),
            change=change_by(view_index, self.shapes.of(document), shape),
        )

    def _found(self, document: Document, view_index: int) -> dict[int, Alignment]:
        """Return the placements of a view's components, but those that float or are new (cached)."""
        return self._alignments.get(
            (shape_key(document), view_index), lambda: self._find(document, view_index)
        )

    def _find(self, document: Document, view_index: int) -> dict[int, Alignment]:
        """Find where the shape with a view has each of its components, and how well the other views agree.

        The score is by the other views' cloth in that shape; for display each lies on the shape without it.
        """
        before, shape = self.shapes.of(document), self.shapes.of(with_view(document, view_index))
        others = of_views(shape, document.used_views)
        drawn, found = self._sampled(document, view_index), {}
        for n, own in self._sample(others, view_index).items():
            initial = self.seen.current_from_component(shape, view_index, n)
            if initial is None or n not in drawn or not (own.node >= 0).any():
                continue
            found[n] = Alignment(
                initial=initial,
                current_from_new=refined(cloth_pairs(before, drawn[n]), initial),
                score=score_placement(others, own, initial),
            )
        return found

    def score(self, document: Document, view_index: int, component: int, motion: Rigid2) -> AlignmentScore:
        """Score a placement by the cloth that the view and the shape have in common (cached).

        Where the view hangs, by the shape with it; where it was moved to, by the shape that it was laid on.
        """

        def make() -> AlignmentScore:
            hangs = self._found(document, view_index).get(component)
            if hangs is not None and hangs.current_from_new == motion:
                return hangs.score
            sampled = self._sampled(document, view_index).get(component)
            if sampled is None:
                return AlignmentScore(0.0, {})
            return score_placement(self.shapes.of(document), sampled, motion)

        return self._scores.get((shape_key(document), view_index, component, motion), make)

    def refined(self, document: Document, view_index: int, component: int, motion: Rigid2) -> Rigid2:
        """Refine a placement by the cloth that it has in common with the shape."""
        return refined(self.pairs(document, view_index, component), motion)

    def pairs(self, document: Document, view_index: int, component: int) -> ClothPairs | None:
        """Return the nodes of the shape that the view shows, each with its place on the component."""
        sampled = self._sampled(document, view_index).get(component)
        return None if sampled is None else cloth_pairs(self.shapes.of(document), sampled)

    def _sampled(self, document: Document, view_index: int) -> dict[int, SampledComponent]:
        """Return the components of a view with the nodes of the shape that they show (cached)."""
        return self._components.get(
            (shape_key(document), view_index), lambda: self._sample(self.shapes.of(document), view_index)
        )

    def _sample(self, shape: Shape, view_index: int) -> dict[int, SampledComponent]:
        flattening = self._views.flattening(view_index)
        pose = self.seen.poses((*shape.views, view_index))[-1]
        shown = associate(shape.nodes, flattening.surface, pose)
        of_pixel = self.seen.component_of_pixel(view_index)
        pixel = np.rint(shown.rc).astype(np.int32)
        of_node = of_pixel[pixel[:, 0], pixel[:, 1]]
        found = {}
        for n, component in enumerate(flattening.components):
            inside, own = np.flatnonzero(of_pixel == n), np.flatnonzero(of_node == n)
            inside = inside[:: max(1, len(inside) // SEARCH_POINTS)]
            some = np.stack(np.unravel_index(inside, of_pixel.shape), axis=1).astype(np.int32)
            rc: Int32 = np.concatenate([some, pixel[own]])
            uv = flattening.carrier.place(rc)
            known = np.isfinite(uv[:, 0])
            if known.sum() >= 10:
                xyz = flattening.surface.xyz_m[rc[known, 0], rc[known, 1]].astype(np.float64)
                node = np.concatenate([np.full(len(some), -1, dtype=np.int32), shown.node[own]])
                found[n] = SampledComponent(
                    uv_m=uv[known], xyz_m=pose.apply(xyz), node=node[known], area_m2=component.view.area_m2
                )
        return found

    # ------------------------------------------------- the shape (in place of 4.3)

    def canonical(self, document: Document) -> Canonical:
        """Return the canonical view, composited from the shape, with its floating pieces."""
        shape = self.shapes.of(document)
        return self._drawn.get(shape, lambda: self._draw(document, shape))

    def earlier(self, earlier: Document, document: Document) -> Canonical:
        """Return the cloth that the views of an earlier state show, where the whole document has it."""
        return self._draw(earlier, of_views(self.shapes.of(document), earlier.used_views))

    def _as_decided(self, document: Document, parts: DecidedParts) -> Shape:
        """Return the shape after decisions about its parts (cached)."""
        shape = self.shapes.of(document)
        if not any(parts):
            return shape
        assert document.start_view is not None
        upright = document.start_view
        key = shape, *(tuple(part.tobytes() for part in each) for each in parts)
        return self._decided.get(key, lambda: as_decided(shape, parts, upright))

    def release(self, *, surfaces: bool = False) -> None:
        """Free what only further views need; with ``surfaces``, those of the views too."""
        for kept in (self._components, self._alignments):
            kept.drop()
        self.seen.release(surfaces=surfaces)

    def _draw(self, document: Document, shape: Shape, taken_off: Bool | None = None) -> Canonical:
        """Composite a shape with its deviations; some nodes (N,) were taken off it."""
        surfaces = self.seen.surfaces(shape)
        costs = self.seen.pixel_costs(surfaces)
        view, floating, are_off = draw(shape, surfaces, self._views.axis, self._config, costs, taken_off)
        return Canonical(
            view=view, current_from_view=_Motions(self, document, shape), floating=floating, taken_off=are_off
        )

    def as_decided(self, document: Document, parts: DecidedParts) -> tuple[Canonical, Cloth]:
        """Return the canonical view after decisions about its parts, and its edges."""
        shape = self._as_decided(document, parts)
        are_off = np.any(parts.taken_off, axis=0) if parts.taken_off else None
        return self._drawn.get(shape, lambda: self._draw(document, shape, are_off)), _edges_of(shape)

    # ------------------------------------------------- the other side

    def take_confirmed(self, cameras: Registered) -> None:
        """Compare no views: the cameras stand as recorded."""
        self.seen.confirmed = cameras

    def with_other_side(
        self, own: OneSide, laid: Sequence[LaidPiece], other: Method, its: OneSide, check: Callable[[], None]
    ) -> JoinedSides:
        """Join the other side, integrated by itself, along the seams (``docs/robust.md``, "Both sides")."""
        assert isinstance(other, RobustMethod)
        pieces = [(side.canonical.view, *side.canonical.floating) for side in (own, its)]
        seams = own.document.garment.seams
        check()
        shapes = self._as_decided(own.document, own.parts), other._as_decided(its.document, its.parts)
        seamed = other._seamed.get(  # where a garment lays floating pieces changes no seam
            (*shapes, seams),
            lambda: join_sides(*shapes, (pieces[0], pieces[1]), (own.ends(), its.ends()), seams, check),
        )

        def joined() -> JoinedSides:
            found = other_of(seamed, laid)
            check()
            drawn = other._draw(its.document, found.shape)
            if not found.is_related:  # it floats, and has no deviation from this side's shape
                drawn = replace(drawn, view=replace(drawn.view, placement_std_m=None))
            return JoinedSides(
                other=drawn,
                seams=seams_of(found, (drawn.view, *drawn.floating)),
                is_related=found.is_related,
                laid=tuple(piece for piece in found.laid if piece.std_m <= MOST_STD_M),
                unsure=frozenset(piece.index for piece in found.laid if piece.std_m > MOST_STD_M),
                weak=seamed.weak if found.is_related else (),
            )

        return other._joined.get((*shapes, seams, *laid), joined)

    # ------------------------------------------------- acceptance without an operator

    @property
    def accept_score(self) -> float:
        """The smallest accepted score (``docs/robust.md``, "Proposals")."""
        return self._config.robust.accept_confidence

    def why_unusable(self, view_index: int) -> str:
        """Return why a view shows too little cloth; empty if it shows enough."""
        return self.seen.why_unusable(view_index)

    # ------------------------------------------------- what the rest of the program asks

    def cameras(self, document: Document) -> Registered | None:
        """Return the registered cameras of the accepted views."""
        return self.seen.registered(self.seen.usable(document.used_views))

    def poses(self, document: Document) -> dict[int, Rigid3]:
        """Return the registered ``object_from_camera`` of each accepted view."""
        views = self.seen.usable(document.used_views)
        return dict(zip(views, self.seen.poses(views), strict=True))

    def joined_piece(self, document: Document) -> JoinedPiece | None:
        """Return the floating piece that the pending view joins to the shape where it lies."""
        pending = document.pending
        if pending is None or not pending.moved:
            return None
        added = Accepted(
            pending.view_index, pending.current_from_new, fixed=True, component=pending.component
        )
        return self.shapes.joined_piece(document, added)

    def pixel_states(
        self, document: Document, frame: RgbdFrame, item: Bool, taken_off: Bool | None = None
    ) -> Uint8 | None:
        """Return what became of each pixel of an accepted view: that of the node that carries it."""
        shape = self.shapes.of(document)
        state = states_of_nodes(shape, taken_off)
        if frame.view_index not in shape.views:
            return None
        observation = shape.observations[shape.views.index(frame.view_index)]
        surface = self.seen.surface(frame.view_index)
        carried = states_on_surface(observation, surface, state, self._config.flattening)
        return states_of_view(frame, item, surface, carried)

    def cloth_of_pieces(self, document: Document) -> list[Cloth]:
        """Return the edges of each piece, the shape first, each once per view that saw it."""
        shape = self.shapes.of(document)
        return [_edges_of(shape, piece) for piece in np.unique(shape.piece[shape.piece >= 0]).tolist()]


class _Motions(Mapping[int, Rigid2]):
    """The motion of each view's placed component to the plane, computed when it is asked for.

    It takes the view's own flattening, which nothing else of a shape needs.
    """

    def __init__(self, method: RobustMethod, document: Document, shape: Shape) -> None:
        self._method, self._components, self._shape = method, document.placed_components, shape
        self._found: dict[int, Rigid2] = {}

    def __getitem__(self, view_index: int) -> Rigid2:
        if view_index not in self._shape.views:
            raise KeyError(view_index)
        if view_index not in self._found:
            component = max(self._components.get(view_index, 0), 0)
            motion = self._method.seen.current_from_component(self._shape, view_index, component)
            self._found[view_index] = motion or Rigid2()
        return self._found[view_index]

    def __iter__(self) -> Iterator[int]:
        return iter(self._shape.views)

    def __len__(self) -> int:
        return len(self._shape.views)


def with_view(document: Document, view_index: int) -> Document:
    """Return a document with one more view, where its cloth hangs."""
    return replace(document, accepted=(*document.accepted, Accepted(view_index, Rigid2())))


def _edges_of(shape: Shape, piece: int = 0) -> Cloth:
    uv_m = np.where((shape.piece == piece)[:, None], shape.all_uv_m, np.nan)
    return Cloth(
        uv_m=uv_m - np.nanmean(uv_m, axis=0) if piece else uv_m,  # floating pieces lie metres away
        xyz_m=shape.nodes.xyz_m,
        edges=shape.links.edges,
        length_m=shape.links.length_m,
        evidence=shape.evidence,
        view_index=np.array(shape.views, dtype=np.int32)[shape.links.observation],
        is_noisy=any(seen.is_noisy for seen in shape.observations),
    )
