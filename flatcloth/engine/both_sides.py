"""Both sides of an item: the other side is integrated by itself, and joined to this one along the seams."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Hashable
from dataclasses import replace

import cv2
import numpy as np

from flatcloth.core.cache import Cache
from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import Bool, LaidPiece, Progress, RgbdFrame, no_progress
from flatcloth.engine.garment.deciding import known_with_pieces, place_sure_pieces
from flatcloth.engine.garment.recognition import GarmentService, KnownGarment, evidence_of_shape, seen_from
from flatcloth.engine.integration import Integration
from flatcloth.engine.segmenting import evidence_of
from flatcloth.garments.deciding import decided_pieces
from flatcloth.methods.answers import JoinedSides, OneSide
from flatcloth.recordings.base import ViewImages, altered
from flatcloth.registration.registered import Registered
from flatcloth.segmentation.observed import Evidence
from flatcloth.segmentation.other_side import other_side
from flatcloth.session.document import Document, accept_all
from flatcloth.session.garment import without_doubts
from flatcloth.session.machine import MemorySession, Request, SessionState, Started


class BothSides:
    """The other side of an integration's item, and how it is joined to the shape. Safe for several threads.

    Parameters
    ----------
    integration : Integration
        Of this side. Frames are read through it, and the other side has its axis and settings.
    doubts_links : bool
        Whether parts of the other side whose link no garment allows are taken off before it is joined to
        this one. Its garment is recognised for that, which takes about as long as to integrate it.
    keeps_views : bool
        Whether the frames and flattened views of the other side are kept: a look ahead needs them soon.
    """

    def __init__(
        self, integration: Integration, *, doubts_links: bool = True, keeps_views: bool = False
    ) -> None:
        self.integration, self._doubts_links = integration, doubts_links
        self._keeps_views = keeps_views
        self._lock = threading.Lock()
        self._others: Cache[tuple[Integration, Document]] = Cache(1)
        self._alone: Cache[OneSide] = Cache(1)  # the other side, not joined
        self._joined: Cache[JoinedSides] = Cache(2)

    def of(
        self,
        document: Document,
        progress: Progress = no_progress,
        cores: int = 1,
        check: Callable[[], None] = lambda: None,
    ) -> JoinedSides | str:
        """Return the other side joined to a document's shape, or the reason why there is none (cached).

        The first call integrates the other side, which takes about as long as this one did. It serves every
        shape; while it is joined to this document's, ``check`` is called.

        Raises
        ------
        CancelledError
            If ``progress`` or ``check`` raised it.
        """
        try:
            with self._lock:
                for each in (_as_seen(document), document):
                    joined = self._join(each, progress, cores, check)
                kept = self._others.kept(self._of(document))
                if kept is not None and not self._keeps_views:
                    kept[0].views.release(kept[1].used_views)
                    kept[0].algorithm.release(surfaces=True)
                return self._trusted(document, joined)
        except FlatclothError as error:
            return f"Only one side is in the shape: {error}"

    def known(self, document: Document) -> tuple[JoinedSides, Integration, Document] | None:
        """Return the sides that :meth:`of` joined, with the integration of the other side and its decisions.

        None if it was not called, or there is no other side. Floating pieces are where seams lay them, not
        where a garment does, so that a garment may be recognised by it.
        """
        sides = self._joined.kept(self._key(_as_seen(document)))
        other = self._others.kept(self._of(document))
        return None if sides is None or other is None else (sides, *other)

    def _join(
        self, document: Document, progress: Progress, cores: int, check: Callable[[], None]
    ) -> JoinedSides:
        return self._joined.get(self._key(document), lambda: self._made(document, progress, cores, check))

    @staticmethod
    def _key(document: Document) -> tuple[Hashable, ...]:
        return document.shape_key, document.garment.pieces, document.garment.seams

    def _of(self, document: Document) -> tuple[Hashable, ...]:
        """Return what the other side depends on."""
        axis = self.integration.axis
        return (*document.strokes, tuple(axis.point_m), tuple(axis.direction))

    def _made(
        self, document: Document, progress: Progress, cores: int, check: Callable[[], None]
    ) -> JoinedSides:
        this = self.integration
        if not this.algorithm.joins_sides:
            raise FlatclothError(f"the method {this.method} integrates one.")
        other, its = self._others.get(self._of(document), lambda: self.integrated(document, progress))
        check()
        own = one_side(this, document)
        pieces = decided_pieces(document.garment, own.canonical.view, own.canonical.floating)
        laid = [
            LaidPiece(index=index, shape_from_piece=motion, std_m=pieces.std_m[index])
            for index, motion in pieces.shape_from_piece.items()
        ]
        alone = self._alone.get(self._of(document), lambda: self._by_itself(other, its))
        return this.algorithm.with_other_side(own, laid, other.algorithm, alone, check)

    def _by_itself(self, other: Integration, its: Document) -> OneSide:
        """Return the other side, not joined, and release what was kept to integrate it."""
        alone = one_side(other, its)
        if not self._keeps_views:
            other.views.release(its.used_views)
            other.algorithm.release()
            for side in (self.integration, other):  # to join them takes the most memory of a run
                side.views.forget_frames()
        return alone

    def _trusted(self, document: Document, joined: JoinedSides) -> JoinedSides:
        this = self.integration
        return this.trust.of_sides(
            document, this.canonical(document), this.algorithm.cameras(document), joined
        )

    def integrated(
        self, document: Document, progress: Progress = no_progress
    ) -> tuple[Integration, Document]:
        """Integrate the other side alone: all views that show it, each where its cloth is in space.

        No placement is searched. Cloth that no view joins to the rest floats, to be joined by seams; what is
        joined by a link that no garment allows floats, too.
        """
        this = self.integration
        this.views.release(document.used_views)
        mask_of = self._masks(document, progress)

        def read(view_index: int) -> ViewImages:
            frame = this.views.frame(view_index)
            return ViewImages(frame.color, frame.depth_m, mask_of(frame))

        recording = altered(
            this.recording, read=read, rotation_axis=this.axis, held_point_m=this.views.held_point_m
        )
        other = Integration(recording, this.config, this.method)
        other.algorithm.is_unattended = True
        if (cameras := self._confirmed(document)) is not None:
            other.algorithm.take_confirmed(cameras)
        if this.views.keeps_frames:
            other.views.keep_frames()
        session = MemorySession(SessionState(len(other.recording), document=_all_views(other, progress)))
        if self._doubts_links:
            place_sure_pieces(GarmentService(other), session)
        found = session.state.document
        other.trust.recognised(found, None)  # both sides together decide whether it is a garment
        return other, found

    def _masks(self, document: Document, progress: Progress) -> Callable[[RgbdFrame], Bool]:
        """Return what gives the mask (H, W) of the other side in a frame with the mask of this one."""
        views = self.integration.views
        views.segment(document.strokes, progress)
        if any(views.recorded(n).other_mask is not None for n in range(len(views.recording))):
            return lambda frame: _or_empty(frame.other_mask, frame)
        sides = views.sides
        if sides is None:
            seen: Evidence = evidence_of(views, progress, confirmed=self._confirmed(document) is not None)
        else:
            seen = sides.solver(progress).observed
        found = other_side(seen, lambda n: _or_empty((frame := views.frame(n)).mask, frame))
        noisy = seen.noisy
        # Only the masks are kept, a bit a pixel: what they were found from takes 75 MB.
        packed = [
            None if (mask := found.mask(n)) is None else np.packbits(mask)
            for n in range(len(views.recording))
        ]

        def mask_of(frame: RgbdFrame) -> Bool:
            bits, shape = packed[frame.view_index], frame.depth_m.shape
            mask = None if bits is None else np.unpackbits(bits, count=math.prod(shape)).reshape(shape) > 0
            return _cleared(_or_empty(mask, frame), frame, noisy)

        return mask_of

    def _confirmed(self, document: Document) -> Registered | None:
        """Return the cameras of this side if half as many pairs as there are views confirm their poses."""
        cameras = self.integration.algorithm.cameras(document)
        if cameras is None or 2 * len(cameras.pairs) < len(self.integration.recording):
            return None
        return None if cameras.is_loose else cameras


def _as_seen(document: Document) -> Document:
    """Return a document without the decisions of a garment about floating pieces and links."""
    return replace(document, garment=without_doubts(replace(document.garment, pieces=())))


def one_side(side: Integration, document: Document) -> OneSide:
    """Return a side by itself as its method joins it to another, by the decisions about it."""
    canonical = side.canonical(document)
    return OneSide(
        document=document,
        parts=side.parts(document),
        canonical=canonical,
        ends=evidence_of_shape(canonical, seen_from(side, document)),
    )


def _all_views(other: Integration, progress: Progress) -> Document:
    """Return the decisions that integrate all views of a side that can be added to its shape."""
    start = other.answer(Document(), Request(0, "start"), progress)
    assert isinstance(start, Started)
    begun = Document(start_view=start.view_index)
    rest = [view for view in range(len(other.recording)) if view != start.view_index]
    why = other.why_left_out(begun, rest, lambda share, text: progress(share, f"other side: {text}"))
    taken = accept_all(begun, [view for view in rest if view not in why], {})
    return replace(taken, finished="All views were looked at.")


def _or_empty(mask: Bool | None, frame: RgbdFrame) -> Bool:
    return np.zeros(frame.depth_m.shape, dtype=np.bool_) if mask is None else mask


def _cleared(mask: Bool, frame: RgbdFrame, noisy: bool) -> Bool:
    """Return a mask that was found, without cloth of this side and, if noisy, the item's outermost pixel.

    There a sensor shows the background, or both; masks that are given leave it out.
    """
    this = _or_empty(frame.mask, frame)
    if noisy:
        shown = (mask | this).astype(np.uint8)
        mask = mask & (cv2.erode(shown, np.ones((3, 3), dtype=np.uint8)) > 0)
    return mask & ~this


def known_by_both(
    integration: Integration, document: Document, *, doubts_links: bool
) -> tuple[BothSides, KnownGarment | str | None]:
    """Return both sides, integrated again, and the garment by both, as :func:`known_with_pieces` does.

    ``doubts_links`` as for :class:`BothSides`; the views are kept. The garment is None if nothing relates the
    sides: then it is known by this one.
    """
    both = BothSides(integration, doubts_links=doubts_links, keeps_views=True)
    both.of(document)
    sides = both.known(document)
    if sides is None or not sides[0].is_related:
        return both, None
    return both, known_with_pieces(GarmentService(integration, both, doubts_links=False), document)
