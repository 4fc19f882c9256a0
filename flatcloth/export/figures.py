"""The figures of a session: maps of the shape, growth, energy, and each decision with its curves."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import Floats
from flatcloth.engine.outcome import other_side_lines, sides_entry
from flatcloth.engine.sheet import beyond, lay_out, overlay_on
from flatcloth.export.growth import key_of
from flatcloth.export.history import ACCEPTED, Decision
from flatcloth.export.session import OpenedSession
from flatcloth.garments.recognition import NONE
from flatcloth.methods.answers import ColumnCurves, Plan, SidePlan
from flatcloth.rendering.colormaps import piece_color, view_colors
from flatcloth.rendering.drawing import (
    BLUE,
    GREEN,
    ORANGE,
    PAPER,
    PINK,
    SMALL,
    SOFT,
    add_key,
    add_ramp,
    drawn,
    painted,
    show_picture,
    style,
    svg_of,
)
from flatcloth.rendering.layers import LAYERS, hex_of, is_known, legend, rgba
from flatcloth.rendering.pictures import PlanePicture, cropped, laid_on, side_by_side
from flatcloth.session.document import Side

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Drawing

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

    key = "plan", key_of(session.integration.axis, before), before.refused_views
    plan: Plan | None = session.kept.values.get(key, made)
    return plan


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
) -> Drawing:
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


VIOLET, WARN = "#6a3fb5", "#9a5b00"
"""Colors of seams that join, and of others: those of the page. Chosen."""
_LONGEST = 460.0
"""Longer side (points) of a picture of the plane. Chosen."""

LAYER_WORDS = {
    "color": ("Color", "the color of the cloth"),
    "height": ("Height z", "the height along the turning axis"),
    "z_angle": ("Z-angle", "the Z-angle of each pixel in its view"),
    "source": ("Source", "the view of each pixel"),
    "stretch": ("Stretch", "the change of lengths by flattening"),
    "incidence": ("Incidence", "the incidence angle of each pixel"),
    "density": ("Density", "the density of the measurement"),
    "place": ("Uncertainty", "the placement uncertainty of each pixel"),
}
"""The title of each layer, and its description."""


@dataclass(frozen=True, kw_only=True)
class Figure:
    """A figure of matplotlib with the name of its files and its caption."""

    name: str
    caption: str
    drawing: Drawing

    def svg(self) -> str:
        """Return the figure as SVG."""
        return svg_of(self.drawing, self.caption)

    def png(self) -> bytes:
        """Return the figure as PNG."""
        return painted(self.drawing)


def figure_files(session: OpenedSession) -> Iterator[tuple[str, bytes]]:
    """Yield name and content of the files of every figure, as PNG and SVG."""
    for figure in all_figures(session):
        yield f"{figure.name}.png", figure.png()
        yield f"{figure.name}.svg", figure.svg().encode()


def all_figures(session: OpenedSession) -> Iterator[Figure]:
    """Yield all figures."""
    decisions = session.history.decisions
    session.progress(0.0, "drawing the shape")
    for make in (maps, both_sides, garment):
        yield from make(session)
    yield growth(session)
    yield energy(session)
    yield from curves(session)
    for n, decision in enumerate(decisions):
        session.progress(n / len(decisions), f"drawing decision {n + 1} of {len(decisions)}")
        yield overlay(session, decision)
        if (side := side_of(plan_of(session, decision), decision)) is not None:
            yield plan_figure(session, decision, side)


# --- maps ----------------------------------------------------------------------------------------


def maps(session: OpenedSession, names: tuple[str, ...] = LAYERS) -> Iterator[Figure]:
    """Yield the maps of the shape, one for each available layer."""
    growth, integration = session.growth, session.integration
    view, angles_deg = growth.view, integration.recording.angles_deg
    about = f"{1e4 * growth.area_m2:.0f} cm\u00b2 from {len(growth.steps)} views"
    if growth.sheet.floating_m2 > 0.0:
        about += f"; {1e4 * growth.sheet.floating_m2:.0f} cm\u00b2 float"
    for name in names:
        if not is_known(view, name, integration.axis):
            continue
        picture = cropped(rgba(view, name, integration.axis, len(angles_deg)), view)
        shape = name == "color"
        title, shows = ("Canonical shape", about) if shape else LAYER_WORDS[name]
        drawing, axes = map_drawing(picture, title, about if shape else "")
        for n, piece in enumerate(growth.sheet.pieces, start=1):
            if piece.placed is None:
                color = hex_of(piece_color(n))
                axes.text(*piece.view.origin_uv_m, piece.label, color=color, fontweight="bold", va="bottom")
        for pick in session.history.picks if shape else ():
            if pick.side == "this" and (rc := session.pixel_of(pick)) is not None:
                _mark(axes, view.uv_from_rc(np.array(rc)), str(pick.id), is_seen=True)
        explained = legend(view, name, integration.axis, angles_deg)
        if explained["kind"] == "ramp":
            add_ramp(axes, explained["title"], explained["colors"], explained["low"], explained["high"])
        elif explained["kind"] == "classes":
            add_key(
                axes, [(each["color"], each["label"]) for each in explained["classes"]], explained["title"]
            )
        yield Figure(name=f"map-{name.replace('_', '-')}", caption=f"{title}: {shows}.", drawing=drawing)


def both_sides(session: OpenedSession) -> Iterator[Figure]:
    """Yield the picture of both sides with their seams; none if the session has one side."""
    sides = session.data.joined
    if sides is None:
        return
    own, its = session.growth.sheet, lay_out(sides.other)
    picture, shift_m = side_by_side(own.view, its.view)
    drawing, axes = map_drawing(picture, "Both sides")
    for seam in sides.seams:
        for sheet, uv_m, shift in ((own, seam.this_uv_m, 0.0), (its, seam.other_uv_m, shift_m)):
            places = sheet.places(uv_m)[1] + (shift, 0.0)
            axes.plot(*places.T, "o", markersize=3.2, color=WARN if seam.why else VIOLET)
    line = " ".join(other_side_lines(sides_entry(sides)))
    caption = f"Both sides, each as seen from its own outside, with the places of their seams. {line}"
    yield Figure(name="both-sides", caption=caption, drawing=drawing)


def garment(session: OpenedSession) -> Iterator[Figure]:
    """Yield the outline and the named points over the shape; none if it is no known garment."""
    known = session.data.garment
    if isinstance(known, str) or known.found.kind == NONE:
        return
    found, view = known.found, session.growth.view
    picture = cropped(rgba(view, "color", session.integration.axis, len(session.integration.recording)), view)
    words = found.kind.replace("_", " ")
    share = "set by hand" if found.by_hand else f"{found.probabilities[found.kind]:.0%}"
    about = f"{words}, {share}"
    drawing, axes = map_drawing(picture, "Garment", about)
    outline = np.concatenate([found.outline_uv_m, found.outline_uv_m[:1]])
    for color, width in ((PAPER, 3.5), (BLUE, 1.8)):
        axes.plot(*outline.T, color=color, linewidth=width)
    for name, point in found.points.items():
        _mark(axes, point.uv_m, name, is_seen=point.pixel is not None)
    # The outline and its points reach beyond the cloth that was seen.
    axes.autoscale()
    seen = sum(point.pixel is not None for point in found.points.values())
    yield Figure(
        name="garment",
        caption=f"Garment: {about}; {seen} of {len(found.points)} named points seen, rings are predicted.",
        drawing=drawing,
    )


def map_drawing(picture: PlanePicture, title: str, about: str = "") -> tuple[Drawing, Axes]:
    """Return a picture of the plane with title and scale bar, and its axes, whose data are u and v (m)."""
    rows, cols = picture.rgba.shape[:2]
    per_pixel = _LONGEST / max(rows, cols)
    drawing, (axes,) = drawn(cols * per_pixel, rows * per_pixel, title, about)
    show_picture(axes, picture, most=0.3 * max(rows, cols) / cols)
    return drawing, axes


def _mark(axes: Axes, uv_m: Floats, label: str, *, is_seen: bool) -> None:
    """Mark a point (2,) with its label, with a ring if it was not seen."""
    u_m, v_m = uv_m.tolist()
    face = PINK if is_seen else PAPER
    axes.plot(u_m, v_m, "o", markersize=11.5, markerfacecolor=PAPER, markeredgewidth=0)
    axes.plot(u_m, v_m, "o", markersize=8, markerfacecolor=face, markeredgecolor=PINK, markeredgewidth=2)
    box = {"facecolor": PAPER, "alpha": 0.85, "edgecolor": "none", "pad": 1.5}
    axes.annotate(
        label, (u_m, v_m), (10, -4), textcoords="offset points", bbox=box, color=PINK, fontweight="bold"
    )


# --- growth and energy ---------------------------------------------------------------------------


@style()
def growth(session: OpenedSession) -> Figure:
    """Return the chart of the shape's area after each accepted view."""
    steps = session.growth.steps
    after = 1e4 * np.array([step.area_m2 + step.floating_m2 for step in steps])
    before = np.concatenate([[0.0], after[:-1]])
    shape = 1e4 * np.array([step.area_m2 for step in steps])
    what = "area of shape and pieces" if bool((after > shape).any()) else "area of the shape"
    order = np.arange(len(steps), dtype=np.float64)
    about = f"{what} after each accepted view, cm\u00b2"
    drawing, (axes,) = drawn(max(330.0, 20 + 46 * len(steps)), 200, "Growth", about)
    low, high = np.minimum(before, after), np.maximum(before, after)
    axes.bar(order, low, 0.72, color="#b9c6d6")
    changed = axes.bar(order, high - low, 0.72, bottom=low, color=BLUE)
    axes.bar(order, after - shape, 0.72, bottom=shape, fill=False, edgecolor=SOFT, hatch="////", linewidth=0)
    added = [f"{round(1e4 * step.added_m2):+d}".replace("-", "\u2212") for step in steps]
    axes.bar_label(changed, added, padding=4, color=SOFT)
    axes.set_xticks(order, [f"{step.view_index}\n{step.angle_deg:g}\u00b0" for step in steps])
    axes.set_xlabel("view, rotation", loc="left", color=SOFT)
    axes.set_ylim(0.0, 1.1 * after.max())
    caption = f"The {what} grew from {after[0]:.0f} to {after[-1]:.0f} cm\u00b2 in {len(steps)} views."
    if after[-1] > shape[-1]:
        caption += f" Hatched: floating pieces, {after[-1] - shape[-1]:.0f} cm\u00b2 in the end."
    return Figure(name="growth", caption=caption, drawing=drawing)


@style()
def energy(session: OpenedSession) -> Figure:
    """Return the chart of the energy of Eq. (2) at each iteration, one line per view of the shape."""
    steps = session.growth.steps
    colors = view_colors(len(session.integration.recording))
    about = "H of Eq. (2), m\u00b2, at each iteration, first at the coarse interval"
    drawing, (axes,) = drawn(440, max(190.0, 18.0 * len(steps)), "Energy", about)
    key = []
    for step in steps:
        color, start = hex_of(colors[step.view_index]), 0
        for part in session.numbers_of(step.view_index).energies_m2:
            above = np.where(part > 0, part, np.nan)
            at = np.arange(start, start + len(part))
            axes.semilogy(at, above, "o-", markevery=[0], markersize=4.8, color=color)
            start += len(part)
        key.append((color, f"view {step.view_index} ({step.angle_deg:g}\u00b0)"))
    axes.set_xlabel("iteration")
    axes.locator_params(axis="x", integer=True)
    add_key(axes, key)
    caption = (
        "Energy of the flattening of each accepted view; a dot marks the start of each sampling interval."
    )
    return Figure(name="energy", caption=caption, drawing=drawing)


# --- decisions -----------------------------------------------------------------------------------


def overlay(session: OpenedSession, decision: Decision) -> Figure:
    """Return the picture of a proposal on the shape at the time of the decision."""
    angle = session.integration.recording.angles_deg[decision.view_index]
    title = f"Decision {decision.number}: view {decision.view_index} ({angle:g}\u00b0)"
    verdict = verdict_text(decision)
    drawing, _ = map_drawing(picture_before(session, decision), title, verdict)
    return Figure(name=_name(decision, "overlay"), caption=f"{title}, {verdict}.", drawing=drawing)


def picture_before(session: OpenedSession, decision: Decision) -> PlanePicture:
    """Return the picture of a proposal on the shape at the time of the decision."""
    before, pending = decision.before, decision.before.pending
    assert pending is not None

    def made() -> PlanePicture:
        sheet = session.sheet_of(before)
        overlay = overlay_on(session.integration, before, sheet)
        return laid_on(sheet.view, overlay, beyond(overlay, sheet.view))

    places = pending.view_index, pending.component, pending.current_from_new, pending.also_placed
    key = "picture", key_of(session.integration.axis, before), places
    picture: PlanePicture = session.kept.values.get(key, made)
    return picture


def verdict_text(decision: Decision) -> str:
    """Return the verdict as text, with reason and score."""
    words = [decision.verdict]
    if decision.verdict == ACCEPTED and decision.moved:
        words.append("moved by hand")
    if decision.reason:
        words.append(decision.reason)
    if math.isfinite(decision.score):
        words.append(f"score {decision.score:.2f}")
    if not decision.stands:
        words.append("taken back")
    return ", ".join(words)


def plan_figure(session: OpenedSession, decision: Decision, side: SidePlan) -> Figure:
    """Return the curves h(u) and A_z(u) of a plan, with the overlap S_0 and the Z-angle at its end."""
    title = f"Plan of decision {decision.number}: {side.reason}"
    drawing = draw_curves(side.curves, session.integration.planning, title, side)
    caption = f"h(u) and A_z(u) of the shape before decision {decision.number}; {side.reason}."
    return Figure(name=_name(decision, "plan"), caption=caption, drawing=drawing)


def curves(session: OpenedSession) -> Iterator[Figure]:
    """Yield the curves h(u) and A_z(u) of each view of the shape."""
    for step in session.growth.steps:
        found = session.numbers_of(step.view_index).curves
        if found.u_m.size < 2:
            continue
        title = f"View {step.view_index} ({step.angle_deg:g}\u00b0)"
        drawing = draw_curves(found, session.integration.planning, title)
        caption = f"h(u) and A_z(u) of the flattened view {step.view_index}."
        yield Figure(name=f"curves-view-{step.view_index}", caption=caption, drawing=drawing)


def _name(decision: Decision, kind: str) -> str:
    return f"decision-{decision.number:02d}-view-{decision.view_index}-{kind}"
