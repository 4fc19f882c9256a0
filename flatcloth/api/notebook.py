"""A shape in a notebook: its picture as the result of a cell, and a widget in which points are picked."""

from __future__ import annotations

import base64
from html import escape
from typing import TYPE_CHECKING, Any, Protocol

from flatcloth.core.errors import FlatclothError
from flatcloth.core.resources import static_folder
from flatcloth.export.data import png_bytes

if TYPE_CHECKING:
    from flatcloth.core.types import Bool, FlattenedView
    from flatcloth.export.session_data import SessionData
    from flatcloth.grasping.grasps import GraspPose
    from flatcloth.session.journal import Pick


class Shown(Protocol):
    """What is shown of a :class:`flatcloth.Shape`, and asked."""

    @property
    def data(self) -> SessionData:
        """The recording with its decisions."""

    @property
    def view(self) -> FlattenedView:
        """The shape."""

    @property
    def valid(self) -> Bool:
        """(H, W) True on cloth."""

    def lines(self) -> list[str]:
        """Return the summary."""

    def named_points(self) -> dict[str, Pick]:
        """Return the named points that were seen."""

    def grasp(self, row: int, col: int) -> GraspPose:
        """Return the grasp pose at a pixel."""


_WIDTH_PX = 360
"""Width of the picture in a cell. Chosen: beside it the summary has room."""


def html_of(shape: Shown) -> str:
    """Return the flat image with the named points and picks, and the summary, as HTML."""
    rows, cols = shape.valid.shape
    radius = max(rows, cols) / 90
    circle = f'r="{radius:.1f}" fill="#fff" stroke="#000"'
    marks = "".join(
        f'<circle cx="{mark["col"] + 0.5}" cy="{mark["row"] + 0.5}" {circle}>'
        f"<title>{escape(mark['name'])}</title></circle>"
        for mark in marks_of(shape)
    )
    image = f'<image href="{image_of(shape)}" width="{cols}" height="{rows}"/>'
    label = 'role="img" aria-label="The flattened garment"'
    picture = f'<svg viewBox="0 0 {cols} {rows}" width="{_WIDTH_PX}" {label}>{image}{marks}</svg>'
    lines = "".join(f"<li>{escape(line)}</li>" for line in shape.lines())
    return f'<div style="display:flex;gap:1em;flex-wrap:wrap">{picture}<ul>{lines}</ul></div>'


def image_of(shape: Shown) -> str:
    """Return the flat image as a data URL."""
    return "data:image/png;base64," + base64.b64encode(png_bytes(shape.view)).decode()


def marks_of(shape: Shown) -> list[dict[str, Any]]:
    """Return the named points and the picks that lie on the shape: name, row and column."""
    from flatcloth.grasping.grasps import LOST_AT_M, pixel_of_point

    found = []
    for point in (*shape.named_points().values(), *shape.data.picks):
        (row, col), distance_m = pixel_of_point(shape.view, point.position_held_m)
        if distance_m <= LOST_AT_M:
            found.append({"name": point.name, "row": row, "col": col, "by_hand": False})
    return found


def widget_of(shape: Shown) -> Any:
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
        size: Any = traitlets.List().tag(sync=True)
        points: Any = traitlets.List().tag(sync=True)
        picks: Any = traitlets.List().tag(sync=True)
        told = traitlets.Unicode("Click the cloth.").tag(sync=True)
        asked: Any = traitlets.List([0, 0, 0]).tag(sync=True)

        def __init__(self) -> None:
            super().__init__(image=image_of(shape), size=list(shape.valid.shape), points=marks_of(shape))
            self.poses: dict[str, GraspPose] = {}

        @traitlets.observe("asked")
        def _pick(self, change: Any) -> None:
            row, col, _ = map(int, change["new"])
            try:
                pose = shape.grasp(row, col)
            except FlatclothError as error:
                self.told = str(error)
                return
            name = f"Pick {len(self.poses) + 1}"
            self.poses[name] = pose
            self.picks = [*self.picks, {"name": name, "row": row, "col": col, "by_hand": True}]
            x, y, z = pose.object_from_grasp.translation_m
            self.told = f"{name}: pixel ({row}, {col}), at ({x:.3f}, {y:.3f}, {z:.3f}) m in the object frame"

    return ShapeWidget()
