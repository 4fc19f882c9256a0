"""Parts whose link no garment allows: decided about once, found again by their cloth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from flatcloth.core.types import Bool, FlattenedView, Int64
from flatcloth.garments.links import Cloth, DoubtedLink, side_of
from flatcloth.session.garment import ClothPlaces, DoubtedPart

_SAME_M = 0.015
"""A point of cloth found again: joint registration moves measured points by less (as in ``deciding``)."""
_TIED = 48
"""Points of cloth that a part, and the rest, are tied to. Chosen: more cost space in the journal."""
_LEAST_FOUND = 0.5
"""Share of them that is to be found again, or the part is not there any more. Set by hand."""


def decided_part(
    cloth: Cloth, link: DoubtedLink, *, taken_off: bool, is_doubted: bool = False
) -> DoubtedPart:
    """Return a decision about a part, tied to its cloth and to that of the rest; or that it is doubted."""
    placed = np.isfinite(cloth.uv_m[:, 0])
    return DoubtedPart(
        taken_off=taken_off,
        part=_tied(cloth, np.flatnonzero(link.part)),
        rest=_tied(cloth, np.flatnonzero(placed & ~link.part)),
        probability=float(link.probability),
        std_m=link.std_m if is_doubted else 0.0,
    )


def _tied(cloth: Cloth, samples: Int64) -> ClothPlaces:
    chosen = samples[np.linspace(0, len(samples) - 1, min(_TIED, len(samples))).astype(int)]
    return ClothPlaces(
        points_m=tuple((float(x), float(y), float(z)) for x, y, z in cloth.xyz_m[chosen]),
        uv_m=tuple((float(u), float(v)) for u, v in cloth.uv_m[chosen]),
    )


def found_again(cloth: Cloth, decision: DoubtedPart) -> Bool | None:
    """Return the samples (N,) of a decided part on a shape as it is now; None if it is not on it."""
    placed = np.flatnonzero(np.isfinite(cloth.uv_m[:, 0]))
    tree = cKDTree(cloth.xyz_m[placed])
    ends = []
    for tied in (decision.part, decision.rest):
        off, nearest = tree.query(np.array(tied.points_m))
        if (off <= _SAME_M).mean() < _LEAST_FOUND:
            return None
        ends.append(placed[nearest[off <= _SAME_M]])
    own, others = np.setdiff1d(ends[0], ends[1]), np.setdiff1d(ends[1], ends[0])
    if not (own.size and others.size):
        return None
    return side_of(cloth, own, others)


def is_decided(cloth: Cloth, link: DoubtedLink, decisions: Sequence[DoubtedPart]) -> bool:
    """Return whether one of the decisions is about the part of a link."""
    return any(_is_same(part, link.part) for _, part in _last_decisions(cloth, decisions))


def parts_taken_off(cloth: Cloth, decisions: Sequence[DoubtedPart]) -> list[Bool]:
    """Return the samples (N,) of each part that is taken off now; of a part, the last decision counts."""
    return [part for decision, part in _last_decisions(cloth, decisions) if decision.taken_off]


def _last_decisions(cloth: Cloth, decisions: Sequence[DoubtedPart]) -> list[tuple[DoubtedPart, Bool]]:
    """Return the last decision about each part that is found again, and its samples (N,)."""
    found: list[tuple[DoubtedPart, Bool]] = []
    for decision in decisions:
        part = found_again(cloth, decision)
        if part is not None:
            found = [(before, other) for before, other in found if not _is_same(part, other)]
            found.append((decision, part))
    return found


def _is_same(part: Bool, other: Bool) -> bool:
    return bool((part & other).sum() > 0.5 * (part | other).sum())


def with_doubts(view: FlattenedView, cloth: Cloth, decisions: Sequence[DoubtedPart]) -> FlattenedView:
    """Return the shape with larger standard deviations where the link of a part is doubted.

    Joined or lying elsewhere are two hypotheses; the variance of a place is that between them.
    """
    doubted = [(d.std_m, part) for d, part in _last_decisions(cloth, decisions) if d.std_m]
    if not doubted or view.placement_std_m is None:
        return view
    std = view.placement_std_m.copy()
    for std_m, part in doubted:
        own = pixels_of_part(view, cloth, part)
        std[own] = np.hypot(std[own], np.float32(std_m))
    return replace(view, placement_std_m=std)


def pixels_of_part(view: FlattenedView, cloth: Cloth, part: Bool) -> Bool:
    """Return the pixels (H, W) of the shape that a part (N,) of its samples carries."""
    placed = np.flatnonzero(np.isfinite(cloth.uv_m[:, 0]))
    pixels = np.argwhere(view.valid)
    own = np.zeros(view.shape, dtype=np.bool_)
    own[view.valid] = part[placed[cKDTree(cloth.uv_m[placed]).query(view.uv_from_rc(pixels))[1]]]
    return own
