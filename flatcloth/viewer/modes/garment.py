"""The garment on the page: recognised in the background, shown, and corrected by decisions."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Any

import numpy as np

from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import Rigid2
from flatcloth.engine.garment import KnownGarment, points_on_other_side
from flatcloth.export.garment import drawn, summary
from flatcloth.garments.deciding import decided, held_point, pulls_of, with_placed_cloth
from flatcloth.garments.fit import Pull
from flatcloth.garments.kinds import known_kinds
from flatcloth.garments.recognition import NONE
from flatcloth.session.document import Document
from flatcloth.session.garment import GarmentCommand, ReleasePoints, SetKind
from flatcloth.session.journal import SheetSide
from flatcloth.viewer.modes.controller import PageController
from flatcloth.viewer.protocol import messages
from flatcloth.viewer.protocol.picture import OtherSheet
from flatcloth.viewer.protocol.sent import FoundGarment, GarmentInfo, GarmentPreview, typed

NOT_YET = "The garment is recognised once two views are integrated."


class GarmentController:
    """Recognises the garment of the shape that a page shows; its methods are for the page's own thread."""

    def __init__(self, page: PageController) -> None:
        self._page = page
        self._revision, self._text = 0, NOT_YET
        self._known: KnownGarment | None = None
        self._found: FoundGarment | None = None  # the same for the page
        # What a garment depends on: of the shown shape, of that to be recognised, and of the known one.
        self._shown: Hashable = None
        self._asked: Hashable = None
        self._answered: Hashable = None
        self._doubt = 0.0

    # --- recognition --------------------------------------------------------------------------------

    def follow(self, document: Document | None, *, busy: bool) -> None:
        """Recognise the garment of a document whose picture is shown; ``busy``: wait until Auto has ended."""
        if document is None or len(document.used_views) < 2:
            if self._known is not None or self._is_working:
                self._know(None, NOT_YET)
            self._asked = self._answered = self._shown = None
            return
        # A garment is the same, and as sure: by shape, decisions, and whether views are left.
        key = self._shown = document.shape_key, document.garment, document.finished is None
        if busy or key == self._asked:
            return
        self._asked = key
        self._page.executor.compute(
            "garment",
            lambda: _with_found(self._page.garments.of(document)),
            self._take,
            "recognising the garment",
            lambda: self._asked is key,
        )

    def forget(self) -> None:
        """Recognise the garment of the same shape again at the next :meth:`follow`: more is known of it."""
        self._asked = None

    @property
    def current(self) -> KnownGarment | None:
        """The garment of the shown shape, None while it is not known."""
        return None if self._is_working else self._known

    @property
    def _is_working(self) -> bool:
        """Whether a recognition runs, or the known garment belongs to another shape."""
        if self._answered is not self._asked:
            return True
        return self._known is not None and self._answered != self._shown

    def _take(self, made: tuple[KnownGarment, FoundGarment] | str) -> None:
        """Know a garment; deviations depend on it, and floating pieces keep clear of its outline."""
        self._answered = self._asked
        self._know(*((None, made) if isinstance(made, str) else (made, "")))
        doubt = 0.0 if self._known is None else self._known.doubt
        sheet = None if self._page.picture is None else self._page.picture.sheet
        if doubt != self._doubt or (sheet and not sheet.is_clear_of(self._page.garments.edge_m)):
            self._doubt = doubt
            self._page.draw_again()
        self._page.publish()

    def _know(self, made: tuple[KnownGarment, FoundGarment] | None, text: str) -> None:
        self._known, self._found = made or (None, None)
        self._revision, self._text = self._revision + 1, text

    # --- decisions ----------------------------------------------------------------------------------

    def decision(self, message: messages.GarmentDecision) -> GarmentCommand:
        """Return the decision in a message of the page.

        Raises
        ------
        FlatclothError
            If there is no garment, or no such point or kind.
        """
        known = self._recognised()
        match message:
            case messages.SetKind(kind=kind):
                if kind not in (None, *self.info().kinds):
                    raise FlatclothError(f"There is no kind of garment {kind!r:.40}.")
                return SetKind(kind)
            case messages.HoldPoint(name=name, u_m=u_m, v_m=v_m):
                self._named(known, name)
                return held_point(name, np.array([u_m, v_m]), known.canonical.view)
            case messages.ReleasePoints(name=name):
                return ReleasePoints(name)

    def preview(self, message: messages.PreviewPoint, document: Document) -> Callable[[], GarmentPreview]:
        """Return what computes the outline while a point is dragged."""
        known = self._recognised()
        self._named(known, message.name)

        def outlined() -> GarmentPreview:
            view = known.canonical.view
            others = tuple(p for p in pulls_of(document.garment, view) if p.name != message.name)
            pull = Pull(name=message.name, uv_m=np.array([message.u_m, message.v_m]))
            found = decided(
                known.by_evidence, known.evidence, view, known.found.kind, (*others, pull), with_pieces=False
            )
            found = with_placed_cloth(found, known.pieces, known.canonical.floating)
            preview = {"type": "garment_preview", "id": message.id, **drawn(found, known)}
            return typed(preview, GarmentPreview)

        return outlined

    def seen_point(self, name: str, other: OtherSheet | None = None) -> tuple[float, float, SheetSide]:
        """Return the place of a named point on visible cloth, and the side that shows it.

        Raises
        ------
        FlatclothError
            If no view saw it, so that its pose is unknown.
        """
        known = self._recognised()
        point = self._named(known, name)
        behind = {} if other is None else points_on_other_side(known.found, other.sides)
        if other is not None and name in behind:
            u_m, v_m = other.sides.other.view.uv_from_rc(np.array(behind[name])).tolist()
            return u_m, v_m, "other"
        if point.pixel is None:
            raise FlatclothError(
                f"{name} is predicted only: no view saw cloth there, so it has no pose. Add views."
            )
        motion = Rigid2() if point.piece is None else known.pieces.shape_from_piece[point.piece]
        u_m, v_m = motion.apply(known.cloth_of(point).uv_from_rc(np.array(point.pixel))).tolist()
        return u_m, v_m, "this"

    def _recognised(self) -> KnownGarment:
        if self._known is None:
            raise FlatclothError(self._text or NOT_YET)
        return self._known

    def _named(self, known: KnownGarment, name: str) -> Any:
        point = known.found.points.get(name)
        if point is None:
            raise FlatclothError(f"A {known.found.fit.kind.name} has no point {name!r:.40}; look again.")
        return point

    # --- for the page ---------------------------------------------------------------------------------------

    def info(self) -> GarmentInfo:
        """Return the garment for the page."""
        return GarmentInfo(
            revision=self._revision,
            working=self._is_working,
            text=self._text,
            kinds=(*(kind.name for kind in known_kinds()), NONE),  # NONE: it is none of the known ones
            found=self._found,
        )


def _with_found(known: KnownGarment) -> tuple[KnownGarment, FoundGarment]:
    """Return a garment, and its data for the page."""
    return known, typed(summary(known), FoundGarment)
