"""The other side of the item on the page: computed in the background, shown, and its seams decided."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import replace

import numpy as np
from msgspec import structs
from starlette.requests import Request
from starlette.routing import BaseRoute

from flatcloth.core.errors import CancelledError, FlatclothError
from flatcloth.core.types import Float64, LaidPiece
from flatcloth.engine.garment import GarmentService, decided_seam
from flatcloth.engine.result import uncertainty
from flatcloth.engine.sheet import Sheet, label_of, lay_out, sheet_of
from flatcloth.methods.answers import JoinedSides, Seam
from flatcloth.rendering import layers
from flatcloth.session.document import Document
from flatcloth.session.garment import DecideSeam
from flatcloth.viewer import http
from flatcloth.viewer.modes.controller import PageController
from flatcloth.viewer.protocol.picture import OtherSheet, Picture, layers_of_other, outline_of, truth_of
from flatcloth.viewer.protocol.sent import (
    Legend,
    OtherSideInfo,
    Progress,
    SeamInfo,
    SeamPlaces,
    SidePlaces,
    typed,
)
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
        self._is_working, self._text = False, NOT_ASKED  # why nothing is made
        self._progress: Progress | None = None
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
        document, sheet = (None, None) if picture is None else (picture.document, picture.sheet)
        if document is None or sheet is None:
            if self.made is not None or self._is_working:
                self.made, self._is_working, self._text = None, False, NOT_ASKED
            self._asked = None
            return
        if not self.available or not (self.is_wanted or document.garment.seams):
            return
        key = self._key(document)
        if busy or key == self._asked:
            return
        self._asked, self._progress = key, None
        self._is_working, self._text = True, ""
        self._page.executor.compute(
            "other side",
            lambda: self._work(key, document, sheet),
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

    def _work(self, key: tuple[Hashable, ...], document: Document, sheet: Sheet) -> OtherSheet | str:
        def check() -> None:
            if self._asked is not key:
                raise CancelledError  # the shape has changed since, or another recording was opened

        def report(share: float, text: str) -> None:
            check()
            self._page.executor.on_page(lambda: self._progressed(Progress(share=share, text=text)))

        with one_at_a_time(check):
            sides = self.both.joined(document, report, check=check)
            return sides if isinstance(sides, str) else self._laid_out(key, document, sides, sheet)

    def _laid_out(self, key: Hashable, document: Document, sides: JoinedSides, this: Sheet) -> OtherSheet:
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
            this=sheet_of(integration.canonical(document), document, sides.laid, this),
            sheet=sheet,
            legends=typed(found, dict[str, Legend]),
        )

    def _progressed(self, progress: Progress) -> None:
        if self._is_working:
            self._progress = progress
            self._page.report(progress.text)

    def _take(self, made: OtherSheet | str) -> None:
        self._is_working, self._progress = False, None
        self.made, self._text = (None, made) if isinstance(made, str) else (made, "")
        self._on_made()

    # --- decisions ------------------------------------------------------------------------------

    def decision(self, revision: int, index: int, *, keep: bool) -> DecideSeam:
        """Return the decision about a seam of the list at a revision.

        Raises
        ------
        FlatclothError
            If the list has changed.
        """
        made = self.made
        if self._is_working or made is None or revision != made.revision:
            raise FlatclothError("The seams are being found again; look again.")
        if not 0 <= index < len(made.sides.seams):
            raise FlatclothError(f"There is no seam {index}; look again.")
        return decided_seam(made.sides.seams[index].xyz_m, kept=keep)

    # --- for the page ---------------------------------------------------------------------------

    def info(self) -> OtherSideInfo | None:
        """Return the other side for the page; None if the method has one side only."""
        if not self.available:
            return None
        made = self.made
        info = OtherSideInfo(
            revision=0 if made is None else made.revision,
            working=self._is_working,
            progress=self._progress,
            text=self._text,
        )
        if made is None:
            return info
        return structs.replace(
            info,
            layers=layers_of_other(made),
            is_related=made.sides.is_related,
            seams=tuple(seam_info(made, seam) for seam in made.sides.seams),
            reliable_share=uncertainty(made.sides.other.view).get("firm_share"),
        )

    def routes(self) -> list[BaseRoute]:
        """Return the routes: the outlines of both sides, and the places of their seams."""
        return [http.get("/other/{revision:int}/places.json", self._places)]

    def _places(self, request: Request) -> SidePlaces | None:
        made = self.made
        is_known = made is not None and made.revision == request.path_params["revision"]
        return places_of(made) if is_known and made is not None else None


def seam_info(made: OtherSheet, seam: Seam) -> SeamInfo:
    """Return a seam for the list of the page."""
    median_mm, most_mm = 1e3 * np.quantile(seam.residual_m, (0.5, 0.9))
    return SeamInfo(
        this_piece=label_of(made.this.places(seam.this_uv_m)[0]),
        other_piece=label_of(made.sheet.places(seam.other_uv_m)[0]),
        length_mm=1e3 * seam.length_m,
        places=len(seam.xyz_m),
        residual_mm=(float(median_mm), float(most_mm)),
        this_views=_views(seam, 0),
        other_views=_views(seam, 1),
        why=seam.why,
        decided=seam.decided,
    )


def _views(seam: Seam, side: int) -> tuple[int, ...]:
    """Return the views that show one rim of a seam, those that show most of it first."""
    views, counts = np.unique(seam.views[seam.views[:, side] >= 0, side], return_counts=True)
    return tuple(map(int, views[np.argsort(-counts, kind="stable")]))


def places_of(made: OtherSheet) -> SidePlaces:
    """Return the outlines of both sides and the places of their seams, on the sheets that show them."""
    return SidePlaces(
        this_outline_uv_m=outline_of(made.this.canonical.view),
        other_outline_uv_m=outline_of(made.sides.other.view),
        seams=[
            SeamPlaces(
                this_uv_m=_on(made.this, seam.this_uv_m),
                other_uv_m=_on(made.sheet, seam.other_uv_m),
                xyz_m=np.round(seam.xyz_m, 4).tolist(),
                residual_mm=np.round(1e3 * seam.residual_m, 1).tolist(),
            )
            for seam in made.sides.seams
        ],
    )


def _on(sheet: Sheet, uv_m: Float64) -> list[tuple[float, float]]:
    return [(float(u), float(v)) for u, v in np.round(np.nan_to_num(sheet.places(uv_m)[1]), 4)]
