"""The other side of the item on the page: computed in the background, and shown."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import replace

from msgspec import structs

from flatcloth.core.errors import CancelledError
from flatcloth.core.types import LaidPiece
from flatcloth.engine.garment import GarmentService
from flatcloth.engine.result import uncertainty
from flatcloth.engine.sheet import lay_out
from flatcloth.methods.answers import JoinedSides
from flatcloth.rendering import layers
from flatcloth.session.document import Document
from flatcloth.viewer.modes.controller import PageController
from flatcloth.viewer.protocol import sent
from flatcloth.viewer.protocol.picture import OtherSheet, Picture, layers_of_other, truth_of
from flatcloth.viewer.protocol.sent import typed
from flatcloth.viewer.worker import one_at_a_time

NOT_ASKED = "The other side is not computed yet."


class OtherSideController:
    """Computes the other side of the shape that a page shows; its methods are for the page's own thread.

    ``on_made`` is called when another side is ``made``, or none.
    """

    def __init__(self, page: PageController, both: GarmentService, on_made: Callable[[], None]) -> None:
        self._page, self.both, self._on_made = page, both, on_made
        self._asked: tuple[Hashable, ...] | None = None
        self._revision = 0
        self.is_working, self._text = False, NOT_ASKED  # why nothing is made
        self._progress: sent.Progress | None = None
        self.is_wanted = False
        self.made: OtherSheet | None = None

    @property
    def available(self) -> bool:
        """Whether the method integrates both sides."""
        return self.both.integration.algorithm.joins_sides

    def stop(self) -> None:
        """Cancel what is computed."""
        self._asked = None

    def follow(self, picture: Picture | None, *, busy: bool) -> None:
        """Compute the other side of the shape of a picture, once it is wanted.

        ``busy``: wait until Auto has ended. Seams that are decided are wanted.
        """
        document = None if picture is None else picture.document
        if document is None:
            if self.made is not None or self.is_working:
                self.made, self.is_working, self._text = None, False, NOT_ASKED
            self._asked = None
            return
        if not self.available or not (self.is_wanted or document.garment.seams):
            return
        key = self._key(document)
        if busy or key == self._asked:
            return
        self._asked, self._progress = key, None
        self.is_working, self._text = True, ""
        self._page.executor.compute(
            "other side",
            lambda: self._work(key, document),
            self._take,
            "computing the other side",
            lambda: self._asked is key,
        )

    def laid(self, document: Document) -> tuple[LaidPiece, ...]:
        """Return the floating pieces of a document's shape that seams join to it; from any thread."""
        made = self.made
        return () if made is None or made.key != self._key(document) else made.sides.laid

    def _key(self, document: Document) -> tuple[Hashable, ...]:
        axis, garment = self.both.integration.axis, document.garment
        shape = document.shape_key, garment.pieces, garment.seams
        return *shape, axis.point_m.tobytes(), axis.direction.tobytes()

    # --- the worker -----------------------------------------------------------------------------

    def _work(self, key: tuple[Hashable, ...], document: Document) -> OtherSheet | str:
        def check() -> None:
            if self._asked is not key:
                raise CancelledError  # the shape has changed since, or another recording was opened

        def report(share: float, text: str) -> None:
            check()
            self._page.executor.on_page(lambda: self._progressed(sent.Progress(share=share, text=text)))

        with one_at_a_time(check):
            sides = self.both.joined(document, report, check=check)
            return sides if isinstance(sides, str) else self._laid_out(key, sides)

    def _laid_out(self, key: Hashable, sides: JoinedSides) -> OtherSheet:
        integration = self.both.integration
        sheet, truth = lay_out(sides.other), truth_of(integration.recording)
        if truth is not None:
            sheet = replace(sheet, view=truth.with_errors(sheet.view, sheet.piece))
        found = layers.legends(sheet.view, integration.axis, integration.recording.angles_deg)
        self._revision += 1
        return OtherSheet(
            revision=self._revision,
            key=key,
            sides=sides,
            sheet=sheet,
            legends=typed(found, dict[str, sent.Legend]),
        )

    def _progressed(self, progress: sent.Progress) -> None:
        if self.is_working:
            self._progress = progress
            self._page.report(progress.text)

    def _take(self, made: OtherSheet | str) -> None:
        self.is_working, self._progress = False, None
        self.made, self._text = (None, made) if isinstance(made, str) else (made, "")
        self._on_made()

    # --- for the page ---------------------------------------------------------------------------

    def info(self) -> sent.OtherSideInfo | None:
        """Return the other side for the page; None if the method has one side only."""
        if not self.available:
            return None
        made = self.made
        info = sent.OtherSideInfo(
            revision=0 if made is None else made.revision,
            working=self.is_working,
            progress=self._progress,
            text=self._text,
        )
        if made is None:
            return info
        return structs.replace(
            info,
            layers=layers_of_other(made),
            is_related=made.sides.is_related,
            reliable_share=uncertainty(made.sides.other.view).get("firm_share"),
        )
