"""The curves h(u) and A_z(u) of a plan (paper, Fig. 4), computed again and drawn."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from flatcloth.core.errors import FlatclothError
from flatcloth.export.history import Decision
from flatcloth.export.kept import key_of
from flatcloth.export.session import OpenedSession
from flatcloth.methods.answers import ColumnCurves, Plan, SidePlan
from flatcloth.rendering.charts import SMALL, Frame, draw_axes
from flatcloth.rendering.drawing import BLUE, GREEN, ORANGE, PINK, SOFT, Drawing, Run
from flatcloth.session.machine import Side

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from flatcloth.core.config import PlanningConfig


def plan_of(session: OpenedSession, decision: Decision) -> Plan | None:
    """Return the plan of a proposal, computed again; None if the operator chose the view."""
    if decision.by_hand:
        return None
    before = replace(decision.before, pending=None)

    def made() -> Plan | None:
        try:
            return session.integration.plan(before)
        except FlatclothError:
            return None  # no view can be planned from this shape; the decision is shown without curves

    key = key_of(session.integration.axis, before), before.refused_views
    return session.kept.plans.get(key, made)


def side_of(plan: Plan | None, decision: Decision) -> SidePlan | None:
    """Return the side of a plan that a proposal is for; None for methods that plan without sides."""
    pending = decision.before.pending
    if plan is None or pending is None:
        return None
    sides = [side for side in plan.sides if side.side is pending.side and side.curves.u_m.size > 1]
    return sides[0] if sides else None


def draw_curves(
    drawing: Drawing,
    curves: ColumnCurves,
    config: PlanningConfig,
    heights: tuple[float, float, float],
    side: SidePlan | None = None,
) -> None:
    """Draw h(u) above A_z(u), with the values that a side's plan uses.

    ``heights`` are the top of the upper plot, its height, and the height of the lower one.
    """
    top, upper, lower = heights
    limit = config.z_angle_limit_deg
    u_mm = 1000 * curves.u_m
    u_range = (float(u_mm[0]), float(u_mm[-1]))
    width = drawing.width - 80
    count = Frame(
        left=56, top=top, width=width, height=upper, x_range=u_range,
        y_range=(0.0, 1.05 * float(max(curves.column_count.max(), 1))),
    )  # fmt: skip
    angle = Frame(
        left=56, top=top + upper + 44, width=width, height=lower, x_range=u_range,
        y_range=(-limit - 5, limit + 5),
    )  # fmt: skip
    counted = draw_axes(drawing, count, "", "h(u), pixels per column", ())
    turned = draw_axes(drawing, angle, "u (mm)", "A_z(u), mean Z-angle (\u00b0)")
    counted.plot(u_mm, curves.column_count, color=BLUE, linewidth=1.6)
    turned.plot(u_mm, curves.column_mean_z_angle_deg, color=ORANGE, linewidth=1.6)
    for sign in (-1, 1):
        turned.axhline(sign * limit, color=SOFT, linewidth=1.0, linestyle="--")
    labels = [Run(f"\u00b1A_w = \u00b1{limit:g}\u00b0", SMALL, SOFT)]
    if side is not None:
        _shade_overlap(counted, side)
        overlap = f"S_0 = {1e4 * config.overlap_area_m2:.0f} cm\u00b2"
        drawing.text(count.left + width, count.top - 12, overlap, SMALL, BLUE, "end")
    if side is not None and math.isfinite(side.u_b_m) and math.isfinite(side.a_0_deg):
        for axes in (counted, turned):
            axes.axvline(1000 * side.u_b_m, color=GREEN, linewidth=1.2)
        turned.plot(1000 * side.u_b_m, side.a_0_deg, "o", color=PINK, markersize=8, markeredgewidth=0)
        reached = f"A_0 = {side.a_0_deg:.0f}\u00b0".replace("-", "\u2212")
        labels.insert(0, Run(reached, SMALL, PINK))
    drawing.runs(angle.left + width, angle.top - 12, tuple(labels), "end")


def _shade_overlap(axes: Axes, side: SidePlan) -> None:
    """Shade the columns of the desirable overlap S_0."""
    if math.isfinite(side.u_b_m):
        u_m, pixels = side.curves.u_m, side.curves.column_count
        inside = u_m <= side.u_b_m if side.side is Side.LEFT else u_m >= side.u_b_m
        axes.fill_between(1000 * u_m[inside], pixels[inside], color=BLUE, alpha=0.22, linewidth=0)
