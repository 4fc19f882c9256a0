"""The side to extend next, the rotation for it, and the occluding edges that tell (paper, section 4.1)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from flatcloth.core.config import PlanningConfig
from flatcloth.core.geometry import z_angle_deg
from flatcloth.core.types import Bool, FlattenedView, Float64, Floats, Rigid2, RotationAxis
from flatcloth.flattening.ramps import RAMP_HALF_WIDTH_PX
from flatcloth.flattening.surface import Surface
from flatcloth.methods.answers import ColumnCurves, Plan, SidePlan
from flatcloth.methods.paper.matching import PLACE_SCALE_M
from flatcloth.session.document import Side

_OCCLUDING_EDGE_MIN_M = 0.03
"""A side with less occluding edge than this is complete. Set by hand."""


def column_curves(
    view: FlattenedView,
    axis: RotationAxis,
    angle_deg: float,
    z_angle_limit_deg: float,
    frame_from_view: Rigid2 | None = None,
    seen_deg: Float64 | None = None,
) -> ColumnCurves:
    """Return h(u) and A_z(u) (paper, 4.1, steps 1 and 2).

    Parameters
    ----------
    view : FlattenedView
        The flattened view, attributes in the object frame.
    axis : RotationAxis
        Axis of the recording.
    angle_deg : float
        Rotation at which the Z-angles are computed.
    z_angle_limit_deg : float
        A_w; pixels beyond it are ignored.
    frame_from_view : Rigid2, optional
        Motion to the plane of the columns; by default the view's own plane.
    seen_deg : (K,) float64, optional
        The Z-angles of the valid pixels at this rotation, if they are known.
    """
    angle = z_angle_deg(view.normal[view.valid], axis, angle_deg) if seen_deg is None else seen_deg
    within = np.abs(angle) < z_angle_limit_deg
    if frame_from_view is None:
        u_m = np.nonzero(view.valid)[1][within] * view.pixel_size_m + view.origin_uv_m[0]
    else:
        u_m = frame_from_view.apply(view.uv_from_rc(np.argwhere(view.valid)[within]))[:, 0]
    column = np.rint(u_m / view.pixel_size_m).astype(np.int64)
    first = int(column.min()) if column.size else 0
    count = np.bincount(column - first)
    with np.errstate(invalid="ignore"):
        mean = np.bincount(column - first, angle[within]) / count
    return ColumnCurves(
        u_m=(first + np.arange(count.size, dtype=np.float64)) * view.pixel_size_m,
        column_count=count.astype(np.int32),
        column_mean_z_angle_deg=mean,
        pixel_size_m=view.pixel_size_m,
    )


def overlap_column(curves: ColumnCurves, side: Side, area_m2: float) -> tuple[float, float]:
    """Return ``u_b`` (m) and ``A_0`` (deg): the first column from a side at which the area exceeds S_0.

    If the whole view is smaller than S_0 it is the last column, so that A is smallest
    (paper, 4.1, step 3). NaN if the curves are empty.
    """
    order = slice(None) if side is Side.LEFT else slice(None, None, -1)
    count = curves.column_count[order]
    filled = np.flatnonzero(count)
    if filled.size == 0:
        return float("nan"), float("nan")
    reached = np.flatnonzero(np.cumsum(count) * curves.pixel_size_m**2 > area_m2)
    index = int(reached[0]) if reached.size else int(filled[-1])
    return float(curves.u_m[order][index]), float(curves.column_mean_z_angle_deg[order][index])


def rotation_to_limit_deg(side: Side, a_0_deg: float, config: PlanningConfig) -> float:
    """Return A, unsigned: the rotation that brings A_0 to the limit A_w, within the allowed range.

    It is 0 if A_0 is unknown (paper, 4.1, step 4).
    """
    if not np.isfinite(a_0_deg):
        return 0.0
    rotation = config.z_angle_limit_deg - (a_0_deg if side is Side.LEFT else -a_0_deg)
    return float(np.clip(rotation, config.rotation_min_deg, config.rotation_max_deg))


def plan_side(
    side: Side,
    curves: ColumnCurves,
    occluding_edge_m: float,
    from_view: int,
    angles_deg: Sequence[float],
    unavailable: frozenset[int],
    turned_deg: float,
    config: PlanningConfig,
) -> SidePlan:
    """Plan one side: whether it has an occluding edge, and which rotation shows most beyond it.

    Parameters
    ----------
    side : Side
        The side.
    curves : ColumnCurves
        Curves at the rotation of ``from_view``.
    occluding_edge_m : float
        From :func:`flatcloth.methods.paper.planning.occluding_edge_length_m`, for ``from_view``.
    from_view : int
        Outermost accepted view on this side.
    angles_deg : sequence of float
        Angles of all views.
    unavailable : frozenset of int
        Views that are used or rejected.
    turned_deg : float
        Rotation from the outermost view of the other side to this one; after a full turn no view
        is left.
    config : PlanningConfig
        Limits.
    """
    u_b, a_0 = overlap_column(curves, side, config.overlap_area_m2)
    held = rotation_to_limit_deg(side, a_0, config)
    turns = (1.0 if side is Side.LEFT else -1.0) * (np.asarray(angles_deg) - angles_deg[from_view]) % 360.0
    slack = 0.5 * min(rotation_step_deg(angles_deg), config.rotation_min_deg)
    allowed = [
        (float(turn), n)
        for n, turn in enumerate(turns)
        if n not in unavailable
        and config.rotation_min_deg - slack <= turn <= config.rotation_max_deg + slack
        and turn + turned_deg < 360.0 - slack
    ]
    view: int | None = None
    if occluding_edge_m < _OCCLUDING_EDGE_MIN_M:
        reason = f"no occluding edge remains on the {side}"
    elif not allowed:
        reason = f"no view remains on the {side}"
    else:  # the largest rotation up to A, otherwise the smallest that is allowed
        up_to_a = [each for each in allowed if each[0] <= held + slack]
        _, view = max(up_to_a) if up_to_a else min(allowed)
        reason = f"{side}: A = {held:.0f} deg"
    return SidePlan(
        side=side,
        curves=curves,
        occluding_edge_m=occluding_edge_m,
        u_b_m=u_b,
        a_0_deg=a_0,
        rotation_deg=held,
        view_index=view,
        reason=reason,
    )


def rotation_step_deg(angles_deg: Sequence[float]) -> float:
    """Return the recording's median step between neighbouring angles on the circle."""
    ordered = np.sort(np.asarray(angles_deg, dtype=np.float64) % 360.0)
    if ordered.size < 2:
        return 360.0
    return float(np.median(np.diff(np.append(ordered, ordered[0] + 360.0))))


def choose(sides: Sequence[SidePlan], last_side: Side | None) -> Plan:
    """Choose between the sides: continue on the side of the last view, otherwise at the longer edge."""
    open_sides = [s for s in sides if s.view_index is not None]
    if not open_sides:
        reason = "No view can add anything: " + "; ".join(s.reason for s in sides) + "."
        return Plan(view_index=None, reason=reason, sides=tuple(sides))
    same = [s for s in open_sides if s.side is last_side]
    best = same[0] if same else max(open_sides, key=lambda s: s.occluding_edge_m)
    return Plan(
        view_index=best.view_index,
        side=best.side,
        rotation_deg=best.rotation_deg,
        reason=best.reason,
        sides=tuple(sides),
    )


# --- occluding edges -------------------------------------------------------------------------------

# The paper calls the leftmost or rightmost boundary an occluding edge if it divides one surface into a
# visible and a hidden part, where the cloth continues out of sight, and judges it by the Z-angle of the
# outermost column. Here every end of every image row counts, so that a flat stretch does not hide a steep
# one; the Z-angle is the mean over half the width of a ramp. An end that is covered by a nearer layer counts
# too, for the rotation that moves this layer away.


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
