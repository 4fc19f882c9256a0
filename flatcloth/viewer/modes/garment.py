"""The garment of the shape that a page shows, and its other side: made in the background, and corrected."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import replace
from typing import Any

import numpy as np

from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import LaidPiece, Rigid2
from flatcloth.engine.garment import GarmentService, KnownGarment, points_on_other_side
from flatcloth.engine.result import uncertainty
from flatcloth.engine.sheet import lay_out
from flatcloth.export.garment import drawn, summary
from flatcloth.garments.deciding import decided, held_point, pulls_of, with_placed_cloth
from flatcloth.garments.fit import Pull
from flatcloth.garments.kinds import known_kinds
from flatcloth.garments.recognition import NONE
from flatcloth.session.document import Document
from flatcloth.session.garment import GarmentCommand, ReleasePoints, SetKind
from flatcloth.session.journal import SheetSide
from flatcloth.viewer.modes.controller import PageController
from flatcloth.viewer.protocol import messages, sent
from flatcloth.viewer.protocol.picture import OtherSheet, Picture, layers_of, legends_of, with_errors
from flatcloth.viewer.protocol.sent import FoundGarment, GarmentInfo, GarmentPreview, typed
from flatcloth.viewer.worker import Background, Check, one_at_a_time

NOT_YET = "The garment is recognised once two views are integrated."


class GarmentController:
    """Recognises the garment of the shape that a page shows; its methods are for the page's own thread."""

    def __init__(self, page: PageController) -> None:
        self._page = page
        self._revision, self._text = 0, NOT_YET
        self._known: KnownGarment | None = None
        self._found: FoundGarment | None = None  # the same for the page
        # What a garment depends on: of the shown shape, and of the known one.
        self._shown: Hashable = None
        self._known_of: Hashable = None
        self._work = Background(page.executor, "garment", "recognising the garment")
        self._doubt = 0.0

    # --- recognition --------------------------------------------------------------------------------

    def follow(self, document: Document | None, *, busy: bool) -> None:
        """Recognise the garment of a document whose picture is shown; ``busy``: wait until Auto has ended."""
        if document is None or len(document.used_views) < 2:
            if self._known is not None or self._is_working:
                self._know(None, NOT_YET)
            self.forget()
            self._shown = None
            return
        # A garment is the same, and as sure: by shape, decisions, and whether views are left.
        key = self._shown = document.shape_key, document.garment, document.finished is None

        def recognise(_check: Check) -> tuple[KnownGarment, FoundGarment]:
            known = self._page.garments.of(document)
            return known, typed(summary(known), FoundGarment)

        if not busy:
            self._work.ask(key, recognise, self._take)

    def forget(self) -> None:
        """Recognise the garment of the same shape again at the next :meth:`follow`: more is known of it."""
        self._work.forget()
        self._known_of = None

    @property
    def current(self) -> KnownGarment | None:
        """The garment of the shown shape, None while it is not known."""
        return None if self._is_working else self._known

    @property
    def _is_working(self) -> bool:
        """Whether a recognition runs, or the known garment belongs to another shape."""
        return self._work.is_working or (self._known is not None and self._known_of != self._shown)

    def _take(self, made: tuple[KnownGarment, FoundGarment] | str) -> None:
        """Know a garment; deviations depend on it, and floating pieces keep clear of its outline."""
        self._known_of = self._work.asked
        self._know(*((None, made) if isinstance(made, str) else (made, "")))
        doubt = 0.0 if self._known is None else self._known.doubt
        picture = self._page.picture
        is_clear = not isinstance(picture, Picture) or picture.sheet.is_clear_of(self._page.garments.edge_m)
        if doubt != self._doubt or not is_clear:
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


NOT_ASKED = "The other side is not computed yet."


class OtherSideController:
    """Computes the other side of the shape that a page shows; its methods are for the page's own thread.

    ``on_made`` is called when another side is ``made``, or none.
    """

    def __init__(self, page: PageController, both: GarmentService, on_made: Callable[[], None]) -> None:
        self._page, self.both, self._on_made = page, both, on_made
        self._work = Background(page.executor, "other side", "computing the other side", page.report)
        self._revision, self._text = 0, NOT_ASKED  # why nothing is made
        self.is_wanted = False
        self.made: OtherSheet | None = None

    @property
    def available(self) -> bool:
        """Whether the method integrates both sides."""
        return self.both.integration.algorithm.joins_sides

    @property
    def is_working(self) -> bool:
        """Whether it is being computed."""
        return self._work.is_working

    def follow(self, picture: Picture | None, *, busy: bool) -> None:
        """Compute the other side of the shape of a picture, once it is wanted.

        ``busy``: wait until Auto has ended. Seams that are decided are wanted.
        """
        document = None if picture is None else picture.document
        if document is None:
            if self.made is not None or self.is_working:
                self.made, self._text = None, NOT_ASKED
            self._work.forget()
            return
        if not self.available or not (self.is_wanted or document.garment.seams):
            return
        key = self._key(document)
        if not busy and key != self._work.asked:
            self._text = ""
            self._work.ask(key, lambda check: self._joined(key, document, check), self._take)

    def laid(self, document: Document) -> tuple[LaidPiece, ...]:
        """Return the floating pieces of a document's shape that seams join to it; from any thread."""
        made = self.made
        return () if made is None or made.key != self._key(document) else made.sides.laid

    def _key(self, document: Document) -> tuple[Hashable, ...]:
        axis, garment = self.both.integration.axis, document.garment
        shape = document.shape_key, garment.pieces, garment.seams
        return *shape, axis.point_m.tobytes(), axis.direction.tobytes()

    # --- the worker -----------------------------------------------------------------------------

    def _joined(self, key: tuple[Hashable, ...], document: Document, check: Check) -> OtherSheet | str:
        integration = self.both.integration
        with one_at_a_time(check):
            sides = self.both.joined(document, check, check=check)
            if isinstance(sides, str):
                return sides
            sheet = lay_out(sides.other)
            sheet = replace(sheet, view=with_errors(sheet.view, integration.recording, sheet.piece))
            self._revision += 1
            found = legends_of(sheet.view, integration)
            return OtherSheet(revision=self._revision, key=key, sides=sides, sheet=sheet, legends=found)

    def _take(self, made: OtherSheet | str) -> None:
        self.made, self._text = (None, made) if isinstance(made, str) else (made, "")
        self._on_made()

    # --- for the page ---------------------------------------------------------------------------

    def info(self) -> sent.OtherSideInfo | None:
        """Return the other side for the page; None if the method has one side only."""
        if not self.available:
            return None
        made = self.made
        computed: dict[str, Any] = {}
        if made is not None:
            computed = {
                "layers": layers_of(made),
                "is_related": made.sides.is_related,
                "reliable_share": uncertainty(made.sides.other.view).get("firm_share"),
            }
        return sent.OtherSideInfo(
            revision=0 if made is None else made.revision,
            working=self.is_working,
            progress=self._work.progress,
            text=self._text,
            **computed,
        )
