"""An example of both sides for the teaching mode, as long as those of the session are not known."""

from __future__ import annotations

import numpy as np

from flatcloth.core.types import MIRROR, Bool, FlattenedView
from flatcloth.flattening.borders import SPACING_M
from flatcloth.methods.answers import Canonical, JoinedSides, Seam

_PIXEL_M = 0.004
"""Pixel size of the example. Chosen."""
_ROWS, _COLS = 120, 150
"""Size of the example: a skirt 48 cm long and up to 60 cm wide. Chosen."""


def example_of_both_sides() -> tuple[Canonical, JoinedSides]:
    """Return a skirt whose other side is half hidden, with two seams and a contact that is none."""
    row, col = np.mgrid[:_ROWS, :_COLS]
    half = 40.0 + 35.0 * row / _ROWS  # of its width, px
    skirt = np.abs(col - (_COLS - 1) / 2) < half
    seen = skirt & (np.abs(col - 30 - 0.5 * row) > 16)  # a fold hides the rest
    this, other = _view(skirt), _view(seen)
    v_m = np.arange(0.01, _PIXEL_M * _ROWS - 0.01, SPACING_M)
    edge_m = _PIXEL_M * (40.0 + 35.0 * v_m / (_PIXEL_M * _ROWS))
    seams = [
        _seam(np.column_stack([side * edge_m, v_m]), "", shown=seen, other=other) for side in (-1.0, 1.0)
    ]
    along = np.linspace(0.2, 0.26, 11)
    touch = np.column_stack([0.02 + 0.5 * (along - 0.2), along])
    seams.append(_seam(touch, "too few places meet"))
    sides = JoinedSides(
        other=Canonical(view=other, current_from_view={}), seams=tuple(seams), is_related=True
    )
    return Canonical(view=this, current_from_view={}), sides


def _view(valid: Bool) -> FlattenedView:
    """Return flat cloth of one colour."""
    shape = valid.shape
    v, u = np.mgrid[: shape[0], : shape[1]] * _PIXEL_M
    xyz = np.stack([u, v, np.ones(shape)], axis=-1).astype(np.float32)
    return FlattenedView(
        rgb=np.full((*shape, 3), 120, dtype=np.uint8),
        xyz_m=xyz,
        normal=np.zeros_like(xyz),
        z_angle_deg=np.zeros(shape, dtype=np.float32),
        valid=valid,
        view_index=np.where(valid, 0, -1).astype(np.int16),
        source_rc=np.zeros((*shape, 2), dtype=np.float32),
        pixel_size_m=_PIXEL_M,
        origin_uv_m=(-_PIXEL_M * (shape[1] - 1) / 2, 0.0),
    )


def _seam(uv_m: np.ndarray, why: str, shown: Bool | None = None, other: FlattenedView | None = None) -> Seam:
    """Return a seam at places (K, 2) of this side, if the other one has cloth next to them."""
    its = uv_m * MIRROR
    if shown is not None and other is not None:
        inward = its * (0.95, 1.0)
        rc = np.clip(np.rint(other.rc_from_uv(inward)).astype(int), 0, np.array(shown.shape) - 1)
        uv_m, its = uv_m[shown[rc[:, 0], rc[:, 1]]], its[shown[rc[:, 0], rc[:, 1]]]
    off = 0.003 * np.random.default_rng(0).normal(size=its.shape)
    return Seam(
        this_piece=0,
        other_piece=0,
        this_uv_m=uv_m,
        other_uv_m=its + off,
        xyz_m=np.column_stack([uv_m, np.ones(len(uv_m))]),
        views=np.zeros((len(uv_m), 2), dtype=np.int16),
        residual_m=np.linalg.norm(off, axis=1),
        why=why,
    )
