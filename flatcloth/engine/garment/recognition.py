"""Recognition of the garment of a session's document."""

from __future__ import annotations

import math
import threading
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from flatcloth.checking.result import WRONG
from flatcloth.core.errors import GarmentError
from flatcloth.core.geometry import fit_rigid2, object_from_camera
from flatcloth.core.types import MIRROR, FlattenedView, RgbdFrame
from flatcloth.engine.integration import Integration
from flatcloth.engine.sheet import with_placed_pieces
from flatcloth.engine.trust import scale_std_of
from flatcloth.flattening.cloth import Cloth
from flatcloth.flattening.surface import crop_to_item
from flatcloth.garments.deciding import (
    DecidedPieces,
    decided,
    decided_pieces,
    is_decided,
    pulls_of,
    with_placed_cloth,
)
from flatcloth.garments.evidence import PieceEvidence, evidence_of
from flatcloth.garments.kinds import known_kinds
from flatcloth.garments.links import DoubtedLink, doubted_links, is_offered
from flatcloth.garments.named_points import KNOWN_STD_M, Point, pixel_near
from flatcloth.garments.recognition import NONE, Recognition, best_fits, is_suspect, recognise, temperature_of
from flatcloth.garments.true_edges import FARTHEST_M, SeenFrom
from flatcloth.methods.answers import Canonical, JoinedSides
from flatcloth.session.document import Document
from flatcloth.session.garment import (
    GarmentDecisions,
    without_doubts,
)


def seen_from(integration: Integration, document: Document) -> list[SeenFrom]:
    """Return the views of a document's shape, with their registered cameras."""
    poses = integration.algorithm.poses(document)
    views = []
    for index in sorted(document.used_views):
        frame = _around_item(integration.views.frame(index))
        pose = poses.get(index) or object_from_camera(integration.axis, frame.angle_deg)
        views.append(
            SeenFrom(
                depth_m=frame.depth_m,
                of_interest=frame.mask,
                intrinsics=frame.intrinsics,
                camera_from_object=pose.inverse(),
            )
        )
    return views


def _around_item(frame: RgbdFrame) -> RgbdFrame:
    """Return the part of a view in which evidence of an outline is looked for, if its mask is known."""
    item = (frame.depth_m > 0) & (frame.mask if frame.mask is not None else False)
    if not item.any():
        return frame
    nearest_m = max(float(frame.depth_m[item].min()) - FARTHEST_M, FARTHEST_M)
    margin_px = FARTHEST_M * max(frame.intrinsics.fx, frame.intrinsics.fy) / nearest_m
    return crop_to_item(frame, item, math.ceil(margin_px) + 1)[0]


def evidence_of_shape(canonical: Canonical, views: list[SeenFrom]) -> tuple[PieceEvidence, ...]:
    """Return the evidence of the canonical view and of each floating piece about the outline."""
    pieces = (canonical.view, *canonical.floating)
    return tuple(evidence_of(own, views, [each for each in pieces if each is not own]) for own in pieces)


@dataclass(frozen=True, kw_only=True)
class KnownGarment:
    """The recognised garment of a document's shape.

    ``by_evidence`` is the result without the operator's decisions, ``found`` the result with them; ``pieces``
    are the decisions about the floating pieces of ``canonical``. ``links`` are the undecided links of
    ``cloth`` that no garment allows, the least probable first. ``is_wrong``: the recording is. ``doubt`` is
    the probability that the shape is not of its kind, 0 if the kind is no reason for doubt.
    ``sides`` are the joined sides whose edges are in the evidence, None if those of this side are alone.
    """

    canonical: Canonical
    evidence: tuple[PieceEvidence, ...]
    by_evidence: Recognition
    found: Recognition
    pieces: DecidedPieces
    cloth: Cloth | None = None
    links: tuple[DoubtedLink, ...] = ()
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


class _Joined(Protocol):
    """What knows the other side: ``BothSides``."""

    def of(self, document: Document) -> JoinedSides | str:
        """Join the other side to a document's shape."""
        ...

    def known(self, document: Document) -> tuple[JoinedSides, Integration, Document] | None:
        """Return the joined sides of a document's shape; with the other side's integration and decisions."""
        ...


class GarmentService:
    """Recognises the garments of an integration's shapes; keeps the last result. Safe for several threads.

    ``doubts_links``: links that no garment allows are looked for, which takes seconds. Once ``both`` has
    joined the other side to a shape, one outline is fitted to the edges of both.
    """

    def __init__(
        self, integration: Integration, both: _Joined | None = None, *, doubts_links: bool = True
    ) -> None:
        self.integration, self._both, self._doubts_links = integration, both, doubts_links
        self._lock = threading.Lock()
        self._shape: KnownGarment | None = None
        self._last: tuple[tuple[GarmentDecisions, bool], KnownGarment] | None = None

    @property
    def last(self) -> KnownGarment | None:
        """The last recognised garment, None if there is none; does not wait for a running recognition."""
        last = self._last
        return None if last is None else last[1]

    def of(self, document: Document) -> KnownGarment:
        """Recognise the garment of a document's shape.

        Raises
        ------
        GarmentError
            If the shape shows too little, was seen in one view only, or (unattended) its recording is wrong.
        """
        integration = self.integration
        # The shape is recognised with all its links; doubts about links follow from the result.
        document = replace(document, garment=without_doubts(document.garment))
        with self._lock:
            canonical = self.integration.laid_out(document)
            other = self._other(document)
            sides = None if other is None else other[0]
            shape = self._shape
            if shape is None or not shape.is_of(canonical) or shape.sides is not sides:
                if integration.algorithm.is_unattended and integration.wrong(document):
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
        views = seen_from(self.integration, document)
        if len(views) < 2:
            raise GarmentError(
                "The shape was made of one view; a garment cannot be recognised from one. Add views."
            )
        main, *floating = evidence_of_shape(self.integration.laid_out(document), views)
        if (other := self._other(document)) is not None:
            sides, integration, its = other
            seen = seen_from(integration, its)
            main = main.with_other_side(evidence_of(sides.other.view, seen, sides.other.floating))
            floating = [_with_joined(piece, n, sides, seen) for n, piece in enumerate(floating, start=1)]
        return (main, *floating)

    def sides(self, document: Document) -> JoinedSides | None:
        """Return the joined sides of a document's shape; None without the other side, or unrelated to it."""
        if self._both is not None:
            self._both.of(document)
        other = self._other(document)
        return None if other is None else other[0]

    def _other(self, document: Document) -> tuple[JoinedSides, Integration, Document] | None:
        """Return the other side with its integration and decisions, if it is joined to this one."""
        known = None if self._both is None else self._both.known(document)
        return known if known is not None and known[0].is_related else None

    def compared(
        self, canonical: Canonical, evidence: Sequence[PieceEvidence], document: Document
    ) -> Recognition:
        """Return the kinds, compared by all views of the shape and the other side; errors as :meth:`of`."""
        other, used = self._other(document), set(document.used_views)
        if other is not None:
            used.update(other[2].used_views)
        angles_deg = [self.integration.views.angles_deg[n] for n in used]
        return recognise(canonical.view, evidence, temperature_of(angles_deg))

    def _recognised(self, canonical: Canonical, document: Document) -> KnownGarment:
        """Return the garment recognised without any decision."""
        evidence, other = self.evidence(document), self._other(document)
        found = self.compared(canonical, evidence, document)
        cloth, links = None, []
        if self._doubts_links and is_suspect(found.fit, evidence[0]) and not self.integration.wrong(document):
            cloth = self.integration.cloth(document)
        if cloth is not None:
            alone = evidence[0].this_side
            links = doubted_links(best_fits(alone, known_kinds()), alone, cloth)
        return KnownGarment(
            canonical=canonical,
            evidence=evidence,
            by_evidence=found,
            found=found,
            pieces=DecidedPieces(shape_from_piece={}, refused=frozenset()),
            cloth=cloth,
            links=tuple(link for link in links if is_offered(link)),
            sides=None if other is None else other[0],
        )

    def _decided(self, shape: KnownGarment, decisions: GarmentDecisions) -> KnownGarment:
        canonical, evidence, cloth = shape.canonical, shape.evidence, shape.cloth
        pulls = pulls_of(decisions, canonical.view)
        pieces = decided_pieces(decisions, canonical.view, canonical.floating)
        found = decided(shape.by_evidence, evidence, canonical.view, decisions.kind, pulls)
        links = [
            each for each in shape.links if cloth is None or not is_decided(cloth, each.part, decisions.parts)
        ]
        return replace(
            shape,
            found=with_placed_cloth(found, pieces, canonical.floating),
            pieces=pieces,
            links=tuple(links),
        )


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
