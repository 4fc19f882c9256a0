"""A printable report: the recording, the settings, decisions, picks and figures; one HTML file."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from html import escape

import numpy as np

from flatcloth.checking.result import told
from flatcloth.core.config import Config
from flatcloth.core.resources import static_folder
from flatcloth.core.types import Floats
from flatcloth.engine.outcome import sides_entry
from flatcloth.engine.sheet import Sheet
from flatcloth.export import figures
from flatcloth.export.figures import Figure, draw_curves, plan_of, side_of
from flatcloth.export.files import printed
from flatcloth.export.garment import summary
from flatcloth.export.history import (
    ACCEPTED,
    FLAGS,
    OVERRIDDEN,
    SKIPPED,
    VERDICTS,
    Decision,
    flags_of,
    is_overridden,
    overridden,
)
from flatcloth.export.session import OpenedSession
from flatcloth.garments.recognition import NONE
from flatcloth.grasping.grasps import GraspPose
from flatcloth.methods.answers import JoinedSides
from flatcloth.rendering.drawing import data_url
from flatcloth.rendering.layers import LAYERS, png
from flatcloth.session.header import differences


def report(session: OpenedSession) -> str:
    """Return the report as self-contained HTML."""
    history = session.history
    body = [
        *_head(session),
        *_settings(history.header.effective_config),
        *_decisions(session),
        *_both_sides(session),
        *_garment(session),
        *_picks(session),
        *_figures(session),
    ]
    return page_of(f"{history.header.recording.name}: integration report", body)


def page_of(title: str, body: Iterable[str]) -> str:
    """Return self-contained HTML in the style of reports."""
    style = (static_folder() / "offline" / "report.css").read_text(encoding="utf-8")
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{escape(title)}</title>
<style>\n{style}</style></head>
<body><main>
{"".join(f"{printed(part)}{chr(10)}" for part in body)}</main></body></html>
"""


def _head(session: OpenedSession) -> Iterable[str]:
    history, growth, recording = session.history, session.growth, session.integration.recording
    header = history.header
    views = ", ".join(f"{step.view_index} ({step.angle_deg:g}\u00b0)" for step in growth.steps)
    camera, day = recording.intrinsics, header.created[:10] or "at an unknown time"
    limit = session.integration.accept_score
    against = overridden(history, limit)
    flagged = [
        (f"\u2691 View {view.view_index}", "; ".join(FLAGS[flag] for flag in flags_of(view, limit, against)))
        for view in history.document.accepted
    ]
    count = {word: sum(d.verdict == word for d in history.decisions) for word in VERDICTS}
    stood = sum(d.stands and d.verdict == ACCEPTED for d in history.decisions)
    at_once = len(history.document.accepted) - stood
    counted = [f"{at_once} views accepted at once"] if at_once else []
    counted += [f"{n} {word}" for word, n in count.items() if n or (word != SKIPPED and not at_once)]
    gone = sum(not d.stands for d in history.decisions)
    counted += [f"{gone} of them taken back"] if gone else []
    yield f"<h1>{escape(header.recording.name)}</h1>"
    yield f'<p class="lead">{escape(recording.description or "Integration of turned RGB-D views.")}</p>'
    facts = [
        ("Session", f"started {day}, flatcloth {header.versions.get('flatcloth', 'unknown')}"),
        ("Recording", f"{header.recording.views} views, {camera.width} \u00d7 {camera.height} px"),
        ("Method", header.method),
        ("Shape", f"{1e4 * growth.area_m2:.0f} cm\u00b2 from {len(growth.steps)} views"),
        *_floating(growth.sheet),
        ("Views, in order", views),
        ("Decisions", ", ".join(counted)),
        *((name, words) for name, words in flagged if words),
        ("End", history.document.finished or "Not finished: more views may be added."),
    ]
    rows = "".join(f"<dt>{escape(name)}</dt><dd>{escape(value)}</dd>" for name, value in facts)
    yield f'<dl class="facts">{rows}</dl>'
    wrong = session.integration.wrong(history.document)
    for note in ([told(wrong)] if wrong else []) + list(session.integration.notes):
        yield f'<p class="note">{escape(note)}</p>'
    yield "<h2>Shape</h2>"
    yield from (_figure(figure, "hero") for figure in figures.maps(session, ("color",)))


def _floating(sheet: Sheet) -> Iterable[tuple[str, str]]:
    for piece in sheet.pieces:
        where = "floats" if piece.placed is None else "part of the shape"
        text = f"{where}, {1e4 * piece.view.area_m2:.0f} cm\u00b2; views {', '.join(map(str, piece.views))}."
        yield f"Piece {piece.label}", f"{text} {piece.reason}"


def _settings(config: Config) -> Iterable[str]:
    yield "<h2>Settings</h2>"
    changed = [(name, f"{here}", f"{there}") for name, here, there in differences(config, Config())]
    yield f"<p>All settings have their default values{' except these:' if changed else '.'}</p>"
    if changed:
        yield table_html(("setting", "here", "default"), changed)


def _decisions(session: OpenedSession) -> Iterable[str]:
    yield "<h2>Decisions</h2>"
    decisions = session.history.decisions
    if not decisions:
        yield "<p>There are no decisions: the shape is the start view alone.</p>"
    for n, decision in enumerate(decisions):
        session.progress(n / len(decisions), f"reporting decision {n + 1} of {len(decisions)}")
        yield from _decision(session, decision)


def _decision(session: OpenedSession, decision: Decision) -> Iterable[str]:
    angle = session.integration.recording.angles_deg[decision.view_index]
    picture = data_url(png(figures.picture_before(session, decision).rgba), "image/png")
    verdict = figures.verdict_text(decision).removeprefix(decision.verdict)
    about = f"View {decision.view_index} placed on the shape"
    gone = "" if decision.stands else " gone"
    if is_overridden(decision, session.integration.accept_score):
        verdict += f"; \u2691 {FLAGS[OVERRIDDEN]}"
    yield f'<section class="decision{gone}">'
    yield (
        f"<h3>{decision.number}. View {decision.view_index} ({angle:g}\u00b0):"
        f' <b class="{decision.verdict}">{decision.verdict}</b><span>{escape(verdict)}</span></h3>'
    )
    yield f'<img class="picture" src="{picture}" alt="{about}">'
    plan = plan_of(session, decision)
    side = side_of(plan, decision)
    config = session.integration.planning
    yield "<div>"
    chosen = "chosen by hand" if decision.by_hand else "chosen by the plan"
    if side is not None:
        chosen, curves, of = side.reason, side.curves, f"of the shape before decision {decision.number}"
    else:
        if plan is not None and plan.view_index == decision.view_index:
            chosen = plan.reason
        curves, of = session.numbers_of(decision.view_index).curves, f"of view {decision.view_index}"
    clock = decision.time[11:19] or "at an unknown time"
    yield f'<p class="lead">{escape(chosen)}; {clock} UTC</p>'
    if curves.u_m.size > 1:
        caption = f"h(u) and A_z(u) {of}"
        drawing = draw_curves(curves, config, "", side, (330.0, 190.0))
        yield _figure(Figure(name="curves", caption=caption, drawing=drawing))
    yield "</div></section>"


def _both_sides(session: OpenedSession) -> Iterable[str]:
    sides = session.data.sides
    if sides is None:
        return
    yield "<h2>Both sides</h2>"
    if isinstance(sides, str):
        yield f"<p>{escape(sides)}</p>"
        return
    yield from (_figure(figure, "hero") for figure in figures.both_sides(session))
    yield table_html(("seam", "places", "residual", "views", "verdict"), _seam_rows(sides))


def _seam_rows(sides: JoinedSides) -> list[tuple[str, ...]]:
    """Return the seams as rows of a table: length, places, residual, views, and whether they join."""
    rows: list[tuple[str, ...]] = []
    for seam in sides_entry(sides)["seams"]:
        decided = {"cut": " (cut)", "keep": " (kept)"}.get(seam["decided"] or "", "")
        rows.append(
            (
                f"{seam['length_mm'] / 10:.0f} cm",
                str(seam["matches"]),
                f"{seam['residual_mm']:.1f} mm",
                ", ".join(map(str, seam["views"][:8])),
                ("joins" if seam["joins"] else f"joins nothing: {seam['reason']}") + decided,
            )
        )
    return rows


def _garment(session: OpenedSession) -> Iterable[str]:
    known = session.data.garment
    yield "<h2>Garment</h2>"
    if isinstance(known, str):
        yield f"<p>{escape(known)}</p>"
        return
    garment = summary(known)
    shares = ", ".join(
        f"{_words(name)} {share:.0%}" for name, share in garment["probabilities"] if share >= 0.005
    )
    kind = _words(garment["kind"] or NONE) + (", set by hand" if garment["by_hand"] else "")
    yield f"<p>{escape(kind)}. By the evidence: {escape(shares)}.</p>"
    if garment["kind"] is None:
        return
    yield from (_figure(figure, "hero") for figure in figures.garment(session))
    sizes = [(_words(d["name"]), f"{d['mm']:.0f} \u00b1 {d['std_mm']:.0f} mm") for d in garment["dimensions"]]
    yield table_html(("dimension", "flat, one standard deviation"), sizes)
    rows = [
        (
            _words(point["name"]),
            "held by hand" if point["held"] else "seen" if point["seen"] else "predicted",
            f"{point['std_mm']:.0f} mm",
            _vector_mm(np.array(point["xyz_m"])) if point["seen"] else "\u2013",
        )
        for point in garment["points"]
    ]
    yield table_html(("named point", "how", "known to", "x y z (mm), object frame"), rows)


def _words(name: str) -> str:
    return name.replace("_", " ")


def _picks(session: OpenedSession) -> Iterable[str]:
    yield "<h2>Picks</h2>"
    history = session.history
    if not history.picks:
        yield "<p>There are no picks.</p>"
        return
    rows = []
    for pick in history.picks:
        source = f"view {pick.view_index} @ {pick.source_rc[0]:.1f}, {pick.source_rc[1]:.1f}"
        name = pick.name if pick.side == "this" else f"{pick.name} (other side)"
        rows.append(
            (str(pick.id), name, _vector_mm(pick.position_held_m), *_posed(session.pose_of(pick)), source)
        )
    yield (
        "<p>Positions in the object frame (the camera frame of view 0, the item turned back), approach along"
        " the inward normal; uncertainties are one standard deviation.</p>"
    )
    head = ("no.", "name", "x y z (mm)", "approach", "axis", "opening", "uncertainty", "measured in")
    yield table_html(head, rows)


def _posed(pose: GraspPose | None) -> tuple[str, str, str, str]:
    if pose is None:
        return ("\u2013",) * 4
    turn, about = pose.object_from_grasp.rotation, pose.uncertainty
    mm = 1000 * about.position_m
    known = "\u2013"
    if not math.isnan(mm):
        known = f"{'< 0.1' if mm < 0.1 else f'{mm:.1f}'} mm, {about.normal_deg:.0f}\u00b0"
    axis = f"{_vector(turn[:, 0])} ({pose.axis_from})"
    return _vector(turn[:, 2]), axis, f"{1000 * pose.opening_m:.0f} mm", known


def _figures(session: OpenedSession) -> Iterable[str]:
    yield '<h2>Figures</h2><div class="figures">'
    yield _figure(figures.growth(session), "wide")
    yield _figure(figures.energy(session), "wide")
    yield from (_figure(figure) for figure in figures.maps(session, LAYERS[1:]))
    yield "</div>"


def _figure(figure: Figure, kind: str = "") -> str:
    picture = data_url(figure.svg().encode(), "image/svg+xml")
    caption = escape(figure.caption)
    image = f'<img src="{picture}" alt="{caption}">'
    return f'<figure class="{kind}">{image}<figcaption>{caption}</figcaption></figure>'


def table_html(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table of texts."""
    names = "".join(f"<th>{escape(name)}</th>" for name in head)
    lines = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><thead><tr>{names}</tr></thead><tbody>{lines}</tbody></table>"


def _vector(values: Floats) -> str:
    return " ".join(f"{float(x):.3f}".replace("-", "\u2212") for x in np.asarray(values))


def _vector_mm(values: Floats) -> str:
    return " ".join(f"{1000 * float(x):.1f}".replace("-", "\u2212") for x in np.asarray(values))
