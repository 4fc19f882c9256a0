"""Both sides of the item in figures and in the report: a picture of both with their seams, and numbers."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from flatcloth.engine.outcome import other_side_lines, sides_entry
from flatcloth.engine.sheet import lay_out
from flatcloth.export.figures import Figure, map_drawing
from flatcloth.export.session import OpenedSession
from flatcloth.methods.answers import JoinedSides
from flatcloth.rendering.pictures import side_by_side

JOINS, JOINS_NOT = "#6a3fb5", "#9a5b00"
"""Colors of seams, those of the page. Chosen."""


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
            dots.append((places[np.isfinite(places).all(axis=1)], JOINS_NOT if seam.why else JOINS))
    line = " ".join(other_side_lines(sides_entry(sides)))
    yield Figure(
        name="both-sides",
        caption=f"Both sides, each as seen from its own outside, with the places of their seams. {line}",
        drawing=map_drawing(picture, "Both sides", "", legend_width=0.0, dots=dots),
    )


def seam_rows(sides: JoinedSides) -> list[tuple[str, ...]]:
    """Return the seams as rows of a table: length, places, residual, views, and whether they join."""
    rows: list[tuple[str, ...]] = []
    for seam in sides_entry(sides)["seams"]:
        decided = {"cut": " (cut by hand)", "keep": " (kept by hand)"}.get(seam["decided"] or "", "")
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
