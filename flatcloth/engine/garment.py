"""What is known of an item by the shapes of its integration: its garment, and its other side.

The other side is integrated by itself, and joined to this one along the seams; then one outline is fitted to
the edges of both.
"""

from __future__ import annotations

import math
import threading
from collections import Counter
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import cast

import cv2
import numpy as np

from flatcloth.checking.result import WRONG
from flatcloth.core.cache import Cache
from flatcloth.core.errors import FlatclothError, GarmentError
from flatcloth.core.geometry import fit_rigid2, object_from_camera
from flatcloth.core.types import (
    MIRROR,
    Bool,
    FlattenedView,
    Float64,
    LaidPiece,
    Progress,
    RgbdFrame,
    no_progress,
)
from flatcloth.engine.headless import Run
from flatcloth.engine.integration import Integration
from flatcloth.engine.segmenting import evidence_of as evidence_of_sides
from flatcloth.engine.sheet import with_placed_pieces
from flatcloth.engine.trust import scale_std_of
from flatcloth.flattening.surface import crop_to_item
from flatcloth.garments.deciding import (
    DecidedPieces,
    decided,
    decided_pieces,
    placed_piece,
    pulls_of,
    with_placed_cloth,
)
from flatcloth.garments.evidence import PieceEvidence, evidence_of
from flatcloth.garments.named_points import KNOWN_STD_M, Point, pixel_near
from flatcloth.garments.placing import Placed
from flatcloth.garments.recognition import (
    NONE,
    Recognition,
    is_sure,
    recognise,
    temperature_of,
)
from flatcloth.garments.true_edges import FARTHEST_M, SeenFrom
from flatcloth.methods.answers import Canonical, JoinedSides, OneSide
from flatcloth.recordings.base import ViewImages, altered
from flatcloth.registration.registered import Registered
from flatcloth.segmentation.other_side import other_side
from flatcloth.session.document import Document
from flatcloth.session.garment import (
    DecidedSeam,
    GarmentDecisions,
    PlacedPiece,
)
from flatcloth.session.machine import MemorySession, SessionState
from flatcloth.session.store import Keeper

_SEAM_PLACES = 40
"""Places that a decision about a seam keeps. Chosen: enough to find the seam again on another shape."""


def seen_from(integration: Integration, document: Document) -> list[SeenFrom]:
    """Return the views of a document's shape, with their registered cameras (cached)."""

    def make() -> list[SeenFrom]:
        poses, views = integration.algorithm.poses(document), []
        for index in sorted(document.used_views):
            frame = _around_item(integration.views.frame(index))
            pose = poses.get(index) or object_from_camera(integration.axis, frame.angle_deg)
            views.append(SeenFrom(frame.depth_m, frame.mask, frame.intrinsics, pose.inverse()))
        return views

    return cast("list[SeenFrom]", integration.outlines.get(document.used_views, make))


def _around_item(frame: RgbdFrame) -> RgbdFrame:
    """Return the part of a view in which evidence of an outline is looked for, if its mask is known."""
    item = (frame.depth_m > 0) & (frame.mask if frame.mask is not None else False)
    if not item.any():
        return frame
    nearest_m = max(float(frame.depth_m[item].min()) - FARTHEST_M, FARTHEST_M)
    margin_px = FARTHEST_M * max(frame.intrinsics.fx, frame.intrinsics.fy) / nearest_m
    return crop_to_item(frame, item, math.ceil(margin_px) + 1)[0]


def evidence_of_shape(
    integration: Integration, document: Document, canonical: Canonical
) -> tuple[PieceEvidence, ...]:
    """Return the evidence of the canonical view and of each floating piece about the outline (cached)."""
    pieces = (canonical.view, *canonical.floating)

    def make() -> tuple[Canonical, list[PieceEvidence]]:
        views = seen_from(integration, document)
        ends = [evidence_of(own, views, [each for each in pieces if each is not own]) for own in pieces]
        return canonical, ends  # with the shape, so that no other has its id

    return tuple(integration.outlines.get(id(canonical), make)[1])


@dataclass(frozen=True, kw_only=True)
class KnownGarment:
    """The recognised garment of a document's shape.

    ``by_evidence`` is the result without the operator's decisions, ``found`` the result with them; ``pieces``
    are the decisions about the floating pieces of ``canonical``. ``is_wrong``: the recording is. ``doubt`` is
    the probability that the shape is not of its kind, 0 if the kind is no reason for doubt. ``sides`` are the
    joined sides whose edges are in the evidence, None if those of this side are alone.
    """

    canonical: Canonical
    evidence: tuple[PieceEvidence, ...]
    by_evidence: Recognition
    found: Recognition
    pieces: DecidedPieces
    is_wrong: bool = False
    doubt: float = 0.0
    sides: JoinedSides | None = None

    @property
    def kind(self) -> str:
        """The kind of garment, empty if it is none that is known."""
        return "" if self.found.kind == NONE else self.found.kind

    @cached_property
    def shape(self) -> FlattenedView:
        """The canonical view with the cloth of the placed pieces."""
        return with_placed_pieces(self.canonical, self.pieces).view

    def is_of(self, canonical: Canonical) -> bool:
        """Return whether it is the garment of a shape, whose deviations may have changed since."""
        return self.canonical.view.valid is canonical.view.valid

    def cloth_of(self, point: Point) -> FlattenedView:
        """Return the flattened view with the pixel of a named point: the shape, or a placed piece."""
        return self.canonical.view if point.piece is None else self.canonical.floating[point.piece]


class GarmentService:
    """Recognises the garments of an integration's shapes, and joins the other side of the item to them.

    It keeps the last results. Once the other side was joined, one outline is fitted to the edges of both.
    Safe for several threads.

    Parameters
    ----------
    integration : Integration
        Of this side. Frames are read through it, and the other side has its axis and settings.
    keeps_views : bool
        Whether the frames and flattened views of the other side are kept: a look ahead needs them soon.
    """

    def __init__(self, integration: Integration, *, keeps_views: bool = False) -> None:
        self.integration = integration
        self._keeps_views = keeps_views
        self._lock, self._joining = threading.Lock(), threading.Lock()
        self._shape: KnownGarment | None = None
        self._last: tuple[tuple[GarmentDecisions, bool], KnownGarment] | None = None
        self._others: Cache[tuple[Integration, Document]] = Cache(1)
        self._alone: Cache[OneSide] = Cache(1)  # the other side, not joined
        self._joined: Cache[JoinedSides] = Cache(2)

    # ---------------------------------------------------------------- the garment

    @property
    def last(self) -> KnownGarment | None:
        """The last recognised garment, None if there is none; does not wait for a running recognition."""
        last = self._last
        return None if last is None else last[1]

    @property
    def edge_m(self) -> float:
        """The largest u of the outline of the last garment; minus infinity if it is of no known kind."""
        last = self.last
        return float(last.found.outline_uv_m[:, 0].max()) if last is not None and last.kind else -math.inf

    def of(self, document: Document) -> KnownGarment:
        """Recognise the garment of a document's shape.

        Raises
        ------
        GarmentError
            If the shape shows too little, was seen in one view only, or (unattended) its recording is wrong.
        """
        integration = self.integration
        with self._lock:
            canonical = self.integration.laid_out(document)
            other = self.other(document)
            sides = None if other is None else other[0]
            shape = self._shape
            if shape is None or not shape.is_of(canonical) or shape.sides is not sides:
                if integration.is_unattended and integration.wrong(document):
                    # No garment fits what was laid out, and to try them all takes long.
                    raise GarmentError(f"{WRONG}. No garment is recognised.")
                shape = self._shape = self._recognised(canonical, document)
                self._last = None
            decided = document.garment, document.finished is None
            if self._last is None or self._last[0] != decided:
                known = self._decided(shape, document.garment)
                integration.trust.recognised(document, known.found)
                doubt = integration.trust.doubt_of_kind(document)
                if integration.wrong(document):  # then no length is reliable
                    known = replace(known, found=replace(known.found, dimensions={}), is_wrong=True)
                else:
                    away_m = integration.trust.kind_std_m(document)
                    found = _as_unsure_as(scale_std_of(integration.recording), away_m, known.found)
                    known = replace(known, found=found, doubt=doubt)
                self._last = decided, known
            return self._last[1]

    def known(self, document: Document) -> KnownGarment | str:
        """Return the recognised garment of a document's shape, or the reason why there is none."""
        try:
            return self.of(document)
        except GarmentError as error:
            return str(error)

    def evidence(self, document: Document) -> tuple[PieceEvidence, ...]:
        """Return the evidence of a document's shape, with that of the other side, and of each floating piece.

        Raises
        ------
        GarmentError
            If the shape was seen in one view only.
        """
        if len(document.used_views) < 2:
            raise GarmentError(
                "The shape was made of one view; a garment cannot be recognised from one. Add views."
            )
        main, *floating = evidence_of_shape(self.integration, document, self.integration.laid_out(document))
        if (other := self.other(document)) is not None:
            sides, integration, its = other
            seen = seen_from(integration, its)
            main = main.with_other_side(evidence_of(sides.other.view, seen, sides.other.floating))
            floating = [_with_joined(piece, n, sides, seen) for n, piece in enumerate(floating, start=1)]
        return (main, *floating)

    def compared(
        self, canonical: Canonical, evidence: Sequence[PieceEvidence], document: Document
    ) -> Recognition:
        """Return the kinds, compared by all views of the shape and the other side; errors as :meth:`of`."""
        other, used = self.other(document), set(document.used_views)
        if other is not None:
            used.update(other[2].used_views)
        angles_deg = [self.integration.views.angles_deg[n] for n in used]
        return recognise(canonical.view, evidence, temperature_of(angles_deg))

    def _recognised(self, canonical: Canonical, document: Document) -> KnownGarment:
        """Return the garment recognised without any decision."""
        evidence, other = self.evidence(document), self.other(document)
        found = self.compared(canonical, evidence, document)
        return KnownGarment(
            canonical=canonical,
            evidence=evidence,
            by_evidence=found,
            found=found,
            pieces=DecidedPieces(shape_from_piece={}, refused=frozenset()),
            sides=None if other is None else other[0],
        )

    def _decided(self, shape: KnownGarment, decisions: GarmentDecisions) -> KnownGarment:
        canonical, evidence = shape.canonical, shape.evidence
        pulls = pulls_of(decisions, canonical.view)
        pieces = decided_pieces(decisions, canonical.view, canonical.floating)
        found = decided(shape.by_evidence, evidence, canonical.view, decisions.kind, pulls)
        return replace(shape, found=with_placed_cloth(found, pieces, canonical.floating), pieces=pieces)

    # ---------------------------------------------------------------- the other side

    def joined(
        self,
        document: Document,
        progress: Progress = no_progress,
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
            with self._joining:
                for each in (_as_seen(document), document):
                    joined = self._joined.get(self._key(each), partial(self._made, each, progress, check))
                kept = self._others.kept(self._of(document))
                if kept is not None and not self._keeps_views:
                    kept[0].views.release(kept[1].used_views)
                    kept[0].algorithm.release(surfaces=True)
                this = self.integration
                shape, cameras = this.canonical(document), this.algorithm.cameras(document)
                return this.trust.of_sides(document, shape, cameras, joined)
        except FlatclothError as error:
            return f"Only one side is in the shape: {error}"

    def other(self, document: Document) -> tuple[JoinedSides, Integration, Document] | None:
        """Return the joined sides, the integration of the other side and its decisions, if they are related.

        None if :meth:`joined` was not called, or there is no other side. Floating pieces are where seams lay
        them, not where a garment does, so that a garment may be recognised by it.
        """
        found = self.joined_before(document)
        return found if found is not None and found[0].is_related else None

    def joined_before(self, document: Document) -> tuple[JoinedSides, Integration, Document] | None:
        """Return the sides as :meth:`other` does, also if nothing relates them."""
        sides = self._joined.kept(self._key(_as_seen(document)))
        other = None if sides is None else self._others.kept(self._of(document))
        return None if sides is None or other is None else (sides, *other)

    @staticmethod
    def _key(document: Document) -> tuple[Hashable, ...]:
        return document.shape_key, document.garment.pieces, document.garment.seams

    def _of(self, document: Document) -> tuple[Hashable, ...]:
        """Return what the other side depends on."""
        axis = self.integration.axis
        return (*document.strokes, tuple(axis.point_m), tuple(axis.direction))

    def _made(self, document: Document, progress: Progress, check: Callable[[], None]) -> JoinedSides:
        this = self.integration
        if not this.algorithm.joins_sides:
            raise FlatclothError(f"the method {this.method} integrates one.")
        other, its = self._others.get(self._of(document), lambda: self.integrated(document, progress))
        check()
        own = one_side(this, document)
        alone = self._alone.get(self._of(document), lambda: one_side(other, its))
        if not self._keeps_views:  # to join them takes the most memory of a run
            for side, decisions in ((this, document), (other, its)):
                seen_from(side, decisions)
                side.views.forget_frames()
            other.views.release(its.used_views)
            other.algorithm.release()
        pieces = decided_pieces(document.garment, own.canonical.view, own.canonical.floating)
        motions = pieces.shape_from_piece.items()
        laid = [LaidPiece(index=n, shape_from_piece=motion, std_m=pieces.std_m[n]) for n, motion in motions]
        return this.algorithm.with_other_side(own, laid, other.algorithm, alone, check)

    def integrated(
        self, document: Document, progress: Progress = no_progress
    ) -> tuple[Integration, Document]:
        """Integrate the other side alone: all views that show it, each where its cloth is in space.

        No placement is searched. Cloth that no view joins to the rest floats, to be joined by seams.
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
        if (cameras := self._confirmed(document)) is not None:
            other.algorithm.take_confirmed(cameras)
        session = MemorySession(SessionState(len(recording)))
        Run(other, session).finish(
            lambda share, text: progress(share, f"other side: {text}"), keeps_frames=this.views.keeps_frames
        )
        found = session.state.document
        other.trust.recognised(found, None)  # both sides together decide whether it is a garment
        return other, found

    def _masks(self, document: Document, progress: Progress) -> Callable[[RgbdFrame], Bool]:
        """Return what gives the mask (H, W) of the other side in a frame with the mask of this one."""
        views = self.integration.views
        views.segment(document.strokes, progress)
        if any(views.recorded(n).other_mask is not None for n in range(len(views.recording))):
            return lambda frame: _or_empty(frame.other_mask, frame)
        if views.finds_sides:
            seen = views.solver(progress).observed
        else:
            seen = evidence_of_sides(views, progress, confirmed=self._confirmed(document) is not None)
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


def _with_joined(
    evidence: PieceEvidence, piece: int, sides: JoinedSides, seen: list[SeenFrom]
) -> PieceEvidence:
    """Return the evidence of a floating piece, with that of the other side's pieces that seams join to it."""
    pieces = (sides.other.view, *sides.other.floating)
    joined = [s for s in sides.seams if not s.why and s.this_piece == piece and s.other_piece > 0]
    if not joined:
        return evidence
    other = Counter(s.other_piece for s in joined).most_common(1)[0][0]
    own = [s for s in joined if s.other_piece == other]
    this_from_mirrored = fit_rigid2(
        np.concatenate([s.other_uv_m for s in own]) * MIRROR, np.concatenate([s.this_uv_m for s in own])
    )
    rest = [each for n, each in enumerate(pieces) if n != other]
    return evidence.with_other_side(evidence_of(pieces[other], seen, rest), this_from_mirrored)


def _as_unsure_as(scale_std: float, away_m: float, found: Recognition) -> Recognition:
    """Return a garment with the deviations of its scale and its kind.

    A length has a share of itself by the scale. By the kind, lengths and named points have ``away_m``.
    """
    if not (scale_std or away_m):
        return found
    lengths = {
        name: replace(length, std_m=math.hypot(length.std_m, scale_std * length.value_m, away_m))
        for name, length in found.dimensions.items()
    }
    points = {
        name: replace(point, std_m=math.hypot(point.std_m, away_m)) for name, point in found.points.items()
    }
    return replace(found, dimensions=lengths, points=points)


def points_on_other_side(found: Recognition, sides: JoinedSides) -> dict[str, tuple[int, int]]:
    """Return the pixels (row, col) of the other side's shape at the named points that only it shows.

    Seams coincide on the plane of both, so a point of the outline has one place there.
    """
    if found.kind == NONE or not sides.is_related:
        return {}
    pixels = {}
    for name, point in found.points.items():
        pixel = pixel_near(point.uv_m * MIRROR, sides.other.view)
        if point.pixel is None and point.std_m <= KNOWN_STD_M and pixel is not None:
            pixels[name] = pixel
    return pixels


def _as_seen(document: Document) -> Document:
    """Return a document without the decisions about floating pieces."""
    return replace(document, garment=replace(document.garment, pieces=()))


def one_side(side: Integration, document: Document) -> OneSide:
    """Return a side by itself as its method joins it to another, by the decisions about it."""
    canonical = side.canonical(document)
    return OneSide(
        document=document,
        parts=side.parts(document),
        canonical=canonical,
        ends=lambda: evidence_of_shape(side, document, canonical),
    )


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


# --- decisions ------------------------------------------------------------------------------------


def place_sure_pieces(service: GarmentService, session: Keeper) -> KnownGarment | str:
    """Place the floating pieces with a reliable place on the garment, as decisions of the session.

    Earlier decisions are kept. On a shape of a wrong recording nothing is reliable.
    """
    known = service.known(session.state.document)
    if isinstance(known, str) or known.is_wrong:
        return known
    decided, unsure = known.pieces, frozenset() if known.sides is None else known.sides.unsure
    for piece in known.found.pieces if known.found.kind != NONE else ():
        if is_sure(piece) and piece.index not in {*decided.shape_from_piece, *decided.refused, *unsure}:
            session.record(piece_decision(known.canonical, piece, accepted=True))
    return service.known(session.state.document)


def decided_seam(xyz_m: Float64, *, kept: bool) -> DecidedSeam:
    """Return the decision about a seam with places (K, 3) in the object frame, by some of them."""
    some = np.linspace(0, len(xyz_m) - 1, min(len(xyz_m), _SEAM_PLACES)).astype(np.intp)
    return DecidedSeam(kept=kept, points_m=tuple((float(x), float(y), float(z)) for x, y, z in xyz_m[some]))


def known_with_pieces(service: GarmentService, document: Document) -> KnownGarment | str:
    """Return the garment of a document's shape with the pieces with a reliable place placed."""
    return place_sure_pieces(service, MemorySession(SessionState(0, document=document)))


def piece_decision(canonical: Canonical, piece: Placed, *, accepted: bool) -> PlacedPiece:
    """Return the decision about a piece at its place on the garment."""
    return placed_piece(
        canonical.floating[piece.index],
        canonical.view,
        piece.shape_from_piece,
        piece.probability,
        piece.std_m,
        accepted=accepted,
    )


def known_by_both(
    integration: Integration, document: Document
) -> tuple[GarmentService, KnownGarment | str | None]:
    """Return the garment by both sides, integrated again, as :func:`known_with_pieces` does.

    The views are kept. The garment is None if nothing relates the sides: then it is known by this one.
    """
    service = GarmentService(integration, keeps_views=True)
    service.joined(document)
    return service, None if service.other(document) is None else known_with_pieces(service, document)
