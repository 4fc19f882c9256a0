"""The side to extend next and the rotation for it (paper, section 4.1)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flatcloth.core.config import PlanningConfig
from flatcloth.core.geometry import z_angle_deg
from flatcloth.core.types import FlattenedView, Float64, Rigid2, RotationAxis
from flatcloth.methods.answers import ColumnCurves, Plan, SidePlan
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
        From :func:`flatcloth.methods.paper.occlusion.occluding_edge_length_m`, for ``from_view``.
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
