"""A shape in a notebook: its picture as the result of a cell, and a widget in which points are picked."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from flatcloth.core.errors import FlatclothError
from flatcloth.core.resources import static_folder
from flatcloth.core.types import Rigid2
from flatcloth.export.data import png_bytes
from flatcloth.export.garment import upright_rad
from flatcloth.rendering.drawing import data_url

if TYPE_CHECKING:
    from flatcloth.export.data import SessionData
    from flatcloth.grasping.grasps import GraspPose
    from flatcloth.session.journal import Pick

_MARGIN_PX = 12.0
"""Margin of the pictures around the cloth, so that marks at its rim are whole. Chosen."""
_WIDTH_PX = 360
"""Width of the picture in a cell. Chosen: leaves room for the summary."""


def html_of(data: SessionData, points: Mapping[str, Pick], summary: Sequence[str]) -> str:
    """Return the flat image with the named points and picks, and the summary, as HTML."""
    rows, cols = data.canonical.view.valid.shape
    radius = max(rows, cols) / 90
    circle = f'r="{radius:.1f}" fill="#fff" stroke="#000"'
    marks = "".join(
        f'<circle cx="{mark["col"] + 0.5}" cy="{mark["row"] + 0.5}" {circle}>'
        f"<title>{escape(mark['name'])}</title></circle>"
        for mark in marks_of(data, points)
    )
    image = f'<image href="{image_of(data)}" width="{cols}" height="{rows}"/>'
    turn, box = turned_upright(data)
    label = 'role="img" aria-label="The flattened garment"'
    layer = f'<g transform="{turn}">{image}{marks}</g>'
    picture = f'<svg viewBox="{box}" width="{_WIDTH_PX}" {label}>{layer}</svg>'
    lines = "".join(f"<li>{escape(line)}</li>" for line in summary)
    text = f'<ul style="flex:1 1 20em">{lines}</ul>'
    return f'<div style="display:flex;gap:1em;flex-wrap:wrap">{picture}{text}</div>'


def turned_upright(data: SessionData) -> tuple[str, str]:
    """Return the transform that turns the picture upright, and the box around the cloth, as SVG has them."""
    turn_rad = upright_rad(data.garment)
    pixels = np.argwhere(data.canonical.view.valid)[:, ::-1] + 0.5
    turned = Rigid2(theta_rad=turn_rad).apply(pixels)
    low, high = turned.min(axis=0) - _MARGIN_PX, turned.max(axis=0) + _MARGIN_PX
    box = " ".join(f"{number:.1f}" for number in (*low, *(high - low)))
    return f"rotate({np.degrees(turn_rad):.2f})", box


def image_of(data: SessionData) -> str:
    """Return the flat image as a data URL."""
    return data_url(png_bytes(data.canonical.view.rgb, data.canonical.view.valid), "image/png")


def marks_of(data: SessionData, points: Mapping[str, Pick]) -> list[dict[str, Any]]:
    """Return the named points and the picks that lie on the shape: name, row and column."""
    from flatcloth.grasping.grasps import LOST_AT_M, pixel_of_point

    found = []
    for point in (*points.values(), *data.picks):
        (row, col), distance_m = pixel_of_point(data.canonical.view, point.position_held_m)
        if distance_m <= LOST_AT_M:
            found.append({"name": point.name, "row": row, "col": col, "by_hand": False})
    return found


def widget_of(data: SessionData, points: Mapping[str, Pick], grasp: Callable[[int, int], GraspPose]) -> Any:
    """Return a widget of a shape; see :meth:`flatcloth.Shape.widget`."""
    try:
        import anywidget
        import traitlets
    except ImportError as error:
        raise FlatclothError(
            f"The widget needs anywidget ({error}); pip install 'flatcloth[jupyter]'."
        ) from error

    class ShapeWidget(anywidget.AnyWidget):
        """The flat image; a click on the cloth adds a pick, whose pose is in ``poses``."""

        _esm = static_folder() / "notebook" / "shape.js"
        image = traitlets.Unicode().tag(sync=True)
        turn = traitlets.Unicode().tag(sync=True)
        box = traitlets.Unicode().tag(sync=True)
        size: Any = traitlets.List().tag(sync=True)
        points: Any = traitlets.List().tag(sync=True)
        picks: Any = traitlets.List().tag(sync=True)
        told = traitlets.Unicode("Click the cloth.").tag(sync=True)
        asked: Any = traitlets.List([0, 0, 0]).tag(sync=True)

        def __init__(self) -> None:
            turn, box = turned_upright(data)
            size, marks = list(data.canonical.view.valid.shape), marks_of(data, points)
            super().__init__(image=image_of(data), turn=turn, box=box, size=size, points=marks)
            self.poses: dict[str, GraspPose] = {}

        @traitlets.observe("asked")
        def _pick(self, change: Any) -> None:
            row, col, _ = map(int, change["new"])
            try:
                pose = grasp(row, col)
            except FlatclothError as error:
                self.told = str(error)
                return
            name = f"Pick {len(self.poses) + 1}"
            self.poses[name] = pose
            self.picks = [*self.picks, {"name": name, "row": row, "col": col, "by_hand": True}]
            x, y, z = pose.object_from_grasp.translation_m
            self.told = f"{name}: pixel ({row}, {col}), at ({x:.3f}, {y:.3f}, {z:.3f}) m in the object frame"

    return ShapeWidget()
