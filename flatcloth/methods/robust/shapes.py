"""The joint shapes of a session's documents: registration, extension by accepted views, compositing.

Everything is computed from a document and cached by its prefix, so undo is exact.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from weakref import WeakValueDictionary

import numpy as np

from flatcloth.core.cache import Cache, size_in_bytes
from flatcloth.core.errors import FlatclothError
from flatcloth.core.geometry import Rigid3, fit_rigid2
from flatcloth.core.types import Bool, Float32, Float64, Int32, RgbdFrame, Rigid2, Uint8
from flatcloth.flattening.pixel_states import PixelState, states_of_view
from flatcloth.flattening.surface import Surface
from flatcloth.methods.base import Canonical, JoinedPiece, Views
from flatcloth.methods.robust.compositing import composite, floating_pieces, pixel_cost, states_on_surface
from flatcloth.methods.robust.joint import (
    JointShape,
    begin_joint,
    extend_joint,
    settled,
    taken_apart,
    with_largest_piece,
    with_poses,
)
from flatcloth.methods.robust.observations import Association, Observation, associate
from flatcloth.methods.robust.uncertainty import placement_std_m, undetermined, with_placement_std
from flatcloth.registration.cameras import Registered, begin_registration, extend_registration
from flatcloth.registration.view_features import ViewFeatures, extract_features
from flatcloth.session.machine import Accepted, Document

_GATE_M = 0.025
"""Nodes farther than this from their position by the placement do not count as the same cloth. Set by
hand."""

_LEAST_FITTED = 4
"""So many nodes of a component fit one motion, or it is not joined yet: a motion takes two, ..."""
_LEAST_FURTHER = 12
"""... a further motion of the same component as many as make a floating piece. Set by hand."""

_MIB = 1 << 20
"""Bytes in a mebibyte. By definition."""
_MOST_PREFIXES, _PREFIX_BYTES = 96, 64 * _MIB
"""Shapes that are kept for undo, trials and exports, which go through all of them: if they do not fit, each
is computed anew. 35 views of shirt-sleeve-clean with all their prefixes take 47 MiB ..."""
_DRAWN_BYTES = 28 * _MIB
"""... and a canonical view takes 13 MiB (``python -m benchmarks soak`` shows the whole). ..."""
_COSTS_BYTES, _CERTAINTIES_BYTES = 16 * _MIB, 6 * _MIB
"""... The costs of the pixels of a view take 0.4 MiB, the standard deviations of a shape 50 KiB."""


@dataclass(frozen=True, kw_only=True)
class _Places:
    """Where nodes lie in a view's own plane, ``uv_m`` (K, 2), and on which ``component`` (K,) of it."""

    uv_m: Float64
    component: Int32


class JointShapes:
    """The joint shape of each document, and the canonical view composited from it.

    Parameters
    ----------
    views : Views
        Single views.
    """

    def __init__(self, views: Views) -> None:
        self._views, self._config = views, views.config
        self._shapes: Cache[JointShape] = Cache(3)
        self._prefixes: Cache[JointShape] = Cache(_MOST_PREFIXES, _PREFIX_BYTES, _own_bytes)
        self._drawn: Cache[Canonical] = Cache(16, _DRAWN_BYTES)
        self._costs: Cache[Float32] = Cache(_MOST_PREFIXES, _COSTS_BYTES)
        self._settled: Cache[JointShape] = Cache(2)
        self._certainties: Cache[tuple[Float64, Bool]] = Cache(_MOST_PREFIXES, _CERTAINTIES_BYTES)
        # Registrations keep the features of their views, and these the surfaces: each exists once.
        self._registrations: Cache[Registered] = Cache(4)
        self._features: WeakValueDictionary[int, ViewFeatures] = WeakValueDictionary()
        self._component_maps: Cache[Int32] = Cache(48)
        self._places: Cache[_Places] = Cache(2 * _MOST_PREFIXES)
        self._associations: Cache[tuple[JointShape, Rigid3, Association]] = Cache(2)

    def shape(self, document: Document) -> JointShape:
        """Return the joint shape of a document's accepted views."""
        if document.start_view is None:
            raise FlatclothError("There is no start view yet; start the session first.")
        return self._shapes.get(prefix(document), lambda: self._grown(document))

    def settled(self, document: Document) -> JointShape:
        """Return the joint shape, relaxed as a whole: what is shown and exported."""
        return self._settled.get(prefix(document), lambda: settled(self.shape(document)))

    def _grown(self, document: Document) -> JointShape:
        """Extend the longest prefix of the decisions whose shape is kept."""
        assert document.start_view is not None
        start, *steps = prefix(document)
        known, made = self._prefixes.longest(start, steps)
        if made is None:
            made = self._kept((start,), self._begin(document.start_view))
        whole = self._shapes.kept((start, *steps[:known]))
        # What is derived from the kept one would stay in memory with it; one of the last has it already.
        made = replace(made) if whole is None else whole
        for n in range(known, len(steps)):
            before, step = (start, *steps[:n]), steps[n]
            if isinstance(step, Accepted):
                made = self._kept((*before, step), self._extend(before, made, step))
            else:
                made = with_largest_piece(made)
        return made

    def _kept(self, key: Hashable, made: JointShape) -> JointShape:
        """Keep a shape for those that begin with it, without what is derived from it, and return it."""
        self._prefixes.put(key, replace(made))
        self._observed_places(key, made.observations[-1])  # while its view is cached
        return made

    def _observed_places(self, key: Hashable, observation: Observation) -> _Places:
        """Return the places of the last observed nodes in their view (cached)."""
        return self._places.get(key, lambda: self._places_in_view(observation.view_index, observation.rc))

    def _places_in_view(self, view_index: int, rc: Float64) -> _Places:
        """Return the places of nodes that a view shows at positions ``rc`` (K, 2) of its image."""
        pixel = np.rint(rc).astype(np.int32)
        return _Places(
            uv_m=self._views.flattening(view_index).carrier.place(pixel),
            component=self.component_of_pixel(view_index)[pixel[:, 0], pixel[:, 1]],
        )

    def canonical(self, document: Document) -> Canonical:
        """Return the canonical view, composited from the joint shape, with its floating pieces."""

        def make() -> Canonical:
            return self._draw(document, self.settled(document), self._certainty_of(document))

        return self._drawn.get(prefix(document), make)

    def apart(self, document: Document, parts: Sequence[Bool]) -> tuple[Canonical, JointShape]:
        """Return the canonical view without ``parts`` (N,) of the nodes, which float, and its joint shape."""
        shape = taken_apart(self.settled(document), parts)
        return self._draw(document, shape, self._certainty(shape), np.any(parts, axis=0)), shape

    def pixel_states(
        self, document: Document, frame: RgbdFrame, item: Bool, taken_off: Bool | None = None
    ) -> Uint8:
        """Return what became of each pixel (H, W) of an accepted view."""
        shape = self.settled(document)
        _, unreliable = self._certainty_of(document)
        state = np.full(len(shape.nodes), PixelState.NO_CHAIN, dtype=np.uint8)
        state[shape.has_place & (shape.piece >= 0)] = PixelState.FLOATING
        state[shape.placed & ~unreliable] = PixelState.SHAPE
        if taken_off is not None:
            state[taken_off & (state == PixelState.SHAPE)] = PixelState.FLOATING
        observation = shape.observations[shape.views.index(frame.view_index)]
        surface = self.surfaces(shape)[frame.view_index]
        carried = states_on_surface(observation, surface, state, self._config.flattening)
        return states_of_view(frame, item, surface, carried)

    def _certainty_of(self, document: Document) -> tuple[Float64, Bool]:
        """Return the standard deviation of each node's place (N,), and which it leaves undetermined."""
        return self._certainties.get(prefix(document), lambda: self._certainty(self.settled(document)))

    def _certainty(self, shape: JointShape) -> tuple[Float64, Bool]:
        std = placement_std_m(shape, self._views.held_point_m)
        return std, undetermined(shape, std)

    def surfaces(self, shape: JointShape) -> dict[int, Surface]:
        """Return the surfaces of a shape's views."""
        # Registrations keep them, so a view that is no longer cached is not flattened again.
        kept = [self._features.get(view) for view in shape.views]
        features = [seen for seen in kept if seen is not None]
        if len(features) < len(kept):
            features = list(self.registered(shape.views).features)
        return {seen.view_index: seen.surface for seen in features if seen.surface is not None}

    def registered(self, views: tuple[int, ...]) -> Registered:
        """Return the registered cameras of views that were accepted in this order (cached)."""
        if not views:
            return begin_registration(self._views.axis, self._views.held_point_m)

        def make() -> Registered:
            return extend_registration(self.registered(views[:-1]), self._view_features(views[-1]))

        return self._registrations.get(views, make)

    def poses(self, views: tuple[int, ...]) -> tuple[Rigid3, ...]:
        """Return ``held_from_camera`` of each view: as recorded unless the views show otherwise."""
        registered = self.registered(views)
        return registered.held_from_camera if registered.is_loose else registered.known

    def _view_features(self, view_index: int) -> ViewFeatures:
        kept = self._features.get(view_index)
        if kept is None:
            made = extract_features(self._views.flattening(view_index).surface)
            kept = self._features.setdefault(view_index, made)
        return kept

    def _begin(self, start: int) -> JointShape:
        flattening = self._views.flattening(start)
        uv, _ = flattening.carrier.place_all()
        uv[self.component_of_pixel(start) != 0] = np.nan
        return begin_joint(flattening.surface, self.poses((start,))[0], uv, self._config.flattening)

    def associated(self, document: Document, view_index: int) -> tuple[JointShape, Rigid3, Association]:
        """Return the shape, a view's registered pose, and the nodes that the view shows."""
        return self._associated(prefix(document), self.shape(document), view_index)

    def _associated(
        self, key: Hashable, shape: JointShape, view_index: int
    ) -> tuple[JointShape, Rigid3, Association]:
        def make() -> tuple[JointShape, Rigid3, Association]:
            *before, held = self.poses((*shape.views, view_index))
            moved = with_poses(shape, tuple(before))
            surface = self._views.flattening(view_index).surface
            return moved, held, associate(moved.nodes, surface, held)

        return self._associations.get((key, view_index), make)

    def _extend(self, key: Hashable, shape: JointShape, added: Accepted) -> JointShape:
        surface = self._views.flattening(added.view_index).surface
        shape, held, associated = self._associated(key, shape, added.view_index)
        places = self._places_in_view(added.view_index, associated.rc)
        joined = self._joined_piece(shape, associated, places, added)
        if joined is not None:
            shape = _with_piece_moved(shape, joined)
        associated, by_hand = self._trusted(shape, associated, places, added, joined is not None)
        placed = self.component_of_pixel(added.view_index) == added.component if by_hand else None
        return extend_joint(shape, surface, held, self._config.flattening, associated, placed)

    def _trusted(
        self, shape: JointShape, associated: Association, places: _Places, added: Accepted, joins_piece: bool
    ) -> tuple[Association, bool]:
        """Keep the nodes whose position on the plane fits the accepted placement, by component.

        Overlapping layers are at one place in space, and a component may show two of them, or cloth of the
        shape beside cloth of a floating piece. Nodes that fit a rigid motion on the plane are kept; the
        remaining nodes may fit another motion. If the operator placed a component where few associated
        nodes lie, the nodes under it on the plane are used instead; if it joins a piece, besides.
        Returns whether that is so, too.
        """
        own, component = places.uv_m, places.component
        target = shape.all_uv_m[associated.node]
        known = np.isfinite(target[:, 0]) & np.isfinite(own[:, 0])
        kept = np.ones(len(own), dtype=bool)
        at = np.flatnonzero(known & (component == added.component))
        off = np.linalg.norm(added.current_from_new.apply(own[at]) - target[at], axis=1)
        kept[at] = off <= _GATE_M
        by_hand = joins_piece or (added.fixed and kept[at].sum() <= 0.5 * at.size)
        for number in np.unique(component):
            at = np.flatnonzero(known & (component == number))
            if number == added.component:
                at = at[~kept[at]]
            for piece in np.unique(shape.piece[associated.node[at]]):
                there = at[shape.piece[associated.node[at]] == piece]
                for least in (_LEAST_FURTHER if number == added.component else _LEAST_FITTED, _LEAST_FURTHER):
                    kept[there] = _consistent(own[there], target[there], _GATE_M, least)
                    there = there[~kept[there]]
        if not by_hand:
            return _chosen(associated, kept), False
        under = self._nodes_under(shape, added)
        if joins_piece:
            under = _chosen(under, ~np.isin(under.node, associated.node[kept]))
        else:
            kept &= (component != added.component) & ~np.isin(associated.node, under.node)
        others = _chosen(associated, kept)
        together = Association(
            node=np.concatenate([others.node, under.node]),
            rc=np.concatenate([others.rc, under.rc]),
            incidence_deg=np.concatenate([others.incidence_deg, under.incidence_deg]),
        )
        return together, True

    def joined_piece(self, document: Document, added: Accepted) -> JoinedPiece | None:
        """Return the floating piece that a view joins to the shape if it is accepted where it lies."""
        shape, _, associated = self.associated(document, added.view_index)
        places = self._places_in_view(added.view_index, associated.rc)
        return self._joined_piece(shape, associated, places, added)

    def _joined_piece(
        self, shape: JointShape, associated: Association, places: _Places, added: Accepted
    ) -> JoinedPiece | None:
        """Return the floating piece that a component placed by hand joins to the shape, if there is one.

        It is the one to which most of the component's nodes belong, if they fit one motion and the component
        lies on cloth of the shape. The piece is kept as it was grown, so the other views that show it need
        not be placed one by one.
        """
        if not added.fixed or not (shape.piece[self._nodes_under(shape, added).node] == 0).any():
            return None
        own, target = places.uv_m, shape.all_uv_m[associated.node]
        piece = shape.piece[associated.node]
        known = np.isfinite(target[:, 0]) & np.isfinite(own[:, 0]) & (places.component == added.component)
        if not (known & (piece > 0)).any():
            return None
        number = int(np.bincount(piece[known & (piece > 0)]).argmax())
        at = np.flatnonzero(known & (piece == number))
        if at.size < 0.5 * known.sum():
            return None
        fits = at[_consistent(own[at], target[at], _GATE_M, _LEAST_FURTHER)]
        if not fits.size:
            return None
        from_own = fit_rigid2(own[fits], target[fits])
        return JoinedPiece(
            piece=number,
            center_uv_m=shape.all_uv_m[shape.piece == number].mean(axis=0),
            target_from_piece=added.current_from_new @ from_own.inverse(),
        )

    def _nodes_under(self, shape: JointShape, added: Accepted) -> Association:
        """Return the nodes on the plane under the component that the operator placed."""
        view = self._views.flattening(added.view_index).components[added.component].view
        surface = self._views.flattening(added.view_index).surface
        placed = np.flatnonzero(shape.has_place).astype(np.int32)
        there = added.current_from_new.inverse().apply(shape.all_uv_m[placed])
        rc = np.rint(view.rc_from_uv(there)).astype(int)
        inside: Bool = np.asarray(((rc >= 0) & (rc < view.shape)).all(axis=1))
        inside[inside] = view.valid[rc[inside, 0], rc[inside, 1]]
        source = view.source_rc[rc[inside, 0], rc[inside, 1]].astype(np.float64)
        source -= np.asarray(surface.frame.offset_rc)
        quality = view.quality
        assert quality is not None
        incidence = quality[rc[inside, 0], rc[inside, 1], 1].astype(np.float64)
        return Association(node=placed[inside], rc=source, incidence_deg=incidence)

    def _draw(
        self,
        document: Document,
        shape: JointShape,
        certainty: tuple[Float64, Bool],
        taken_off: Bool | None = None,
    ) -> Canonical:
        """Draw a shape with the certainties of its nodes, of which some (N,) were taken off it."""
        surfaces, c = self.surfaces(shape), self._config
        interval = c.flattening.sampling_intervals_px[-1]
        size = c.flattening.pixel_size_m
        std, unreliable = certainty
        places = floating_pieces(shape, unreliable)
        costs = {view: self._costs_of(view, surface) for view, surface in surfaces.items()}
        reliable, *pieces = [
            composite(shape, surfaces, self._views.axis, interval, size, costs, uv)
            for uv in (np.where(unreliable[:, None], np.nan, shape.uv_m), *places)
        ]
        view = with_placement_std(reliable, shape, np.where(unreliable, np.nan, std), surfaces)
        least = c.surface.min_component_area_m2
        kept = [(uv, p) for uv, p in zip(places, pieces, strict=True) if p.area_m2 >= least]
        return Canonical(
            view=view,
            current_from_view=self._rigid(document, shape),
            floating=tuple(piece for _, piece in kept),
            taken_off=frozenset(
                n
                for n, (uv, _) in enumerate(kept)
                if taken_off is not None and taken_off[np.isfinite(uv[:, 0])].mean() > 0.5
            ),
        )

    def _costs_of(self, view_index: int, surface: Surface) -> Float32:
        return self._costs.get(view_index, lambda: pixel_cost(surface))

    def _rigid(self, document: Document, shape: JointShape) -> dict[int, Rigid2]:
        """Return for each view the rigid motion closest to the joint shape's effect on its component."""
        motions, steps = {}, prefix(document)
        keys = [steps[: n + 1] for n, step in enumerate(steps) if step != _LARGEST]
        for key, observation in zip(keys, shape.observations, strict=True):
            view, there = observation.view_index, shape.all_uv_m[observation.node]
            own = self._observed_places(key, observation)
            good = (
                (own.component == document.placed_components.get(view, 0))
                & np.isfinite(own.uv_m[:, 0])
                & np.isfinite(there[:, 0])
            )
            motions[view] = fit_rigid2(own.uv_m[good], there[good]) if good.sum() > 2 else Rigid2()
        return motions

    def component_of_pixel(self, view_index: int) -> Int32:
        """Return the component of each pixel (H, W) of a view, -1 for none."""

        def make() -> Int32:
            flattening = self._views.flattening(view_index)
            level, nearest = flattening.levels[-1], flattening.carrier.nearest
            number = np.full(int(level.component.max(initial=0)) + 2, -1, dtype=np.int32)
            for n, component in enumerate(flattening.components):
                number[level.component[component.members[0]]] = n
            return number[np.where(nearest >= 0, level.component[nearest], -1)]

        return self._component_maps.get(view_index, make)


def _with_piece_moved(shape: JointShape, joined: JoinedPiece) -> JointShape:
    """Return the shape with a floating piece as a part of the main one, where the operator placed it."""
    own = shape.piece == joined.piece
    uv = np.where(own[:, None], joined.target_from_piece.apply(shape.all_uv_m), shape.all_uv_m)
    piece = np.where(own, 0, shape.piece).astype(np.int32)
    return shape.with_same_pairs(all_uv_m=uv, piece=piece, by_hand=shape.by_hand | own)


_LARGEST = "the largest piece becomes the shape"


def prefix(document: Document) -> tuple[Hashable, ...]:
    """Return the part of a document that its shape depends on: the start view, then the steps from there."""
    steps: list[Hashable] = [document.start_view]
    for n in range(len(document.accepted) + 1):
        steps += [_LARGEST] * (n in document.largest_after)
        steps += document.accepted[n : n + 1]
    return tuple(steps)


def _own_bytes(shape: JointShape) -> int:
    """Return the memory of a shape; earlier observations are those of the shape that it extends."""
    return size_in_bytes(replace(shape, observations=shape.observations[-1:]))


def _chosen(associated: Association, at: Bool) -> Association:
    return Association(
        node=associated.node[at], rc=associated.rc[at], incidence_deg=associated.incidence_deg[at]
    )


def _consistent(points: Float64, target: Float64, gate_m: float, least: int) -> Bool:
    """Return which points fit a common motion to their targets; none if fewer than half or ``least`` do."""
    none = np.zeros(len(points), dtype=np.bool_)
    if len(points) < least:
        return none
    kept = np.ones(len(points), dtype=np.bool_)
    for _ in range(6):
        off = np.linalg.norm(fit_rigid2(points[kept], target[kept]).apply(points) - target, axis=1)
        closest = off <= max(0.5 * gate_m, float(np.median(off)))
        if (closest == kept).all():
            break
        kept = closest
    off = np.linalg.norm(fit_rigid2(points[kept], target[kept]).apply(points) - target, axis=1)
    fits: Bool = off <= gate_m
    return fits if fits.mean() >= 0.5 and fits.sum() >= least else none
