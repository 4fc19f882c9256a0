"""The points of the 3D scene and their colours, selected in viser's panel."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import viser

from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import Bool, FlattenedView, Floats, RotationAxis, Uint8
from flatcloth.engine.integration import Integration
from flatcloth.rendering import layers
from flatcloth.rendering.colormaps import piece_color, view_colors
from flatcloth.rendering.layers import CONFLICT_M, PLAIN, Appearance, difference
from flatcloth.viewer.protocol.picture import Picture
from flatcloth.viewer.worker import Worker

MOST_POINTS = 60_000
"""More points are thinned. Chosen for the browser's speed."""
_HIGHLIGHT = np.array([255, 140, 0], dtype=np.float64)
"""Color of what is pointed at. Chosen."""
_GREY = 150.0
"""Grey of points that are not of interest. Chosen."""

LIVE, HELD, PROPOSAL = "/live/cloud", "/held/cloud", "/proposal/cloud"
SHAPE, ALL, NEW, CONFLICTS = "Shape and view", "All views", "Only new points", "Only conflicts"
POINTS = (SHAPE, ALL, NEW, CONFLICTS)
COLORS = {
    "Color": "color", "Source view": "source", "Z-angle": "z_angle", "Height z": "height",
    "Stretch": "stretch", "Incidence": "incidence", "Density": "density", "Uncertainty": "place",
}  # fmt: skip
_HINTS = {
    NEW: "There is no proposal: nothing is new.",
    CONFLICTS: "There is no proposal: nothing is in conflict.",
    ALL: "The views are being read.",
}


@dataclass(frozen=True)
class Cloud:
    """Points (N, 3) in the object frame, colors (N, 3), and how large each is drawn."""

    points_m: Floats
    colors: Uint8
    size_m: float


NOTHING = Cloud(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.uint8), 0.0)
"""A cloud without points."""


def clouds_of(
    picture: Picture,
    axis: RotationAxis,
    n_views: int,
    points: str = SHAPE,
    color: str = "color",
    look: Appearance = PLAIN,
) -> dict[str, Cloud]:
    """Return the clouds of a picture by the name of their node.

    Parameters
    ----------
    picture : Picture
        What is shown.
    axis, n_views
        Of the recording: for the colours.
    points : str
        One of ``POINTS``; for ``ALL`` the views come on their own, and this is nothing.
    color, look
        A layer of the flattened view, and how it is displayed.
    """
    found = dict.fromkeys((LIVE, HELD, PROPOSAL), NOTHING)
    view, overlay = picture.view, picture.overlay

    def cloud(of: FlattenedView, where: Bool, size_m: float) -> Cloud:
        if color == "color" and look == PLAIN:
            return Cloud(of.xyz_m[where], of.rgb[where], size_m)
        colors: Any = layers.rgba(of, color, axis, n_views, look, like=view)[where][:, :3]
        return Cloud(of.xyz_m[where], colors, size_m)

    if points == SHAPE:
        live = picture.cloud
        # The view's own points have no layers: in grey they do not mix with those that have.
        found[LIVE] = Cloud(live.xyz_m, dimmed(live.rgb, live.of_interest & (color == "color")), 0.0015)
        held = _with_pieces(cloud(view, view.valid, 0.0018), picture, color)
        found[HELD] = held if picture.other is None else _both(held, picture.other.view, cloud)
    if overlay is None:
        return found
    if points in (SHAPE, NEW):
        new = cloud(overlay.view, overlay.new_points & overlay.view.valid, 0.0026)
        if points == SHAPE and color == "color":
            new = Cloud(new.points_m, (0.35 * new.colors + 0.65 * _HIGHLIGHT).astype(np.uint8), 0.0026)
        found[PROPOSAL] = new
    elif points == CONFLICTS:
        apart = difference(view, overlay.view, axis)
        with np.errstate(invalid="ignore"):
            where = apart.common & (apart.distance_m > CONFLICT_M)
        colors = layers.difference_rgba(apart, "position")[where][:, :3]
        found[PROPOSAL] = Cloud(overlay.view.xyz_m[where], colors, 0.0026)
    return found


def _both(this: Cloud, other: FlattenedView, cloud: Callable[[FlattenedView, Bool, float], Cloud]) -> Cloud:
    """Return the points of both sides."""
    its = cloud(other, other.valid, this.size_m)
    points, colors = np.concatenate([this.points_m, its.points_m]), np.concatenate([this.colors, its.colors])
    return Cloud(points, colors, this.size_m)


def _with_pieces(cloud: Cloud, picture: Picture, color: str) -> Cloud:
    """Tint the points of floating pieces in the colours that the flattened view marks them with."""
    if picture.sheet is None or not picture.sheet.pieces or color != "color":
        return cloud
    piece = picture.sheet.piece[picture.view.valid]
    colors = cloud.colors.astype(np.float64)
    for n in range(1, len(picture.sheet.pieces) + 1):
        colors[piece == n] = 0.5 * colors[piece == n] + 0.5 * piece_color(n)
    return Cloud(cloud.points_m, colors.astype(np.uint8), cloud.size_m)


def all_views(integration: Integration, color: str) -> Cloud:
    """Return the points of all views of the recording, object frame, subsampled; in color, or by view."""
    views = range(len(integration.recording))
    each = max(1, MOST_POINTS // len(views))
    points, colors = [], []
    shades = view_colors(len(views))
    for view in views:
        try:
            cloud = integration.views.cloud(view)
        except FlatclothError:
            continue  # unreadable; the timeline reports it on request
        here = np.flatnonzero(cloud.of_interest)
        here = here[np.linspace(0, len(here) - 1, min(each, len(here))).astype(np.intp)]
        points.append(cloud.xyz_m[here])
        colors.append(np.tile(shades[view], (len(here), 1)) if color == "source" else cloud.rgb[here])
    if not points:
        return NOTHING
    return Cloud(np.concatenate(points), np.concatenate(colors).astype(np.uint8), 0.0018)


def dimmed(rgb: Uint8, of_interest: Bool) -> Uint8:
    """Return the colors (N, 3), with points that are not of interest in grey."""
    grey = (0.25 * rgb + 0.75 * _GREY).astype(np.uint8)
    return np.where(of_interest[:, None], rgb, grey)


class CloudPanel:
    """A folder of viser's panel; its callbacks come from viser's threads.

    Parameters
    ----------
    server : viser.ViserServer
        Whose panel it joins.
    integration : Integration
        Reads all views, on a thread of this object.
    on_change : callable
        Shows the present picture again.
    """

    def __init__(
        self, server: viser.ViserServer, integration: Integration, on_change: Callable[[], None]
    ) -> None:
        self._integration = integration
        self._on_change = on_change
        self._lock = threading.Lock()
        self._all: tuple[Any, Cloud] | None = None
        self._wanted: Any = None
        self._look = PLAIN
        self._worker = Worker("flatcloth-clouds")
        gui = server.gui
        with gui.add_folder("Cloud", expand_by_default=True):
            self._points = gui.add_dropdown("Points", POINTS, initial_value=SHAPE)
            self._color = gui.add_dropdown("Colour", tuple(COLORS), initial_value="Color")
            self._hint = gui.add_markdown("")
            self._hint.visible = False
        for choice in (self._points, self._color):
            choice.on_update(lambda _event: self._on_change())

    def stop(self) -> None:
        """Stop the thread."""
        self._worker.stop(timeout_s=2.0)

    def choose_color(self, layer: str, look: Appearance) -> None:
        """Colour by a layer of the flattened view, displayed in a way; the dropdown shows it."""
        title = next(title for title, name in COLORS.items() if name == layer)
        known = (self._color.value, self._look) == (title, look)
        self._look = look
        dropdown: Any = self._color  # its value can be set, which its type does not say
        if dropdown.value != title:
            dropdown.value = title  # this also triggers the callback
        elif not known:
            self._on_change()

    def clouds(self, picture: Picture, axis: RotationAxis) -> Mapping[str, Cloud]:
        """Return the selected clouds of a picture."""
        points, color = self._points.value, COLORS[self._color.value]
        found = clouds_of(picture, axis, len(self._integration.recording), points, color, self._look)
        if points == ALL:
            found[HELD] = self._all_views(axis, color)
        empty = points != SHAPE and not any(len(cloud.points_m) for cloud in found.values())
        self._hint.visible = empty
        if empty:
            overlay = picture.overlay
            agree = points == CONFLICTS and overlay is not None
            text = (
                f"Shape and proposal agree to {1000 * CONFLICT_M:.0f} mm everywhere."
                if agree
                else _HINTS[points]
            )
            self._hint.content = text
        return found

    def _all_views(self, axis: RotationAxis, color: str) -> Cloud:
        key = (axis.point_m.tobytes(), axis.direction.tobytes(), color == "source")
        with self._lock:
            if self._all is not None and self._all[0] == key:
                return self._all[1]
            if self._wanted != key:
                self._wanted = key
                self._worker.put(lambda: self._read(key, color))
        return NOTHING

    def _read(self, key: Any, color: str) -> None:
        cloud = all_views(self._integration, color)
        with self._lock:
            self._all, self._wanted = (key, cloud), None
        self._on_change()
