"""The occluding edges of one view, where the cloth continues out of sight (paper, section 4).

The paper calls the leftmost or rightmost boundary an occluding edge if it divides one surface into a
visible and a hidden part, and judges it by the Z-angle of the outermost column. Here every end of every
image row counts, so that a flat stretch does not hide a steep one; the Z-angle is the mean over half the
width of a ramp. An end that is covered by a nearer layer counts too, for the rotation that moves this layer
away.
"""

from __future__ import annotations

import numpy as np

from flatcloth.core.types import Bool, Float64, Floats
from flatcloth.flattening.ramps import RAMP_HALF_WIDTH_PX
from flatcloth.flattening.surface import Surface
from flatcloth.methods.paper.matching import PLACE_SCALE_M
from flatcloth.session.machine import Side

_OCCLUDING_Z_ANGLE_DEG = 40.0
"""An outline seen more steeply than this is an occluding edge. Set by hand."""


def occluding_edge_length_m(surface: Surface, side: Side, part: Bool | None = None) -> float:
    """Return the length along the image rows of the edges that the rotation for one side opens.

    Parameters
    ----------
    surface : Surface
        The surface of a view.
    side : Side
        The rotation for ``Side.LEFT`` is positive: it brings cloth beyond the left outline to the
        front, and moves nearer layers to the right.
    part : (H, W) bool, optional
        The pixels of the surface that count; by default all, as in the paper.
    """
    turned_away, covered = occluding_edges(surface, side, part)
    pitch = surface.depth_m / surface.frame.intrinsics.fy
    return float(pitch[turned_away].sum() + pitch[covered].sum())


def occluding_edges(surface: Surface, side: Side, part: Bool | None = None) -> tuple[Bool, Bool]:
    """Return the pixels (H, W) of these edges: where cloth turns away, and where nearer cloth covers it."""
    part = surface.usable if part is None else part
    depth = surface.depth_m
    outward = -1.0 if side is Side.LEFT else 1.0
    turned_away = _ends(part, side, RAMP_HALF_WIDTH_PX) & (
        _mean_inwards(outward * surface.z_angle_deg, part, side, RAMP_HALF_WIDTH_PX) >= _OCCLUDING_Z_ANGLE_DEG
    )
    other = Side.RIGHT if side is Side.LEFT else Side.LEFT
    measured = np.where(surface.frame.depth_m > 0, surface.frame.depth_m, np.inf)
    beyond = _nearest_outwards(measured, other, RAMP_HALF_WIDTH_PX)
    with np.errstate(invalid="ignore"):
        covered = _ends(part, other, RAMP_HALF_WIDTH_PX) & (beyond < depth - PLACE_SCALE_M)
    return turned_away, covered


def _outwards(values: Floats | Bool, steps: int, side: Side, fill: float) -> Float64:
    """Shift (H, W) so that each pixel has the value ``steps`` farther out on that side (negative: in)."""
    shift = steps if side is Side.LEFT else -steps
    result = np.full(values.shape, fill, dtype=np.float64)
    if shift > 0:
        result[:, shift:] = values[:, :-shift]
    elif shift < 0:
        result[:, :shift] = values[:, -shift:]
    else:
        result[:] = values
    return result


def _ends(part: Bool, side: Side, width: int) -> Bool:
    """Pixels of the component without another one in the next ``width`` pixels outwards."""
    ends = part.copy()
    for n in range(1, width + 1):
        ends &= _outwards(part, n, side, 0.0) == 0
    return ends


def _mean_inwards(values: Floats, part: Bool, side: Side, width: int) -> Float64:
    total, count = np.zeros(part.shape), np.zeros(part.shape)
    shown = np.where(part, values, 0.0)
    for n in range(width):
        total += _outwards(shown, -n, side, 0.0)
        count += _outwards(part, -n, side, 0.0)
    mean: Float64 = total / np.maximum(count, 1.0)
    return mean


def _nearest_outwards(depth: Float64, side: Side, width: int) -> Float64:
    nearest = np.full(depth.shape, np.inf)
    for n in range(1, width + 1):
        nearest = np.minimum(nearest, _outwards(depth, n, side, np.inf))
    return nearest
