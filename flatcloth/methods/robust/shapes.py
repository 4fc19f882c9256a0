"""Bookkeeping of the method ``robust``: what is known of single views, and the joint shapes of documents.

The algorithm is in :mod:`flatcloth.methods.robust.method`. Everything here is computed from a document and
cached by its prefix, so undo is exact.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import replace
from weakref import WeakKeyDictionary, WeakValueDictionary

import numpy as np

from flatcloth.core.cache import Cache, size_in_bytes
from flatcloth.core.errors import FlatclothError
from flatcloth.core.geometry import Rigid3, fit_rigid2
from flatcloth.core.types import Bool, Float32, Float64, Int32, Rigid2
from flatcloth.flattening.surface import Surface
from flatcloth.methods.base import Views
from flatcloth.methods.robust.acceptance import PlacesInView
from flatcloth.methods.robust.compositing import pixel_cost
from flatcloth.methods.robust.connectivity import NO_LINKS, links_of
from flatcloth.methods.robust.joint import settled
from flatcloth.methods.robust.joint_shape import JointShape, with_largest_piece, with_poses
from flatcloth.methods.robust.observations import Association, Observation, associate
from flatcloth.methods.robust.uncertainty import lengthened, placement_std_m, undetermined
from flatcloth.registration.cameras import Fits, register
from flatcloth.registration.registered import Registered
from flatcloth.registration.view_features import ViewFeatures, extract_features
from flatcloth.session.document import Accepted, Document

MOST_KEPT = 64
"""Values that are kept of each kind (shapes, scores). Chosen: more than the views of a session."""
KEPT_BYTES = 48 * 2**20
"""Memory of the shapes that are kept for undo, trials and exports. Chosen: the shapes after each of
35 views of shirt-sleeve-clean take less."""

LARGEST = "the largest piece becomes the shape"
"""The step of a prefix that is no accepted view."""

Certainty = tuple[Float64, Bool]
"""The standard deviation (N,) of each node's position, and which nodes (N,) are not determined."""


def prefix(document: Document) -> tuple[Hashable, ...]:
    """Return the part of a document that its shape depends on: the start view, then the steps from there."""
    steps: list[Hashable] = [document.start_view]
    for n in range(len(document.accepted) + 1):
        steps += [LARGEST] * (n in document.largest_after)
        steps += document.accepted[n : n + 1]
    return tuple(steps)


class RegisteredViews:
    """The single views of a recording with their registered cameras (cached).

    Parameters
    ----------
    views : Views
        Single views.

    Attributes
    ----------
    confirmed : Registered or None
        Cameras of the same recording, registered by the other side of the item, that confirm the recorded
        poses; no views are compared then.
    """

    def __init__(self, views: Views) -> None:
        self._views = views
        self.confirmed: Registered | None = None
        self._fits: Fits = {}
        # Registrations keep the features of their views, and these the surfaces: each exists once.
        self._registrations: Cache[Registered] = Cache(4)
        self._registered: WeakValueDictionary[frozenset[int], Registered] = WeakValueDictionary()
        self._features: WeakValueDictionary[int, ViewFeatures] = WeakValueDictionary()
        self._poses: Cache[dict[int, Rigid3]] = Cache(MOST_KEPT)  # small: release() keeps them
        self._component_maps: Cache[Int32] = Cache(2)
        self._costs: Cache[Float32] = Cache(MOST_KEPT)
        self._observed: WeakKeyDictionary[Observation, PlacesInView] = WeakKeyDictionary()
        self._associations: Cache[tuple[JointShape, Rigid3, Association]] = Cache(1)

    def release(self, *, surfaces: bool) -> None:
        """Free what only the search for placements needs; with ``surfaces``, also those of all views."""
        self._associations.drop()
        self._component_maps.drop()
        if surfaces:
            self._registrations.drop()
            self._costs.drop()

    def registered(self, views: Iterable[int]) -> Registered:
        """Return the registered cameras of a set of views, which are sorted."""
        asked = frozenset(views)

        def make() -> Registered:
            alive = self._registered.get(asked)  # an export of the whole session holds its last one
            if alive is None:
                alive = register(
                    [self._view_features(view) for view in sorted(asked)],
                    self._views.axis,
                    self._views.held_point_m,
                    self._fits,
                    confirmed=self.confirmed,
                )
                self._registered[asked] = alive
            return alive

        return self._registrations.get(asked, make)

    def poses(self, views: tuple[int, ...]) -> tuple[Rigid3, ...]:
        """Return ``object_from_camera`` of each view: as recorded unless the views show otherwise."""
        asked = frozenset(views)

        def make() -> dict[int, Rigid3]:
            registered = self.registered(asked)
            poses = registered.object_from_camera if registered.is_loose else registered.known
            return dict(zip(registered.view_indices, poses, strict=True))

        found = self._poses.get(asked, make)
        return tuple(found[view] for view in views)

    def _view_features(self, view_index: int) -> ViewFeatures:
        kept = self._features.get(view_index)
        if kept is None:
            made = extract_features(self._views.flattening(view_index).surface)
            kept = self._features.setdefault(view_index, made)
        return kept

    def surfaces(self, shape: JointShape) -> dict[int, Surface]:
        """Return the surfaces of a shape's views."""

        def of(view: int) -> Surface:
            seen = self._features.get(view)  # registrations keep them, if they were not released
            return self._views.surface(view) if seen is None or seen.surface is None else seen.surface

        return {view: of(view) for view in shape.views}

    def pixel_costs(self, surfaces: Mapping[int, Surface]) -> dict[int, Float32]:
        """Return the cost (H, W) of each pixel of views, by which they are composited."""

        def of(view: int, surface: Surface) -> Float32:
            return self._costs.get(view, lambda: pixel_cost(surface))

        return {view: of(view, surface) for view, surface in surfaces.items()}

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

    def places(self, view_index: int, rc: Float64) -> PlacesInView:
        """Return the places of nodes that a view shows at positions ``rc`` (K, 2) of its image."""
        pixel = np.rint(rc).astype(np.int32)
        return PlacesInView(
            uv_m=self._views.flattening(view_index).carrier.place(pixel),
            component=self.component_of_pixel(view_index)[pixel[:, 0], pixel[:, 1]],
        )

    def observed_places(self, observation: Observation) -> PlacesInView:
        """Return the places of observed nodes in their view, kept as long as the observation."""
        kept = self._observed.get(observation)
        if kept is None:
            made = self.places(observation.view_index, observation.rc)
            kept = self._observed.setdefault(observation, made)
        return kept

    def associated(self, shape: JointShape, view_index: int) -> tuple[JointShape, Rigid3, Association]:
        """Register a view's camera; return the shape with its poses, the view's, and the nodes it shows."""

        def make() -> tuple[JointShape, Rigid3, Association]:
            *before, held = self.poses((*shape.views, view_index))
            moved = with_poses(shape, tuple(before))
            surface = self._views.flattening(view_index).surface
            return moved, held, associate(moved.nodes, surface, held)

        return self._associations.get((shape, view_index), make)

    def current_from_view(self, shape: JointShape, components: Mapping[int, int]) -> dict[int, Rigid2]:
        """Return for each view the rigid motion closest to the joint shape's effect on its component.

        ``components`` are the placed ones, by view; by default the largest.
        """
        motions = {}
        for observation in shape.observations:
            view, there = observation.view_index, shape.all_uv_m[observation.node]
            own = self.observed_places(observation)
            good = (
                (own.component == components.get(view, 0))
                & np.isfinite(own.uv_m[:, 0])
                & np.isfinite(there[:, 0])
            )
            motions[view] = fit_rigid2(own.uv_m[good], there[good]) if good.sum() > 2 else Rigid2()
        return motions


class JointShapes:
    """The joint shape of each document, cached by prefix.

    Parameters
    ----------
    begin : callable
        Returns the shape of a start view.
    extend : callable
        Returns a shape with one more accepted view.
    held_point_m : (3,) float64
        Held point, object frame.
    """

    def __init__(
        self,
        begin: Callable[[int], JointShape],
        extend: Callable[[JointShape, Accepted], JointShape],
        held_point_m: Float64,
    ) -> None:
        self._begin, self._extend, self._held_point_m = begin, extend, held_point_m
        self._shapes: Cache[JointShape] = Cache(2)
        self._prefixes: Cache[JointShape] = Cache(MOST_KEPT, KEPT_BYTES, _own_bytes)
        self._settled: Cache[JointShape] = Cache(2)
        self._certainties: Cache[Certainty] = Cache(2)

    def release(self) -> None:
        """Free the shapes that are kept for undo and trials; settled ones stay."""
        for kept in (self._shapes, self._prefixes):
            kept.drop()

    def shape(self, document: Document) -> JointShape:
        """Return the joint shape of a document's accepted views."""
        if document.start_view is None:
            raise FlatclothError("There is no start view yet; start the session first.")
        return self._shapes.get(prefix(document), lambda: self._grown(document))

    def settled(self, document: Document) -> JointShape:
        """Return the joint shape, relaxed as a whole: what is shown and exported."""
        return self._settled.get(prefix(document), lambda: lengthened(settled(self.shape(document))))

    def certainty(self, document: Document) -> Certainty:
        """Return the certainty of the nodes of the settled shape."""
        return self.certainty_of(self.settled(document))

    def certainty_of(self, shape: JointShape) -> Certainty:
        """Return the certainty of the nodes of any shape (cached)."""

        def make() -> Certainty:
            std = placement_std_m(shape, self._held_point_m)
            return std, undetermined(shape, std)

        return self._certainties.get(shape, make)

    def _grown(self, document: Document) -> JointShape:
        """Extend the longest prefix of the decisions whose shape is kept."""
        assert document.start_view is not None
        start, *steps = prefix(document)
        known, kept = self._prefixes.longest(start, steps)
        made = self._shapes.kept((start, *steps[:known]))
        if made is None and kept is not None:
            made = replace(kept, links=links_of(kept.observations))
        if made is None:
            made = self._begin(document.start_view)
            self._prefixes.put((start,), _without_pairs(made))
        for n, step in enumerate(steps[known:], known):
            if isinstance(step, Accepted):
                made = self._extend(made, step)
                self._prefixes.put((start, *steps[:n], step), _without_pairs(made))
            else:
                made = with_largest_piece(made)
        return made


def _without_pairs(shape: JointShape) -> JointShape:
    """Return a shape to be kept: its pairs, which follow from its observations, take most of its memory."""
    return replace(shape, links=NO_LINKS)


def _own_bytes(shape: JointShape) -> int:
    """Return the memory of a shape; earlier observations are those of the shape that it extends."""
    return size_in_bytes(replace(shape, observations=shape.observations[-1:]))
