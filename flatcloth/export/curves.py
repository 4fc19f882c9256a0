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
from flatcloth.rendering.drawing import BLUE, GREEN, ORANGE, PINK, SMALL, SOFT, drawn, style
from flatcloth.session.machine import Side

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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


@style()
def draw_curves(
    curves: ColumnCurves,
    config: PlanningConfig,
    title: str,
    side: SidePlan | None = None,
    size: tuple[float, float] = (440.0, 290.0),
) -> Figure:
    """Draw h(u) above A_z(u), with the values that a side's plan uses; ``size`` in points is that of both."""
    limit, u_mm = config.z_angle_limit_deg, 1000 * curves.u_m
    figure, (counted, turned) = drawn(*size, title, "h(u), pixels per column", rows=2)
    counted.plot(u_mm, curves.column_count, color=BLUE)
    counted.set_ylim(0.0, 1.05 * float(max(curves.column_count.max(), 1)))
    turned.plot(u_mm, curves.column_mean_z_angle_deg, color=ORANGE)
    turned.set(xlim=(u_mm[0], u_mm[-1]), ylim=(-limit - 5, limit + 5), xlabel="u (mm)")
    turned.set_title("A_z(u), mean Z-angle (\u00b0)")
    for sign in (-1, 1):
        turned.axhline(sign * limit, color=SOFT, linewidth=1.0, linestyle="--")
    limits = f"\u00b1A_w = \u00b1{limit:g}\u00b0"
    if side is not None:
        overlap = f"S_0 = {1e4 * config.overlap_area_m2:.0f} cm\u00b2"
        counted.set_title(overlap, loc="right", color=BLUE, fontsize=SMALL)
    if side is not None and math.isfinite(side.u_b_m):
        inside = curves.u_m <= side.u_b_m if side.side is Side.LEFT else curves.u_m >= side.u_b_m
        counted.fill_between(u_mm[inside], curves.column_count[inside], color=BLUE, alpha=0.22, linewidth=0)
    if side is not None and math.isfinite(side.u_b_m) and math.isfinite(side.a_0_deg):
        for axes in (counted, turned):
            axes.axvline(1000 * side.u_b_m, color=GREEN, linewidth=1.2)
        turned.plot(1000 * side.u_b_m, side.a_0_deg, "o", color=PINK, markersize=8)
        limits = f"A_0 = {side.a_0_deg:.0f}\u00b0, {limits}".replace("-", "\u2212")
    turned.set_title(limits, loc="right", color=SOFT, fontsize=SMALL)
    return figure
