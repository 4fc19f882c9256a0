"""What accepting a proposal would do, and the checks that speak for or against it, as plain JSON values."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from flatcloth.core.types import Bool, FlattenedView, RotationAxis, finite
from flatcloth.engine.sheet import label_of
from flatcloth.rendering.layers import CONFLICT_M, difference

if TYPE_CHECKING:
    from flatcloth.viewer.protocol.picture import Overlay

APART_LIMIT_MM = 1000.0 * CONFLICT_M  # as in the 3D scene
SHARE_LIMIT = 0.1
"""As without an operator: of a larger share that contradicts, no view is accepted."""
_JOINS_M2 = 2e-4
"""A piece is joined if the proposal covers so much of it."""


def foreseen(overlay: Overlay, own: int, others: Sequence[tuple[FlattenedView, Bool]]) -> dict[str, Any]:
    """Return what accepting a proposal on the piece ``own`` would add (cm2), measure again, and join.

    ``others`` are the other components of the view, each with where it is new: they come along.
    """
    view, sheet = overlay.view, overlay.sheet
    pixel_cm2 = 1e4 * view.pixel_size_m**2
    added = int((overlay.new_points & view.valid).sum()) + sum(int(fresh.sum()) for _, fresh in others)
    whole = int(view.valid.sum()) + sum(int(part.valid.sum()) for part, _ in others)
    rc = np.rint(sheet.view.rc_from_uv(view.uv_from_rc(np.argwhere(view.valid)))).astype(int)
    inside = ((rc >= 0) & (rc < sheet.view.shape)).all(axis=1)
    on = sheet.piece[rc[inside, 0], rc[inside, 1]]
    covered = np.bincount(on[on >= 0], minlength=len(sheet.pieces) + 1) * view.pixel_size_m**2
    joins = [label_of(n) for n, area_m2 in enumerate(covered) if n != own and area_m2 >= _JOINS_M2]
    return {
        "added_cm2": pixel_cm2 * added,
        "again_cm2": pixel_cm2 * (whole - added),
        "joins": joins,
    }


def checks(overlay: Overlay, axis: RotationAxis) -> list[dict[str, Any]]:
    """Return the checks: title, value and limit with their unit, whether it is passed, where it is worst.

    ``passed`` is None if the cloth in common does not tell.
    """
    apart = difference(overlay.sheet.view, overlay.view, axis)
    common = apart.common
    median_mm = 1000 * float(np.median(apart.distance_m[common])) if common.any() else float("nan")
    with np.errstate(invalid="ignore"):
        far = common & (apart.distance_m * 1000 > APART_LIMIT_MM)
    parts = overlay.score.parts
    crossed = 1.0 - parts["outline_agreement"] if "outline_agreement" in parts else float("nan")
    twice = parts.get("twice_share", float("nan"))
    shared = _middle(overlay.view, common)
    worst = _middle(overlay.view, far) or shared
    return [
        _check("apart", "Distance in space", median_mm, APART_LIMIT_MM, "mm", worst),
        _check("twice", "Cloth covered twice", 100 * twice, 100 * SHARE_LIMIT, "%", shared),
        _check("outline", "Outline crossed", 100 * crossed, 100 * SHARE_LIMIT, "%", shared),
    ]


def _check(
    name: str, title: str, value: float, limit: float, unit: str, place: list[float] | None
) -> dict[str, Any]:
    known = finite(value)
    return {
        "name": name,
        "title": title,
        "value": known,
        "limit": limit,
        "unit": unit,
        "passed": None if known is None else known <= limit,
        "place_uv_m": place,
    }


def _middle(view: FlattenedView, where: Bool) -> list[float] | None:
    """Return a place (u, v) among pixels, near their middle."""
    rc = np.argwhere(where)
    if not len(rc):
        return None
    nearest = rc[np.argmin(np.square(rc - np.median(rc, axis=0)).sum(axis=1))]
    place: list[float] = view.uv_from_rc(nearest).tolist()
    return place
