"""The occluding edges of one view, where the cloth continues out of sight (paper, section 4).

The paper calls the leftmost or rightmost boundary an occluding edge if it divides one surface into a
visible and a hidden part, and judges it by the Z-angle of the outermost column. Here every end of every
image row counts, so that a flat stretch does not hide a steep one; the Z-angle is the mean over half the
width of a ramp. An end that is covered by a nearer layer counts too, for the rotation that moves this layer
away.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from flatcloth.core.types import Bool, Floats
from flatcloth.flattening.ramps import RAMP_HALF_WIDTH_PX
from flatcloth.flattening.surface import Surface
from flatcloth.methods.paper.matching import PLACE_SCALE_M
from flatcloth.session.document import Side

_OCCLUDING_Z_ANGLE_DEG = 40.0
"""An outline seen more steeply than this is an occluding edge. Set by hand."""


def occluding_edge_length_m(surface: Surface, side: Side) -> float:
    """Return the length along the image rows of the edges that the rotation for one side opens.

    Parameters
    ----------
    surface : Surface
        The surface of a view.
    side : Side
        The rotation for ``Side.LEFT`` is positive: it brings cloth beyond the left outline to the
        front, and moves nearer layers to the right.
    """
    turned_away, covered = occluding_edges(surface, side)
    pitch = surface.depth_m / surface.frame.intrinsics.fy
    return float(pitch[turned_away].sum() + pitch[covered].sum())


def occluding_edges(surface: Surface, side: Side) -> tuple[Bool, Bool]:
    """Return the pixels (H, W) of these edges: where cloth turns away, and where nearer cloth covers it."""
    part = surface.usable
    other, outward = (Side.RIGHT, -1.0) if side is Side.LEFT else (Side.LEFT, 1.0)
    shown = np.where(part, outward * surface.z_angle_deg, 0.0)
    count = np.maximum(_next(part, other, 0).sum(axis=-1), 1)  # pixels of the strip inside an end
    steep = _next(shown, other, 0).sum(axis=-1) / count >= _OCCLUDING_Z_ANGLE_DEG
    turned_away = part & ~_next(part, side, 1).any(axis=-1) & steep
    measured = np.where(surface.frame.depth_m > 0, surface.frame.depth_m, np.inf)
    beyond = _next(measured, other, 1, np.inf).min(axis=-1)
    with np.errstate(invalid="ignore"):
        nearer = beyond < surface.depth_m - PLACE_SCALE_M
    return turned_away, part & ~_next(part, other, 1).any(axis=-1) & nearer


def _next(values: Floats | Bool, side: Side, first: int, beyond: float = 0.0) -> NDArray[Any]:
    """Return the pixels (H, W, RAMP_HALF_WIDTH_PX) of each row next to each, from the ``first`` on.

    ``beyond`` is the value beyond the image.
    """
    way = slice(None) if side is Side.RIGHT else slice(None, None, -1)
    width, cols = RAMP_HALF_WIDTH_PX, values.shape[1]
    padded = np.pad(values[:, way], ((0, 0), (0, width)), constant_values=beyond)
    return sliding_window_view(padded, width, axis=1)[:, first : first + cols][:, way]
