"""What the exports of a session share: shapes of the past, their growth, and pictures; bounded in bytes."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.cache import Cache
from flatcloth.core.types import FlattenedView, RotationAxis
from flatcloth.engine.both_sides import BothSides
from flatcloth.engine.sheet import Sheet
from flatcloth.methods.answers import Plan
from flatcloth.rendering.pictures import PlanePicture
from flatcloth.session.machine import Document

if TYPE_CHECKING:
    from flatcloth.engine.garment.recognition import GarmentService
    from flatcloth.engine.integration import Integration

_MIB = 1 << 20
"""Bytes in a mebibyte. By definition."""
_MOST = 512
"""Values of each kind that are kept, if their bytes allow. Chosen: more than a session has views."""
_SHEETS_BYTES, _PICTURES_BYTES, _GROWTHS_BYTES, _PLANS_BYTES = 48 * _MIB, 24 * _MIB, 4 * _MIB, 2 * _MIB
"""Of shirt-sleeve-clean with 35 views a sheet takes 1 MiB, a picture of a proposal 0.5 MiB, a growth
0.5 MiB, and a plan 0.02 MiB. Measured."""


@dataclass(frozen=True, kw_only=True)
class GrownArrays:
    """What of a growth takes long to compute: ``first_step`` (H, W), and the areas after each step, m2."""

    first_step: NDArray[np.int16]
    area_m2: tuple[float, ...]
    floating_m2: tuple[float, ...]


class Kept:
    """Computed values that several exports, or several parts of one, need. Safe for several threads.

    Keys are those of :func:`key_of`, so that each value belongs to the axis and the decisions that it was
    computed from.

    Parameters
    ----------
    garments : GarmentService, optional
        Recognises the garment; by default each export has its own.
    both : callable, optional
        Returns the other side if it is known already.
    """

    def __init__(
        self, garments: GarmentService | None = None, both: Callable[[], BothSides | None] = lambda: None
    ) -> None:
        self.garments, self.both = garments, both
        self._own: BothSides | None = None
        self.plans: Cache[Plan | None] = Cache(_MOST, _PLANS_BYTES)
        self.growths: Cache[GrownArrays] = Cache(_MOST, _GROWTHS_BYTES)
        self.pictures: Cache[PlanePicture] = Cache(_MOST, _PICTURES_BYTES)
        self.sheets: Cache[Sheet] = Cache(_MOST, _SHEETS_BYTES)

    def both_of(self, integration: Integration) -> BothSides:
        """Return the other side of an integration, the same one for all exports (cached)."""
        if self._own is None or self._own.integration is not integration:
            self._own = BothSides(integration)
        return self._own


def key_of(axis: RotationAxis, document: Document) -> Hashable:
    """Return the key of a document's sheet: everything that it depends on."""
    shape = document.shape_key
    return axis.point_m.tobytes(), axis.direction.tobytes(), shape, document.garment.pieces


def colors_of(sheet: Sheet) -> Sheet:
    """Return a sheet with its colors and pieces; all else that a pixel knows is missing (NaN)."""
    canonical = sheet.canonical
    floating = tuple(_bare(each) for each in canonical.floating)
    return replace(
        sheet,
        canonical=replace(canonical, view=_bare(canonical.view), floating=floating),
        view=replace(_bare(sheet.view), valid=sheet.view.valid, rgb=sheet.view.rgb),
        pieces=tuple(replace(piece, view=_bare(piece.view)) for piece in sheet.pieces),
    )


def _bare(view: FlattenedView) -> FlattenedView:
    """Return a view of the same grid without pixels, which takes no memory."""

    def nothing(like: NDArray[Any]) -> NDArray[Any]:
        value = np.nan if like.dtype.kind == "f" else -1 if like.dtype.kind == "i" else 0
        return np.broadcast_to(np.array(value, dtype=like.dtype), like.shape)

    names = ("rgb", "xyz_m", "normal", "z_angle_deg", "valid", "view_index", "source_rc")
    arrays: dict[str, Any] = {name: nothing(getattr(view, name)) for name in names}
    return replace(view, **arrays, quality=None, placement_std_m=None)
