"""Cloth that a kit is printed on, in simulation."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial import cKDTree

from flatcloth.core.types import Float64
from flatcloth.validation.kit import Kit, KitError, dictionary_codes

_INK, _CLOTH = 0.07, 0.88
"""Their brightness. Chosen: prints are never quite black, nor is cloth quite white."""


def printed_cloth(kit: Kit) -> Callable[[Float64, int], Float64]:
    """Return the function of the colors (N, 3), 0 to 1, at places (N, 2) of a panel's flat plane, in metres.

    Sheet 1 is on panel 1, sheet 2 on panel 2, its middle on the middle of the plane, x along u and y along
    v: places of the kit and of the truth differ by a shift. Beyond its sheet a panel is plain.

    Raises
    ------
    KitError
        If the kit is of stickers that are not measured yet.
    """
    if not kit.is_measured:
        raise KitError(f"{kit.name}: not measured. Measure it first: flatcloth kit --from-photo.")
    ids = np.array(list(kit.corners_m))
    corners, number = np.stack([kit.corners_m[i] for i in ids]), np.array([kit.sheet[i] for i in ids])
    marker_from_sheet = np.linalg.inv(np.stack([corners[:, k] - corners[:, 0] for k in (1, 3)], axis=-1))
    # Sheets lie apart in the third coordinate.
    nearest = cKDTree(np.column_stack([corners.mean(axis=1), number * 1e3]))
    codes = np.pad(dictionary_codes(kit.dictionary), ((0, 0), (1, 1), (1, 1)))

    def rgb(uv_m: Float64, panel: int) -> Float64:
        places = uv_m + np.array(kit.size_m) / 2
        marker = nearest.query(np.column_stack([places, np.full(len(places), panel * 1e3)]))[1]
        at = (marker_from_sheet[marker] @ (places - corners[marker, 0])[..., None])[..., 0]
        column, row = (np.floor(at * (codes.shape[1] - 2)) + 1).clip(0, codes.shape[1] - 1).astype(int).T
        black = codes[ids[marker], row, column] & (number[marker] == panel)
        return np.where(black[:, None], _INK, _CLOTH) * np.ones(3)

    return rgb
