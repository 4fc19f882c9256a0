"""How far the shape of a recording can be trusted: by its check, its registration and its garment."""

from __future__ import annotations

import math
from collections.abc import Hashable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from flatcloth.checking import result
from flatcloth.checking.check import known_check
from flatcloth.checking.hypotheses import FOCAL_STD
from flatcloth.core.types import FlattenedView, Float64
from flatcloth.garments.recognition import NONE, Recognition
from flatcloth.methods.answers import Canonical, JoinedSides
from flatcloth.recordings.base import Recording
from flatcloth.registration.registered import Registered
from flatcloth.session.document import Document

_KNOWN = 0.75
"""A shape is known to be a garment from this probability on, odds of 3. Weaker evidence is hardly worth a
mention (Kass and Raftery 1995, Bayes Factors, 3.2)."""


class _Doubts(NamedTuple):
    """What makes a shape less reliable: its recording, its scale (a share of each length), and its kind."""

    is_wrong: bool
    scale_std: float
    kind_std_m: float


class Trust:
    """Whether the shapes of a recording can be trusted.

    A shape that no known kind of garment explains has a false joint somewhere, or is another item. What lies
    beyond such a joint may be anywhere on the item, and it is not known where the joint is. So nothing of it
    is reliable until an operator names the kind. Once all views were looked at, a shape that may well be of
    no known kind is as doubtful; before, and while a recording grows, too little may have been seen to tell.
    That several kinds explain a shape is no reason for doubt.
    """

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self._kind: tuple[Hashable, Recognition | None] = None, None
        self._last: tuple[Canonical, _Doubts, Canonical] | None = None
        self._last_sides: tuple[JoinedSides, _Doubts, JoinedSides] | None = None

    def recognised(self, document: Document, found: Recognition | None) -> None:
        """Keep which garment a document's shape is; None: its kind is no reason for doubt."""
        self._kind = document.shape_key, found

    def wrong(self, document: Document, canonical: Canonical, registered: Registered | None) -> list[str]:
        """Return the reasons why something about the recording is wrong."""
        floating_m2 = sum(piece.area_m2 for piece in canonical.floating)
        share = floating_m2 / max(floating_m2 + canonical.view.area_m2, 1e-9)
        fits_none = _is_none(self._kind_of(document))
        return result.wrong_with(known_check(self._recording), registered, share, fits_none=fits_none)

    def doubt_of_kind(self, document: Document) -> float:
        """Return the probability that a shape is of no known kind; 0 if that is no reason for doubt."""
        found = self._kind_of(document)
        if found is None or found.by_hand is not None:
            return 0.0
        if _is_none(found):
            return found.probability
        is_all = document.finished is not None and not self._recording.is_growing
        of_none = found.probabilities.get(NONE, 0.0)
        return of_none if is_all and of_none > 1.0 - _KNOWN else 0.0

    def kind_std_m(self, document: Document) -> float:
        """Return the deviation of each place of a shape that its doubted kind adds; 0 without doubt.

        A place is right or, with the probability of :meth:`doubt_of_kind`, anywhere on the item.
        """
        found, doubt = self._kind_of(document), self.doubt_of_kind(document)
        return math.sqrt(doubt) * found.apart_m if found is not None and doubt else 0.0

    def of(self, document: Document, canonical: Canonical, registered: Registered | None) -> Canonical:
        """Return a shape as unsure as its scale and its kind; not reliable at all if something is wrong."""
        doubts = self._doubts(document, canonical, registered)
        if self._last is None or self._last[0] is not canonical or self._last[1] != doubts:
            self._last = canonical, doubts, _doubted(canonical, doubts)
        return self._last[2]

    def of_sides(
        self, document: Document, canonical: Canonical, registered: Registered | None, sides: JoinedSides
    ) -> JoinedSides:
        """Return the other side, and the pieces that it lays, as unsure as the shape that it is joined to."""
        doubts = self._doubts(document, canonical, registered)
        if self._last_sides is None or self._last_sides[0] is not sides or self._last_sides[1] != doubts:
            laid = tuple(
                replace(each, std_m=math.hypot(each.std_m, doubts.kind_std_m)) for each in sides.laid
            )
            made = replace(sides, other=_doubted(sides.other, doubts), laid=laid)
            self._last_sides = sides, doubts, made
        return self._last_sides[2]

    def _kind_of(self, document: Document) -> Recognition | None:
        of, found = self._kind
        return found if of == document.shape_key else None

    def _doubts(self, document: Document, canonical: Canonical, registered: Registered | None) -> _Doubts:
        return _Doubts(
            is_wrong=bool(self.wrong(document, canonical, registered)),
            scale_std=scale_std_of(self._recording),
            kind_std_m=self.kind_std_m(document),
        )


def _is_none(found: Recognition | None) -> bool:
    """Return whether a shape was found to be of no known kind."""
    return found is not None and found.by_hand is None and found.kind == NONE


def scale_std_of(recording: Recording) -> float:
    """Return the deviation of the scale of a recording, as a share: that of a mended focal length, or 0."""
    mends = getattr(recording, "mends", None)
    return 0.0 if mends is None or mends.focal_factor == 1.0 else FOCAL_STD


def _doubted(canonical: Canonical, doubts: _Doubts) -> Canonical:
    """Return a shape with the deviations that doubts leave it: none that is known if something is wrong.

    An unsure scale is the worse the farther from the middle.
    """
    view = canonical.view
    std_m = view.placement_std_m
    if std_m is None or not any(doubts):
        return canonical
    if doubts.is_wrong:
        std_m = np.full_like(std_m, np.nan)
    else:
        away_m = doubts.scale_std * _from_middle_m(view)
        std_m = np.sqrt(std_m**2 + away_m**2 + doubts.kind_std_m**2).astype(std_m.dtype)
    return replace(canonical, view=replace(view, placement_std_m=std_m))


def _from_middle_m(view: FlattenedView) -> Float64:
    """Return how far (R, C) the pixels of a view are from the middle of its cloth."""
    uv_m = view.uv_from_rc(np.moveaxis(np.indices(view.valid.shape), 0, -1))
    away_m: Float64 = np.linalg.norm(uv_m - uv_m[view.valid].mean(axis=0), axis=-1)
    return away_m
