"""The figures of a session: maps of the shape, growth, energy, and each decision with its curves."""

from __future__ import annotations

import io
import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from flatcloth.core.errors import FlatclothError, os_errors_as
from flatcloth.core.plain_files import replace_file
from flatcloth.core.types import Floats
from flatcloth.engine.outcome import other_side_lines, sides_entry
from flatcloth.engine.sheet import SheetPiece, beyond, lay_out, overlay_on
from flatcloth.export.curves import draw_curves, plan_of, side_of
from flatcloth.export.history import ACCEPTED, Decision
from flatcloth.export.kept import PngPicture, key_of
from flatcloth.export.session import OpenedSession
from flatcloth.garments.recognition import NONE
from flatcloth.grasping.grasps import LOST_AT_M, pixel_of_point
from flatcloth.methods.answers import JoinedSides, SidePlan
from flatcloth.rendering.charts import (
    SIZE,
    SMALL,
    Frame,
    draw_axes,
    draw_key,
    draw_ramp,
    draw_scale_bar,
    draw_title,
)
from flatcloth.rendering.colormaps import piece_color, view_colors
from flatcloth.rendering.drawing import BLUE, PAPER, PINK, SOFT, TEXT, Drawing, png_of, text_width
from flatcloth.rendering.layers import LAYERS, QUALITY_LAYERS, hex_of, legend, rgba
from flatcloth.rendering.pictures import PlanePicture, cropped, laid_on, side_by_side, widened
from flatcloth.session.machine import Document

VIOLET, WARN = "#6a3fb5", "#9a5b00"
"""Colors of seams that join, and of others: those of the page. Chosen."""
_BELOW, _HEAD, _MARGIN = 46, 44, 16
"""Layout (px): text below, text above, and the margin. Chosen."""

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
    """A drawing with the name of its files and its caption."""

    name: str
    caption: str
    drawing: Drawing


def write_figures(
    session: OpenedSession, folder: Path, next_part: Callable[[], int] | None = None
) -> list[Path]:
    """Write every figure as ``.png`` and ``.svg`` to a folder; the parts in turn, or those that are next.

    Raises
    ------
    FlatclothError
        If the folder cannot be written, or the session has no shape.
    """
    made: list[Path] = []
    with os_errors_as(FlatclothError, f"{folder}: figures cannot be written", "Choose another folder."):
        folder.mkdir(parents=True, exist_ok=True)
        for figure in all_figures(session, next_part):
            for suffix, data in (("png", figure.drawing.png()), ("svg", figure.drawing.svg().encode())):
                path = folder / f"{figure.name}.{suffix}"
                replace_file(path, data)
                made.append(path)
    return made


def all_figures(session: OpenedSession, next_part: Callable[[], int] | None = None) -> Iterator[Figure]:
    """Yield all figures; with ``next_part`` those of the parts with the numbers that it returns."""
    decisions = session.history.decisions
    parts = [partial(make, session) for make in (maps, both_sides, garment, _overview, curves)]
    parts += [partial(of_decision, session, decision) for decision in decisions]
    next_part = next_part or itertools.count().__next__
    while (n := next_part()) < len(parts):
        session.progress(n / len(parts), f"drawing figures, part {n + 1} of {len(parts)}")
        yield from parts[n]()


def _overview(session: OpenedSession) -> Iterator[Figure]:
    yield growth(session)
    yield energy(session)


def of_decision(session: OpenedSession, decision: Decision) -> Iterator[Figure]:
    """Yield the figures of one decision: the proposal on the shape, and the curves of its plan."""
    yield overlay(session, decision)
    side = side_of(plan_of(session, decision), decision)
    if side is not None:
        yield plan_figure(session, decision, side)


# --- maps ----------------------------------------------------------------------------------------


def maps(session: OpenedSession, names: tuple[str, ...] = LAYERS) -> Iterator[Figure]:
    """Yield the maps of the shape, one for each available layer."""
    view = session.growth.view
    integration = session.integration
    angles_deg = integration.recording.angles_deg
    for name in names:
        if name in QUALITY_LAYERS and view.quality is None:
            continue
        picture = cropped(rgba(view, name, integration.axis, len(angles_deg)), view)
        about = f"{1e4 * session.growth.area_m2:.0f} cm\u00b2 from {len(session.growth.steps)} views"
        if session.growth.sheet.floating_m2 > 0.0:
            about += f"; {1e4 * session.growth.sheet.floating_m2:.0f} cm\u00b2 float"
        explained = legend(view, name, integration.axis, angles_deg)
        shape = name == "color"
        title, shows = ("Canonical shape", about) if shape else LAYER_WORDS[name]
        yield Figure(
            name=f"map-{name.replace('_', '-')}",
            caption=f"{title}: {shows}.",
            drawing=map_drawing(
                picture,
                title,
                about if shape else "",
                explained,
                marks=picks_on(session) if shape else (),
                pieces=session.growth.sheet.pieces,
            ),
        )


def both_sides(session: OpenedSession) -> Iterator[Figure]:
    """Yield the picture of both sides with their seams; none if the session has one side."""
    sides = session.sides
    if not isinstance(sides, JoinedSides):
        return
    own, its = session.growth.sheet, lay_out(sides.other)
    picture, shift_m = side_by_side(own.view, its.view)
    dots = []
    for seam in sides.seams:
        for sheet, uv_m, shift in ((own, seam.this_uv_m, 0.0), (its, seam.other_uv_m, shift_m)):
            places = sheet.places(uv_m)[1] + (shift, 0.0)
            dots.append((places[np.isfinite(places).all(axis=1)], WARN if seam.why else VIOLET))
    line = " ".join(other_side_lines(sides_entry(sides)))
    yield Figure(
        name="both-sides",
        caption=f"Both sides, each as seen from its own outside, with the places of their seams. {line}",
        drawing=map_drawing(picture, "Both sides", "", legend_width=0.0, dots=dots),
    )


def garment(session: OpenedSession) -> Iterator[Figure]:
    """Yield the outline and the named points over the shape; none if it is no known garment."""
    known = session.garment
    if isinstance(known, str) or known.found.kind == NONE:
        return
    found, view = known.found, session.growth.view
    points = {name: point.uv_m for name, point in found.points.items()}
    # The outline reaches beyond the cloth that was seen.
    picture = widened(
        cropped(rgba(view, "color", session.integration.axis, len(session.integration.recording)), view),
        np.concatenate([found.outline_uv_m, *(uv[None] for uv in points.values())]),
    )
    seen = [(*uv.tolist(), name) for name, uv in points.items() if found.points[name].pixel is not None]
    predicted = [(*uv.tolist(), name) for name, uv in points.items() if found.points[name].pixel is None]
    words = found.kind.replace("_", " ")
    share = "set by hand" if found.by_hand else f"{found.probabilities[found.kind]:.0%}"
    about = f"{words}, {share}"
    yield Figure(
        name="garment",
        caption=f"Garment: {about}; {len(seen)} of {len(points)} named points seen, rings are predicted.",
        drawing=map_drawing(
            picture, "Garment", about, marks=seen, rings=predicted, outline=found.outline_uv_m
        ),
    )


def picks_on(session: OpenedSession) -> list[tuple[float, float, str]]:
    """Return the picks that lie on the shape: u, v (m) and number."""
    view = session.growth.view
    places = []
    for pick in session.history.picks:
        if pick.side == "other":
            continue
        rc, distance_m = pixel_of_point(view, pick.position_held_m)
        if distance_m <= LOST_AT_M:
            u_m, v_m = view.uv_from_rc(np.array(rc)).tolist()
            places.append((float(u_m), float(v_m), str(pick.id)))
    return places


def map_drawing(
    picture: PlanePicture,
    title: str,
    about: str,
    explained: dict[str, object] | None = None,
    longest: float = 460.0,
    legend_width: float = 150.0,
    marks: Sequence[tuple[float, float, str]] = (),
    pieces: Sequence[SheetPiece] = (),
    rings: Sequence[tuple[float, float, str]] = (),
    outline: Floats | None = None,
    dots: Sequence[tuple[Floats, str]] = (),
    png: bytes | None = None,
) -> Drawing:
    """Return a picture of the plane with a title, a scale bar and a layer's legend on the right.

    ``marks`` are points (u, v in m) with a short label each, ``rings`` such points that were not seen;
    floating ``pieces`` are named where they lie; ``outline`` (N, 2) is a closed line, ``dots`` are
    places (N, 2) with their color; ``png`` is the picture as PNG, if known.
    """
    rows, cols = picture.rgba.shape[:2]
    per_pixel = longest / max(rows, cols)
    width, height = cols * per_pixel, rows * per_pixel
    head = text_width(title, 15, bold=True) + (text_width(about, SIZE) + 10 if about else 0)
    whole = max(_MARGIN + width + _MARGIN + legend_width, head + 2 * _MARGIN)
    drawing = Drawing(whole, _HEAD + max(height, 240) + _BELOW)
    draw_title(drawing, title, about)
    drawing.picture(picture.rgba, _MARGIN, _HEAD, width, height, png)
    points_per_m = per_pixel / picture.pixel_size_m
    draw_scale_bar(drawing, _MARGIN, drawing.height - 14, points_per_m, 0.3 * longest)

    def place(uv_m: Sequence[float]) -> tuple[float, float]:
        across, down = (np.asarray(uv_m) - picture.origin_uv_m) / picture.pixel_size_m + 0.5
        return float(_MARGIN + across * per_pixel), float(_HEAD + down * per_pixel)

    for n, piece in enumerate(pieces, start=1):
        if piece.placed is not None:
            continue
        x, y = place(piece.view.origin_uv_m)
        drawing.text(
            x,
            max(y - 4, _HEAD + 10),
            piece.label,
            SIZE,
            hex_of(piece_color(n)),
            bold=True,
        )
    if outline is not None:
        line = np.array([place(uv) for uv in (*outline.tolist(), outline[0].tolist())])
        drawing.line(line, PAPER, 3.5)
        drawing.line(line, BLUE, 1.8)
    for places_m, color in dots:
        for uv_m in places_m:
            drawing.dot(*place(uv_m), 1.6, color)
    for u_m, v_m, label in (*marks, *rings):
        x, y = place((u_m, v_m))
        drawing.dot(x, y, 6.5, PAPER)
        drawing.dot(x, y, 5.0, PINK)
        if (u_m, v_m, label) in rings:
            drawing.dot(x, y, 3.0, PAPER)
        drawing.box(x + 8, y - 8, text_width(label, SIZE) + 6, 16, PAPER, 0.85)
        drawing.text(x + 11, y + 4.5, label, SIZE, PINK, bold=True)
    if explained is not None:
        _explain(drawing, _MARGIN + width + 24, _HEAD + 12, explained)
    return drawing


def _explain(drawing: Drawing, x: float, y: float, explained: dict[str, object]) -> None:
    """Draw a layer's legend; see :func:`flatcloth.rendering.layers.legend`."""
    match explained:
        case {"kind": "ramp", "title": str(title), "low": float(low), "high": float(high), "colors": colors}:
            assert isinstance(colors, list)
            drawing.text(x, y, title, SMALL, TEXT)
            draw_ramp(drawing, x, y + 14, 170, colors, low, high)
        case {"kind": "classes", "title": str(title), "classes": list(classes)}:
            drawing.text(x, y, title, SMALL, TEXT)
            draw_key(drawing, x, y + 14, [(c["color"], c["label"]) for c in classes])


# --- growth and energy ---------------------------------------------------------------------------


def growth(session: OpenedSession) -> Figure:
    """Return the chart of the shape's area after each accepted view."""
    steps = session.growth.steps
    after = 1e4 * np.array([step.area_m2 + step.floating_m2 for step in steps])
    before = np.concatenate([[0.0], after[:-1]])
    shape = 1e4 * np.array([step.area_m2 for step in steps])
    what = "area of shape and pieces" if bool((after > shape).any()) else "area of the shape"
    order = np.arange(len(steps), dtype=np.float64)
    drawing = Drawing(max(420.0, 110 + 46 * len(steps)), 350)
    draw_title(drawing, "Growth", f"{what} after each accepted view")
    frame = Frame(
        left=62, top=84, width=drawing.width - 90, height=200,
        x_range=(-0.7, len(steps) - 0.3), y_range=(0.0, float(after.max()) * 1.05),
    )  # fmt: skip
    labels = [(step.order, f"{step.view_index}\n{step.angle_deg:g}\u00b0") for step in steps]
    axes = draw_axes(drawing, frame, "", "cm\u00b2", labels)
    low, high = np.minimum(before, after), np.maximum(before, after)
    axes.bar(order, low, 0.72, color="#b9c6d6")
    axes.bar(order, high - low, 0.72, bottom=low, color=BLUE)
    axes.bar(order, after - shape, 0.72, bottom=shape, fill=False, edgecolor=SOFT, hatch="////", linewidth=0)
    for x, y, step in zip(order, high, steps, strict=True):
        added = f"{round(1e4 * step.added_m2):+d}".replace("-", "\u2212")
        axes.annotate(
            added, (x, y), (0, 4), textcoords="offset points", ha="center", color=SOFT, fontsize=SMALL
        )
    drawing.text(frame.left - 7, frame.top + frame.height + 54, "view, rotation", SMALL, SOFT)
    caption = f"The {what} grew from {after[0]:.0f} to {after[-1]:.0f} cm\u00b2 in {len(steps)} views."
    if after[-1] > shape[-1]:
        caption += f" Hatched: floating pieces, {after[-1] - shape[-1]:.0f} cm\u00b2 in the end."
    return Figure(name="growth", caption=caption, drawing=drawing)


def energy(session: OpenedSession) -> Figure:
    """Return the chart of the energy of Eq. (2) at each iteration, one line per view of the shape."""
    steps = session.growth.steps
    colors = view_colors(len(session.integration.recording))
    lines = [session.numbers_of(step.view_index).energies_m2 for step in steps]
    every = np.concatenate([part for line in lines for part in line])
    every = every[every > 0]
    low, high = (float(every.min()), float(every.max())) if every.size else (0.1, 1.0)
    most = max(sum(len(part) for part in line) for line in lines) - 1
    drawing = Drawing(640, max(330.0, 120 + 18 * len(steps)))
    draw_title(drawing, "Energy", "H of Eq. (2) at each iteration, first at the coarse interval")
    frame = Frame(
        left=62, top=84, width=440, height=drawing.height - 140,
        x_range=(0.0, float(max(most, 1))), y_range=(low / 1.5, high * 1.5), log_y=True,
    )  # fmt: skip
    axes = draw_axes(drawing, frame, "iteration", "H (m\u00b2)")
    key = []
    for step, line in zip(steps, lines, strict=True):
        color = hex_of(colors[step.view_index])
        start = 0
        for part in line:
            axes.plot(
                np.arange(start, start + len(part)), np.maximum(part, low / 1.5), "o-", markevery=[0],
                color=color, linewidth=1.6, markersize=4.8, markeredgewidth=0,
            )  # fmt: skip
            start += len(part)
        key.append((color, f"view {step.view_index} ({step.angle_deg:g}\u00b0)"))
    draw_key(drawing, frame.left + frame.width + 20, frame.top, key)
    caption = (
        "Energy of the flattening of each accepted view; a dot marks the start of each sampling interval."
    )
    return Figure(name="energy", caption=caption, drawing=drawing)


# --- decisions -----------------------------------------------------------------------------------


def overlay(session: OpenedSession, decision: Decision) -> Figure:
    """Return the picture of a proposal on the shape at the time of the decision."""
    integration = session.integration
    angle = integration.recording.angles_deg[decision.view_index]
    title = f"Decision {decision.number}: view {decision.view_index} ({angle:g}\u00b0)"
    verdict = verdict_text(decision)
    picture = picture_before(session, decision)
    drawing = map_drawing(_decoded(picture), title, verdict, legend_width=20.0, png=picture.png)
    return Figure(name=_name(decision, "overlay"), caption=f"{title}, {verdict}.", drawing=drawing)


def picture_before(session: OpenedSession, decision: Decision) -> PngPicture:
    """Return the picture of a proposal on the shape at the time of the decision."""
    before = decision.before
    pending = before.pending
    assert pending is not None
    places = pending.view_index, pending.component, pending.current_from_new, pending.also_placed
    key = key_of(session.integration.axis, before), places
    return session.kept.pictures.get(key, lambda: _picture_before(session, before))


def _picture_before(session: OpenedSession, before: Document) -> PngPicture:
    sheet = session.sheet_of(before)
    overlay = overlay_on(session.integration, before, sheet)
    laid = laid_on(sheet.view, overlay, beyond(overlay, sheet.view))
    return PngPicture(png=png_of(laid.rgba), pixel_size_m=laid.pixel_size_m, origin_uv_m=laid.origin_uv_m)


def _decoded(picture: PngPicture) -> PlanePicture:
    from PIL import Image

    rgba = np.asarray(Image.open(io.BytesIO(picture.png)))
    return PlanePicture(rgba=rgba, pixel_size_m=picture.pixel_size_m, origin_uv_m=picture.origin_uv_m)


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
    drawing = Drawing(520, 420)
    draw_title(drawing, f"Plan of decision {decision.number}", side.reason)
    draw_curves(drawing, side.curves, session.integration.planning, (84.0, 110.0, 120.0), side)
    caption = f"h(u) and A_z(u) of the shape before decision {decision.number}; {side.reason}."
    return Figure(name=_name(decision, "plan"), caption=caption, drawing=drawing)


def curves(session: OpenedSession) -> Iterator[Figure]:
    """Yield the curves h(u) and A_z(u) of each view of the shape."""
    for step in session.growth.steps:
        found = session.numbers_of(step.view_index).curves
        if found.u_m.size < 2:
            continue
        drawing = Drawing(520, 420)
        title = f"View {step.view_index} ({step.angle_deg:g}\u00b0)"
        draw_title(drawing, title, "columns of its flattened view")
        draw_curves(drawing, found, session.integration.planning, (84.0, 110.0, 120.0))
        caption = f"h(u) and A_z(u) of the flattened view {step.view_index}."
        yield Figure(name=f"curves-view-{step.view_index}", caption=caption, drawing=drawing)


def _name(decision: Decision, kind: str) -> str:
    return f"decision-{decision.number:02d}-view-{decision.view_index}-{kind}"
