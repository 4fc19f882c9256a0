"""The result of a segmentation: side and certainty of every surface pixel, and the regions cut off."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field

import numpy as np

from flatcloth.core.strokes import Decision
from flatcloth.core.types import Bool, Float32
from flatcloth.segmentation.observed import Evidence
from flatcloth.segmentation.partition import Int8

OF_INTEREST, OTHER, UNDECIDED, NO_ITEM = 1, -1, 0, 2
"""Sides of pixels, numbers by definition; ``NO_ITEM``: not measured, or cut off."""


@dataclass(frozen=True, kw_only=True)
class ViewSegmentation:
    """One view, cropped to the item.

    ``offset_rc`` of the crop in the recorded image; ``side`` (h, w) int8, one of ``OF_INTEREST``,
    ``OTHER``, ``UNDECIDED``, ``NO_ITEM``; ``certainty`` (h, w) float32, 0.5 to 1 on the item, else 0.
    """

    offset_rc: tuple[int, int]
    side: Int8
    certainty: Float32


@dataclass(frozen=True, kw_only=True)
class Suggestion:
    """Where a stroke would help most: a pixel of a view, and how much less cloth is expected wrong then."""

    view_index: int
    rc: tuple[int, int]
    gain_m2: float
    text: str


@dataclass(frozen=True, kw_only=True)
class Segmentation:
    """The sides of the cloth.

    ``side`` (M,) int8 and ``certainty`` (M,) float32 are those of ``observed.clusters``; the methods
    give them for pixels. ``conflicts`` says which decisions contradict each other, ``changed``
    what the last one changed ("": there is none).
    """

    observed: Evidence = field(repr=False)
    decisions: tuple[Decision, ...]
    side: Int8 = field(repr=False)
    certainty: Float32 = field(repr=False)
    conflicts: tuple[str, ...] = ()
    changed: str = ""

    @property
    def area_of_interest_m2(self) -> float:
        """Visible area of the cloth on the side of interest."""
        return float(self.observed.clusters.area_m2[self.side == OF_INTEREST].sum())

    @property
    def area_undecided_m2(self) -> float:
        """Area of the cloth whose side is undecided."""
        return float(self.observed.clusters.area_m2[self.side == UNDECIDED].sum())

    @property
    def mean_certainty(self) -> float:
        """Mean certainty of the cloth labelled as of interest, by area: the expected share that is right."""
        chosen = self.side == OF_INTEREST
        area = self.observed.clusters.area_m2[chosen]
        return float((self.certainty[chosen] * area).sum() / max(float(area.sum()), 1e-12))

    @property
    def facing_view(self) -> int:
        """The view that shows most of the side of interest, by the area of its pixels."""

        def area(view_index: int) -> float:
            seen, sides = self.observed.views[view_index], self.view(view_index)
            assert sides is not None
            return float(np.square(seen.depth_m[sides.side == OF_INTEREST]).sum())

        return max(self.observed.views, key=area)

    @property
    def text(self) -> str:
        """The result in a sentence."""
        undecided = 1e4 * self.area_undecided_m2
        rest = f"; {undecided:.0f} cm2 are undecided and stay out" if undecided >= 1 else ""
        n = len(self.decisions)
        how = "without strokes" if not n else f"by {n} stroke{'s' if n > 1 else ''}"
        return (
            f"Side of interest: the one that view {self.facing_view} shows most of; "
            f"{1e4 * self.area_of_interest_m2:.0f} cm2 seen, "
            f"{self.mean_certainty:.0%} certain, {how}{rest}."
        )

    def view(self, view_index: int) -> ViewSegmentation | None:
        """Return the sides in one view; None if the view shows nothing of the item."""
        seen = self.observed.views.get(view_index)
        if seen is None:
            return None
        known = seen.outlined & (seen.cluster >= 0)
        side = np.full(seen.cluster.shape, NO_ITEM, dtype=np.int8)
        side[seen.outlined] = UNDECIDED
        side[known] = self.side[seen.cluster[known]]
        certainty = np.zeros(seen.cluster.shape, dtype=np.float32)
        certainty[seen.outlined] = 0.5
        certainty[known] = self.certainty[seen.cluster[known]]
        return ViewSegmentation(offset_rc=seen.offset_rc, side=side, certainty=certainty)

    def mask(self, view_index: int) -> Bool | None:
        """Return the mask (H, W) of the side of interest in the recorded image; None as :meth:`view`."""
        seen = self.observed.views.get(view_index)
        if seen is None:
            return None
        chosen = seen.outlined & (seen.cluster >= 0)
        chosen[chosen] = self.side[seen.cluster[chosen]] == OF_INTEREST
        return seen.whole(chosen)

    def mask_key(self, view_index: int) -> int:
        """Return a hash of the mask of a view, without making the mask."""
        seen = self.observed.views.get(view_index)
        if seen is None:
            return 0
        return zlib.crc32(np.packbits(self.side[seen.shows] == OF_INTEREST).tobytes())


def best_view(observed: Evidence, cluster: int) -> tuple[int, tuple[int, int]] | None:
    """Return the view that shows a cluster largest, and the pixel in its middle."""
    best: tuple[int, int, tuple[int, int]] | None = None
    for n, view in observed.views.items():
        places = np.argwhere((view.cluster == cluster) & view.surface)
        if len(places) and (best is None or len(places) > best[0]):
            middle = places[np.square(places - places.mean(axis=0)).sum(axis=1).argmin()] + view.offset_rc
            best = len(places), n, (int(middle[0]), int(middle[1]))
    return None if best is None else best[1:]
