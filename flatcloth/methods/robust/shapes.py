"""The shapes of documents: single views with their registered cameras, and the decisions as plain data.

What a shape is computed from is the set of a document's views, and where the operator placed some of them;
:mod:`flatcloth.shape.algorithm` computes it. Everything is cached by that, so undo is exact.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from weakref import WeakValueDictionary

import numpy as np

from flatcloth.core.cache import Cache
from flatcloth.core.errors import FlatclothError, SurfaceError
from flatcloth.core.geometry import Rigid3, fit_rigid2
from flatcloth.core.types import Bool, Float32, Float64, Int32, Rigid2
from flatcloth.flattening.surface import Surface
from flatcloth.methods.answers import JoinedPiece
from flatcloth.methods.base import Views
from flatcloth.registration.axis import THREADS
from flatcloth.registration.cameras import Fits, register
from flatcloth.registration.registered import Registered
from flatcloth.registration.view_features import ViewFeatures, extract_features
from flatcloth.session.document import Accepted, Document
from flatcloth.shape.algorithm import shape
from flatcloth.shape.drawing import pixel_cost
from flatcloth.shape.hand import ByHand
from flatcloth.shape.observations import Association, PlacedView, associate
from flatcloth.shape.shape import TWO_ROWS_M, Shape

MOST_KEPT = 64
"""Values that are kept of each kind (poses, scores). Chosen: more than the views of a session."""


def shape_key(document: Document) -> tuple[Hashable, ...]:
    """Return what a document's shape depends on: the set of its views, the start view, and those placed by
    hand.
    """
    by_hand = tuple((a.view_index, a.component, a.current_from_new) for a in document.accepted if a.fixed)
    return document.start_view, document.used_views, by_hand


@dataclass(frozen=True, kw_only=True)
class PlacesInView:
    """Where nodes lie in a view's own plane, ``uv_m`` (K, 2), and on which ``component`` (K,) of it."""

    uv_m: Float64
    component: Int32


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
        self._registrations: Cache[Registered] = Cache(4)
        self._registered: WeakValueDictionary[frozenset[int], Registered] = WeakValueDictionary()
        self._features: dict[int, ViewFeatures] = {}  # with the surfaces
        self._unusable: dict[int, str] = {}
        self._poses: Cache[dict[int, Rigid3]] = Cache(MOST_KEPT)  # small: release() keeps them
        self._component_maps: Cache[Int32] = Cache(2)
        self._costs: Cache[Float32] = Cache(MOST_KEPT)

    def release(self, *, surfaces: bool) -> None:
        """Free what only proposals need; with ``surfaces``, also those of all views."""
        self._component_maps.drop()
        if surfaces:
            self._registrations.drop()
            self._costs.drop()
            self._features.clear()

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
                    threads=THREADS,
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
            made = extract_features(self._views.surface(view_index))
            kept = self._features.setdefault(view_index, made)
        return kept

    def placed(self, views: Iterable[int]) -> list[PlacedView]:
        """Return views with the poses of their cameras, in the order of their numbers."""
        usable = self.usable(views)
        poses = self.poses(usable)
        return [
            PlacedView(surface=self.surface(view), object_from_camera=pose)
            for view, pose in zip(usable, poses, strict=True)
        ]

    def usable(self, views: Iterable[int]) -> tuple[int, ...]:
        """Return those of some views that show cloth, in the order of their numbers."""
        return tuple(view for view in sorted(views) if not self.why_unusable(view))

    def why_unusable(self, view_index: int) -> str:
        """Return why a view shows too little cloth; empty if it shows enough."""
        if view_index not in self._unusable:
            try:
                self._view_features(view_index)
            except SurfaceError as error:
                self._unusable[view_index] = str(error)
            else:
                self._unusable[view_index] = ""
        return self._unusable[view_index]

    def surface(self, view_index: int) -> Surface:
        """Return the surface of a view: that which registrations keep, if they were not released."""
        seen = self._view_features(view_index)
        return self._views.surface(view_index) if seen.surface is None else seen.surface

    def surfaces(self, shown: Shape) -> dict[int, Surface]:
        """Return the surfaces of a shape's views."""
        return {view: self.surface(view) for view in shown.views}

    def pixel_costs(self, surfaces: Mapping[int, Surface]) -> dict[int, Float32]:
        """Return the cost (H, W) of each pixel of views, by which they are composited."""
        return {view: self._costs.get(view, partial(pixel_cost, s)) for view, s in surfaces.items()}

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

    def current_from_component(self, shown: Shape, view_index: int, component: int) -> Rigid2 | None:
        """Return the rigid motion closest to a shape's effect on a view's component, if it is in the main
        piece.
        """
        seen = next((o for o in shown.observations if o.view_index == view_index), None)
        if seen is None:
            return None
        own, there = self.places(view_index, seen.rc), shown.uv_m[seen.node]
        good = (own.component == component) & np.isfinite(own.uv_m[:, 0]) & np.isfinite(there[:, 0])
        return fit_rigid2(own.uv_m[good], there[good]) if good.sum() > 2 else None


class Shapes:
    """The shapes of documents, cached by the set of their views and the decisions.

    Parameters
    ----------
    views : Views
        Single views.
    seen : RegisteredViews
        Their cameras.
    """

    def __init__(self, views: Views, seen: RegisteredViews) -> None:
        self._views, self._seen = views, seen
        self._interval_px = views.config.flattening.sampling_intervals_px[-1]
        self._shapes: Cache[Shape] = Cache(6)  # with and without the proposal, and for undo: 10 to 15 MB each

    def of(self, document: Document) -> Shape:
        """Return the shape of a document's views.

        Raises
        ------
        FlatclothError
            If the session has no start view, or no view shows cloth.
        """
        if document.start_view is None:
            raise FlatclothError("There is no start view yet; start the session first.")
        return self._shapes.get(shape_key(document), lambda: self._made(document))

    def _made(self, document: Document) -> Shape:
        fixed = [added for added in document.accepted if added.fixed]
        if fixed:  # the views before it are a set of their own
            last = fixed[-1]
            rest = tuple(a for a in document.accepted if a is not last)
            without = self.of(replace(document, accepted=rest))
            shown = self._associated(without, last.view_index)
            own = self._seen.places(last.view_index, shown.rc).component == last.component
            if not _fits(self._seen, without, last, shown).sum() > 0.5 * own.sum():
                return self._with_hand(document, fixed)  # it is not placed where its cloth hangs
            freed = tuple(replace(a, fixed=False) if a is last else a for a in document.accepted)
            return self.of(replace(document, accepted=freed))
        assert document.start_view is not None
        return shape(self._seen.placed(document.used_views), self._interval_px, document.start_view)

    def _with_hand(self, document: Document, fixed: Sequence[Accepted]) -> Shape:
        """Return the shape of a document of which the operator placed views, one after the other."""
        assert document.start_view is not None
        hands, by_hand = {added.view_index for added in fixed}, list[ByHand]()
        placed = {view.surface.frame.view_index: view for view in self._seen.placed(document.used_views)}
        free = [view for number, view in placed.items() if number not in hands]
        for added in fixed:
            made = shape(free, self._interval_px, document.start_view, by_hand)
            view = placed[added.view_index]
            shown = associate(made.nodes, view.surface, view.object_from_camera)
            uv_m, _ = self._views.flattening(added.view_index).carrier.place_all()
            is_own = self._seen.component_of_pixel(added.view_index) == added.component
            laid = np.full(uv_m.shape, np.nan)
            laid[is_own] = added.current_from_new.apply(uv_m[is_own].astype(np.float64))
            kept = where_it_hangs(self._seen, made, added, shown)
            by_hand.append(ByHand(view=view, on=made, shown=kept, pixel_uv_m=laid))
        return shape(free, self._interval_px, document.start_view, by_hand)

    def _associated(self, shown: Shape, view_index: int) -> Association:
        pose = self._seen.poses((*shown.views, view_index))[-1]
        return associate(shown.nodes, self._seen.surface(view_index), pose)

    def joined_piece(self, document: Document, added: Accepted) -> JoinedPiece | None:
        """Return the floating piece that a component joins to the shape where the operator placed it, if one.

        It is the one to which most of the component's nodes belong, if the component lies on cloth of the
        shape.
        """
        made = self.of(document)
        shown = self._associated(made, added.view_index)
        own = self._seen.places(added.view_index, shown.rc)
        piece = made.piece[shown.node]
        known = (own.component == added.component) & np.isfinite(own.uv_m[:, 0]) & (piece > 0)
        if not known.any() or not self._lies_on(made, added):
            return None
        number = int(np.bincount(piece[known]).argmax())
        at = known & (piece == number)
        if at.sum() < 3 or at.sum() < 0.5 * ((own.component == added.component) & (piece >= 0)).sum():
            return None
        from_own = fit_rigid2(own.uv_m[at], made.all_uv_m[shown.node[at]])
        return JoinedPiece(
            piece=number,
            center_uv_m=made.all_uv_m[made.piece == number].mean(axis=0),
            target_from_piece=added.current_from_new @ from_own.inverse(),
        )

    def _lies_on(self, made: Shape, added: Accepted) -> bool:
        """Return whether cloth of the main piece lies under a component where the operator placed it."""
        view = self._views.part(added.view_index, added.component)
        there = added.current_from_new.inverse().apply(made.all_uv_m[made.placed])
        rc = np.rint(view.rc_from_uv(there)).astype(int)
        inside = rc[((rc >= 0) & (rc < view.shape)).all(axis=1)]
        return bool(view.valid[inside[:, 0], inside[:, 1]].any())


def _fits(seen: RegisteredViews, made: Shape, added: Accepted, shown: Association) -> Bool:
    """Return which of the nodes that a view shows (K,) lie where the placement of its component puts them."""
    own = seen.places(added.view_index, shown.rc)
    there = made.uv_m[shown.node]
    with np.errstate(invalid="ignore"):
        off_m = np.linalg.norm(added.current_from_new.apply(own.uv_m) - there, axis=1)
        near: Bool = (own.component == added.component) & (off_m <= TWO_ROWS_M)
    return near


def where_it_hangs(seen: RegisteredViews, made: Shape, added: Accepted, shown: Association) -> Association:
    """Return those of the nodes ``shown`` by a view laid by hand that are the same cloth.

    Cloth of the component that was laid elsewhere on the main piece is not the same; that of a floating piece
    is, and comes with it. Other components are where they hang.
    """
    is_own = seen.places(added.view_index, shown.rc).component == added.component
    kept = ~is_own | (made.piece[shown.node] > 0) | _fits(seen, made, added, shown)
    return Association(node=shown.node[kept], rc=shown.rc[kept], incidence_deg=shown.incidence_deg[kept])
