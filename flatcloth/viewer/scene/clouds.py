"""The points of the 3D scene and their colours."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import Bool, FlattenedView, Floats, RotationAxis, Uint8
from flatcloth.engine.integration import Integration
from flatcloth.rendering import layers
from flatcloth.rendering.colormaps import piece_color, view_colors
from flatcloth.rendering.layers import PLAIN, Appearance
from flatcloth.viewer.protocol.picture import Picture

MOST_POINTS = 60_000
"""More points are thinned. Chosen for the browser's speed."""
_HIGHLIGHT = np.array([255, 140, 0], dtype=np.float64)
"""Color of what is pointed at. Chosen."""
_BESIDE_M = 0.006
"""Points nearer than this are of the same cloth. Chosen: some pixels of the shape, and its noise."""
_GREY = 150.0
"""Grey of points that are not of interest. Chosen."""

LIVE, HELD, PROPOSAL, ALL = "/live/cloud", "/held/cloud", "/proposal/cloud", "/all/cloud"


@dataclass(frozen=True)
class Cloud:
    """Points (N, 3) in the object frame, colors (N, 3), and how large each is drawn."""

    points_m: Floats
    colors: Uint8
    size_m: float


NOTHING = Cloud(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.uint8), 0.0)
"""A cloud without points."""


def clouds_of(
    picture: Picture, axis: RotationAxis, n_views: int, color: str = "color", look: Appearance = PLAIN
) -> dict[str, Cloud]:
    """Return the clouds of a picture by the name of their node: present view, shape, what a proposal adds.

    Parameters
    ----------
    picture : Picture
        What is shown.
    axis, n_views
        Of the recording: for the colours.
    color, look
        A layer of the flattened view, and how it is displayed.
    """
    view, overlay, live = picture.view, picture.overlay, picture.cloud

    def cloud(of: FlattenedView, where: Bool, size_m: float) -> Cloud:
        if color == "color" and look == PLAIN:
            return Cloud(of.xyz_m[where], of.rgb[where], size_m)
        colors: Any = layers.rgba(of, color, axis, n_views, look, like=view)[where][:, :3]
        return Cloud(of.xyz_m[where], colors, size_m)

    held = _with_pieces(cloud(view, view.valid, 0.0018), picture, color)
    new = NOTHING
    if overlay is not None:
        new = cloud(overlay.view, overlay.new_points & overlay.view.valid, 0.0026)
        if color == "color":
            new = Cloud(new.points_m, (0.35 * new.colors + 0.65 * _HIGHLIGHT).astype(np.uint8), new.size_m)
    if picture.other is not None:
        held = _both(held, picture.other.view, cloud)
    # The view's own points have no layers: in grey they do not mix with those that have.
    shown = Cloud(live.xyz_m, dimmed(live.rgb, live.of_interest & (color == "color")), 0.0015)
    return {LIVE: shown if picture.sheet is None else _apart(shown, held), HELD: held, PROPOSAL: new}


def _apart(cloud: Cloud, of: Cloud) -> Cloud:
    """Return the points of a cloud that have none of another beside them: both together are confetti."""
    off, _ = cKDTree(of.points_m[:: max(1, len(of.points_m) // MOST_POINTS)]).query(
        cloud.points_m, distance_upper_bound=_BESIDE_M
    )
    alone = np.isinf(off)
    return Cloud(cloud.points_m[alone], cloud.colors[alone], cloud.size_m)


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
