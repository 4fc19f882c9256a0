"""The garment on the page: recognised in the background, shown, and corrected by decisions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from flatcloth.core.errors import CancelledError, FlatclothError
from flatcloth.core.types import Rigid2
from flatcloth.engine.garment.deciding import piece_decision
from flatcloth.engine.garment.recognition import GarmentService, KnownGarment, points_on_other_side
from flatcloth.engine.sheet import label_of, order_of
from flatcloth.export.garment import drawn, summary
from flatcloth.garments.deciding import decided, held_point, pulls_of, with_placed_cloth
from flatcloth.garments.fit import Pull
from flatcloth.garments.kinds import known_kinds
from flatcloth.garments.placing import Placed
from flatcloth.garments.recognition import NONE, is_offered, is_sure
from flatcloth.methods.answers import Canonical
from flatcloth.session.garment import DecidePiece, GarmentCommand, HoldPoint, ReleasePoints, SetKind
from flatcloth.session.journal import SheetSide
from flatcloth.session.machine import Document
from flatcloth.viewer.protocol import garment as asked
from flatcloth.viewer.protocol import messages
from flatcloth.viewer.protocol.answers import GarmentPreview, ServerMessage
from flatcloth.viewer.protocol.garment import FoundGarment, GarmentInfo
from flatcloth.viewer.protocol.picture import OtherSheet, outline_of
from flatcloth.viewer.protocol.sent import NoteLevel, typed
from flatcloth.viewer.worker import Executor

NOT_YET = "The garment is recognised once two views are integrated."


@dataclass(frozen=True)
class GarmentStatus:
    """The state of the recognition; ``revision`` grows with each result, ``text`` explains a missing one."""

    revision: int = 0
    working: bool = False
    text: str = NOT_YET
    known: KnownGarment | None = None
    shown: FoundGarment | None = None


class GarmentController:
    """Recognises the garment of the shape that the page shows; its methods are for the application thread.

    Parameters
    ----------
    service : GarmentService
        Recognises garments.
    executor : Executor
        Does the work.
    changed : callable
        Called on the application thread when the status has changed.
    tell : callable
        Sends a message to a tab.
    of_joint : callable
        Returns the decision about a joint of the shape.
    doubted : callable
        Called on the application thread when no known kind fits the shape any more, or one does again: the
        deviations of its places change with that.
    note : callable
        Notifies all tabs.
    """

    def __init__(
        self,
        service: GarmentService,
        executor: Executor,
        changed: Callable[[], None],
        tell: Callable[[int | None, ServerMessage], None],
        of_joint: Callable[[asked.DecideJoint], GarmentCommand],
        doubted: Callable[[], None],
        note: Callable[[NoteLevel, str], None],
    ) -> None:
        self._service, self._executor, self._changed, self._tell = service, executor, changed, tell
        self._of_joint, self._doubted, self._note = of_joint, doubted, note
        self._doubt = 0.0
        self._asked: Document | None = None
        self._answered: Document | None = None
        self._shown: Document | None = None
        self._previewed: tuple[int, int] | None = None
        self.status = GarmentStatus()

    # --- recognition --------------------------------------------------------------------------------

    def follow(self, document: Document | None, *, busy: bool) -> None:
        """Recognise the garment of a document whose picture is shown; ``busy``: wait until Auto has ended."""
        if document is None or len(document.used_views) < 2:
            self._asked = self._answered = self._shown = None
            if self.status.known is not None or self.status.working:
                self.status = GarmentStatus(revision=self.status.revision + 1)
            return
        self._shown = document
        if not busy and (self._asked is None or not _same(self._asked, document)):
            self._asked = document
            self._executor.compute(
                "garment",
                lambda: self._work(document),
                lambda made: self._take(document, made),
                "recognising the garment",
            )
        if self.status.working != self._is_outdated():
            self.status = replace(self.status, working=not self.status.working)

    def forget(self) -> None:
        """Recognise the garment of the same shape again at the next :meth:`follow`: more is known of it."""
        self._asked = None

    def _is_outdated(self) -> bool:
        """Return whether a recognition runs, or the known garment belongs to another shape."""
        if self._answered is not self._asked:
            return True
        if self.status.known is None or self._answered is None or self._shown is None:
            return False
        return not _same(self._answered, self._shown)

    def _work(self, document: Document) -> GarmentStatus:
        if self._asked is not document:
            raise CancelledError  # the shape has changed since
        known = self._service.of(document)
        return GarmentStatus(text="", known=known, shown=_found_garment(known))

    def _take(self, document: Document, made: GarmentStatus | str) -> None:
        if self._asked is not document:
            return
        status = GarmentStatus(text=made) if isinstance(made, str) else made
        self._answered = document
        self.status = replace(status, revision=self.status.revision + 1)
        self.status = replace(self.status, working=self._is_outdated())
        known = status.known
        doubt = 0.0 if known is None else known.doubt
        if doubt != self._doubt:
            self._doubt = doubt
            self._doubted()
        self._changed()

    # --- decisions ----------------------------------------------------------------------------------

    def take(
        self,
        client: int,
        message: messages.Message,
        document: Document,
        decide: Callable[[GarmentCommand], None],
    ) -> None:
        """Apply the decision in a message of the page, or answer its question. Auto continues."""
        if isinstance(message, asked.PreviewPoint):
            self._preview(client, message, document)
        else:
            decide(self._decision(message))

    def _decision(self, message: messages.Message) -> GarmentCommand:
        """Return the decision in a message of the page.

        Raises
        ------
        FlatclothError
            If there is no garment, or no such point or kind.
        """
        if isinstance(message, asked.DecideJoint):
            return self._of_joint(message)
        known = self._known()
        match message:
            case asked.SetKind(kind=kind):
                if kind not in (None, *self.info().kinds):
                    raise FlatclothError(f"There is no kind of garment {kind!r:.40}.")
                return SetKind(kind)
            case asked.HoldPoint(name=name, u_m=u_m, v_m=v_m):
                self._named(known, name)
                return HoldPoint(held_point(name, np.array([u_m, v_m]), known.canonical.view))
            case asked.ReleasePoints(name=name):
                return ReleasePoints(name)
            case asked.DecidePiece(label=label, accepted=accepted):
                return DecidePiece(
                    piece_decision(known.canonical, self._piece(known, label), accepted=accepted)
                )
        raise FlatclothError("This is no decision about the garment.")

    def _preview(self, client: int, message: asked.PreviewPoint, document: Document) -> None:
        """Send a tab the outline while a point is dragged; only the last request is answered."""
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
            found = with_placed_cloth(found, known.pieces, known.canonical.floating)
            preview = {"type": "garment_preview", "id": message.id, **drawn(found, known)}
            self._tell(client, typed(preview, GarmentPreview))

        self._executor.put("repair", work)

    def seen_point(self, name: str, other: OtherSheet | None = None) -> tuple[float, float, SheetSide]:
        """Return the place of a named point on visible cloth, and the side that shows it.

        Raises
        ------
        FlatclothError
            If no view saw it, so that its pose is unknown.
        """
        known = self._known()
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

    def _known(self) -> KnownGarment:
        if self.status.known is None:
            raise FlatclothError(self.status.text or NOT_YET)
        return self.status.known

    def _piece(self, known: KnownGarment, label: str) -> Placed:
        if self.status.working:
            raise FlatclothError("The shape has changed, and its garment is being recognised; look again.")
        labels = _labels(known.canonical)
        piece = next((each for each in _shown(known) if labels[each.index] == label), None)
        if piece is None:
            raise FlatclothError(f"The garment has no place for a piece {label!r:.20}.")
        return piece

    def _named(self, known: KnownGarment, name: str) -> Any:
        point = known.found.points.get(name)
        if point is None:
            raise FlatclothError(f"A {known.found.fit.kind.name} has no point {name!r:.40}; look again.")
        return point

    # --- for the page ---------------------------------------------------------------------------------------

    def info(self) -> GarmentInfo:
        """Return the garment for the page."""
        status = self.status
        return GarmentInfo(
            revision=status.revision,
            working=status.working,
            text=status.text,
            kinds=(*(kind.name for kind in known_kinds()), NONE),  # NONE: it is none of the known ones
            found=status.shown,
        )


def _found_garment(known: KnownGarment) -> FoundGarment:
    """Return the data of a garment for the page."""
    found = known.found
    values = {
        **summary(known),
        "pieces": _pieces(known) if found.kind != NONE else [],
    }
    return typed(values, FoundGarment)


def _labels(canonical: Canonical) -> dict[int, str]:
    """Return the letters of the floating pieces, by their index."""
    return {index: label_of(n + 1) for n, index in enumerate(order_of(canonical.floating))}


def _pieces(known: KnownGarment) -> list[dict[str, Any]]:
    """Return the pieces that have a place on the garment: the decision, and the outline at that place."""
    labels, decided = _labels(known.canonical), known.pieces
    return [
        {
            "label": labels[piece.index],
            "probability": piece.probability,
            "std_mm": 1e3 * piece.std_m,
            "sure": is_sure(piece),
            "state": "placed"
            if piece.index in decided.shape_from_piece
            else "refused"
            if piece.index in decided.refused
            else "proposed",
            "outline_uv_m": outline_of(known.canonical.floating[piece.index], piece.shape_from_piece),
        }
        for piece in _shown(known)
    ]


def _shown(known: KnownGarment) -> list[Placed]:
    """Return the pieces whose place is proposed or decided."""
    decided = {*known.pieces.shape_from_piece, *known.pieces.refused}
    return [piece for piece in known.found.pieces if is_offered(piece) or piece.index in decided]


def _same(a: Document, b: Document) -> bool:
    """Return whether a garment is the same, and as sure: by shape, decisions, and whether views are left."""
    return (a.shape_key, a.garment, a.finished is None) == (b.shape_key, b.garment, b.finished is None)
