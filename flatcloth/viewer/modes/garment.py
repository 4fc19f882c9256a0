"""The page's garment: recognised in the background, told to the page, and decided about."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import finite
from flatcloth.garments.deciding import decided, held_point, pulls_of
from flatcloth.garments.fit import Pull
from flatcloth.garments.recognition import NONE, Recognition
from flatcloth.garments.registry import known_kinds
from flatcloth.session.garment import GarmentCommand, HoldPoint, ReleasePoints, SetKind
from flatcloth.viewer.protocol import messages
from flatcloth.viewer.worker import Worker

if TYPE_CHECKING:
    from flatcloth.core.types import FlattenedView
    from flatcloth.engine.garment.recognition import GarmentService, KnownGarment
    from flatcloth.session.machine import Document

_log = logging.getLogger(__name__)

NOT_YET = "The garment is recognised once two views are integrated."
UNEXPECTED = "Unexpected error while recognising the garment. See the terminal."


@dataclass(frozen=True)
class GarmentStatus:
    """What the page is told; ``revision`` grows with each answer, ``text`` says why there is no garment."""

    revision: int = 0
    working: bool = False
    text: str = NOT_YET
    known: KnownGarment | None = None


class GarmentController:
    """Recognises the garment of the shape that the page shows; its methods are for the application thread.

    Parameters
    ----------
    service : GarmentService
        Recognises.
    put : callable
        Runs a job on the application thread.
    told : callable
        Called on the application thread when the status has changed.
    tell : callable
        Sends a message to a tab.
    """

    def __init__(
        self,
        service: GarmentService,
        put: Callable[[Callable[[], None]], None],
        told: Callable[[], None],
        tell: Callable[[int | None, dict[str, Any]], None],
    ) -> None:
        self._service, self._put, self._told, self._tell = service, put, told, tell
        self._worker = Worker("flatcloth-garment")
        self._asked: Document | None = None
        self._previewed: tuple[int, int] | None = None
        self.status = GarmentStatus()

    def stop(self) -> None:
        """End the thread."""
        self._worker.stop(timeout_s=2.0)

    # --- recognition --------------------------------------------------------------------------------

    def follow(self, document: Document | None, *, busy: bool) -> None:
        """Recognise the garment of a document whose picture is shown; ``busy``: wait until Auto has ended."""
        if document is None or len(document.used_views) < 2:
            self._asked = None
            if self.status.known is not None or self.status.working:
                self.status = GarmentStatus(revision=self.status.revision + 1)
            return
        if busy or self._asked is document or (self._asked is not None and _same(self._asked, document)):
            return
        self._asked = document
        self.status = replace(self.status, working=True)
        self._worker.put(lambda: self._work(document))

    def _work(self, document: Document) -> None:
        if self._asked is not document:
            return  # the shape has changed since
        known: KnownGarment | None = None
        text = ""
        try:
            known = self._service.of(document)
        except FlatclothError as error:
            text = str(error)
        except Exception:  # noqa: BLE001 - told and logged
            _log.exception("the garment could not be recognised")
            text = UNEXPECTED
        self._put(lambda: self._take(document, known, text))

    def _take(self, document: Document, known: KnownGarment | None, text: str) -> None:
        if self._asked is not document:
            return
        self.status = GarmentStatus(revision=self.status.revision + 1, text=text, known=known)
        self._told()

    # --- decisions ----------------------------------------------------------------------------------

    def take(
        self,
        client: int,
        message: messages.Message,
        document: Document,
        decide: Callable[[GarmentCommand], None],
    ) -> None:
        """Decide what a message of the page says, or answer its question. Auto goes on."""
        if isinstance(message, messages.PreviewPoint):
            self._preview(client, message, document)
        else:
            decide(self._decision(message))

    def _decision(self, message: messages.Message) -> GarmentCommand:
        """Return what a message of the page decides.

        Raises
        ------
        FlatclothError
            If there is no garment, or no such point or kind.
        """
        known = self._known()
        match message:
            case messages.SetKind(kind=kind):
                if kind is not None and kind not in {each.name for each in known_kinds()}:
                    raise FlatclothError(f"There is no kind of garment {kind!r:.40}.")
                return SetKind(kind)
            case messages.HoldPoint(name=name, u_m=u_m, v_m=v_m):
                self._named(known, name)
                return HoldPoint(held_point(name, np.array([u_m, v_m]), known.canonical.view))
            case messages.ReleasePoints(name=name):
                return ReleasePoints(name)
        raise FlatclothError("This is no decision about the garment.")

    def _preview(self, client: int, message: messages.PreviewPoint, document: Document) -> None:
        """Tell a tab how the outline lies while a point is dragged; only the last question counts."""
        known = self._known()
        self._named(known, message.name)
        key = self._previewed = client, message.id

        def work() -> None:
            if self._previewed != key:
                return
            view = known.canonical.view
            others = tuple(p for p in pulls_of(document.garment, view) if p.name != message.name)
            pull = Pull(name=message.name, uv_m=np.array([message.u_m, message.v_m]))
            found = decided(
                known.by_evidence, known.evidence, view, known.found.kind, (*others, pull), with_pieces=False
            )
            told = {"type": "garment_preview", "id": message.id, **_shown(found, view)}
            self._tell(client, told)

        self._worker.put(work)

    def seen_point(self, name: str) -> tuple[float, float]:
        """Return the place of a named point whose cloth was seen.

        Raises
        ------
        FlatclothError
            If it was not: no pose is known there.
        """
        known = self._known()
        point = self._named(known, name)
        if point.pixel is None:
            raise FlatclothError(
                f"{name} is predicted only: no view saw cloth there, so it has no pose. Add views."
            )
        u_m, v_m = known.canonical.view.uv_from_rc(np.array(point.pixel)).tolist()
        return u_m, v_m

    def _known(self) -> KnownGarment:
        if self.status.known is None:
            raise FlatclothError(self.status.text or NOT_YET)
        return self.status.known

    def _named(self, known: KnownGarment, name: str) -> Any:
        point = known.found.points.get(name)
        if point is None:
            raise FlatclothError(f"A {known.found.fit.kind.name} has no point {name!r:.40}; look again.")
        return point

    # --- told ---------------------------------------------------------------------------------------

    def plain(self) -> dict[str, Any]:
        """Return the garment for the page."""
        status = self.status
        told: dict[str, Any] = {
            "revision": status.revision,
            "working": status.working,
            "text": status.text,
            "kinds": [kind.name for kind in known_kinds()],
            "found": None,
        }
        if status.known is None:
            return told
        found, view = status.known.found, status.known.canonical.view
        upright = found.upright_from_shape.theta_rad
        told["found"] = {
            "kind": None if found.kind == NONE else found.kind,
            "likeliest": found.fit.kind.name,
            "by_hand": found.by_hand is not None,
            "probabilities": sorted(found.probabilities.items(), key=lambda each: -each[1]),
            "dimensions": [
                {"name": name, "mm": 1e3 * d.value_m, "std_mm": 1e3 * d.std_m}
                for name, d in found.dimensions.items()
            ],
            "upright_rad": math.remainder(upright, 2 * math.pi),
            **_shown(found, view),
        }
        return told


def _shown(found: Recognition, view: FlattenedView) -> dict[str, Any]:
    """Return what is drawn: the outline and the named points."""
    return {
        "outline_uv_m": np.round(found.outline_uv_m, 5).tolist(),
        "points": [
            {
                "name": name,
                "uv_m": np.round(point.uv_m, 5).tolist(),
                "std_mm": 1e3 * point.std_m,
                "seen": point.pixel is not None,
                "held": name in found.held,
                "xyz_m": None
                if point.pixel is None
                else [finite(x) for x in view.xyz_m[point.pixel].tolist()],
            }
            for name, point in found.points.items()
        ],
    }


def _same(a: Document, b: Document) -> bool:
    """Tell whether two documents have the same shape and the same decisions about its garment."""
    return (a.start_view, a.accepted, a.strokes, a.garment) == (
        b.start_view,
        b.accepted,
        b.strokes,
        b.garment,
    )
