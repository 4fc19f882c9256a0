"""The colors of a cloth that a kit is printed on."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from flatcloth.core.types import Float64
from flatcloth.validation.kit import Kit, KitError, dictionary_codes

_BLACK, _WHITE = 0.07, 0.88
"""Brightness of ink and cloth. Chosen: a textile print is never quite black, nor its cloth white."""


class PrintedCloth:
    """The colors of panels on which the sheets of a kit are printed: sheet 1 on panel 1, 2 on 2.

    The middle of a sheet lies in the middle of its panel's flat plane, x along u and y along v: places of
    the kit and of the panel differ by a shift. Without a sheet, and beyond it, a panel is plain.

    Raises
    ------
    KitError
        If the kit is of stickers that are not measured yet.
    """

    def __init__(self, kit: Kit) -> None:
        if not kit.is_measured:
            raise KitError(
                f"{kit.name}: not measured, so it cannot be printed. Run flatcloth kit --from-photo."
            )
        self._codes = dictionary_codes(kit.dictionary)
        self._middle_m = np.array(kit.size_m) / 2
        self._sheets = {}
        for number in sorted(set(kit.sheet.values())):
            ids = np.array([i for i in kit.corners_m if kit.sheet[i] == number])
            corners = np.stack([kit.corners_m[i] for i in ids])
            sides = np.stack([corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0]], axis=-1)
            self._sheets[number] = (ids, cKDTree(corners.mean(axis=1)), np.linalg.inv(sides))

    def __call__(self, uv_m: Float64, panel: int) -> Float64:
        """Return the colors (N, 3), 0 to 1, at places (N, 2) of a panel's flat plane."""
        rgb = np.full((len(uv_m), 3), _WHITE)
        if panel in self._sheets:
            ids, centers, across = self._sheets[panel]
            places = uv_m + self._middle_m
            nearest = centers.query(places)[1]
            modules = self._codes.shape[1]
            offset = (places - centers.data[nearest])[..., None]
            at = np.floor(((across[nearest] @ offset)[..., 0] + 0.5) * modules).astype(int)
            inside = ((at >= 0) & (at < modules)).all(axis=1)
            at = at[inside]
            black = np.zeros(len(uv_m), dtype=bool)
            black[inside] = self._codes[ids[nearest[inside]], at[:, 1], at[:, 0]]
            rgb[black] = _BLACK
        return rgb
