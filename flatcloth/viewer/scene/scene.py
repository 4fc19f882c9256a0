"""The 3D scene: the item in the object frame, with the camera, the axis and the proposal.

Picks are not part of it: the page draws them over it (static/page/scene_marks.js). So a pick is seen at once,
and the scene, which may be drawn without a graphics card, is not drawn again for it.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial import cKDTree

from flatcloth.core.errors import FlatclothError, ServerError
from flatcloth.core.geometry import object_from_camera
from flatcloth.core.types import Bool, FlattenedView, Float32, Float64, Floats, RotationAxis, Uint8
from flatcloth.engine.integration import Integration
from flatcloth.grasping.grasps import quaternion_wxyz
from flatcloth.rendering import layers
from flatcloth.rendering.colormaps import piece_color, view_colors
from flatcloth.viewer.protocol.picture import Picture
from flatcloth.viewer.protocol.settings import Settings

if TYPE_CHECKING:
    import viser

    from flatcloth.viewer.scene.private_viser import PrivateViser

MOST_POINTS = 60_000
"""More points are thinned. Chosen for the browser's speed."""
_HIGHLIGHT = np.array([30, 130, 255], dtype=np.float64)
"""Color of what a proposal adds. Chosen: the page's accent, as amber is for doubt."""
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


def clouds_of(picture: Picture, axis: RotationAxis, n_views: int, color: str = "color") -> dict[str, Cloud]:
    """Return the clouds of a picture by the name of their node: present view, shape, what a proposal adds.

    Parameters
    ----------
    picture : Picture
        What is shown.
    axis, n_views
        Of the recording: for the colours.
    color
        A layer of the flattened view.
    """
    view, overlay, live = picture.view, picture.overlay, picture.cloud

    def cloud(of: FlattenedView, where: Bool, size_m: float) -> Cloud:
        if color == "color":
            return Cloud(of.xyz_m[where], of.rgb[where], size_m)
        colors: Any = layers.rgba(of, color, axis, n_views, like=view)[where][:, :3]
        return Cloud(of.xyz_m[where], colors, size_m)

    held = _with_pieces(cloud(view, view.valid, 0.0018), picture, color)
    new = NOTHING
    if overlay is not None:
        new = cloud(overlay.view, overlay.new_points & overlay.view.valid, 0.0026)
        if color == "color":
            new = Cloud(new.points_m, (0.35 * new.colors + 0.65 * _HIGHLIGHT).astype(np.uint8), new.size_m)
    if picture.other is not None:
        its = cloud(picture.other.view, picture.other.view.valid, held.size_m)
        points = np.concatenate([held.points_m, its.points_m])
        held = Cloud(points, np.concatenate([held.colors, its.colors]), held.size_m)
    # The view's own points have no layers: in grey they do not mix with those that have.
    grey = (0.25 * live.rgb + 0.75 * _GREY).astype(np.uint8)
    is_own = live.of_interest & (color == "color")
    shown = Cloud(live.xyz_m, np.where(is_own[:, None], live.rgb, grey), 0.0015)
    return {LIVE: _apart(shown, held), HELD: held, PROPOSAL: new}


def _apart(cloud: Cloud, of: Cloud) -> Cloud:
    """Return the points of a cloud that have none of another beside them: both together are confetti."""
    off, _ = cKDTree(of.points_m[:: max(1, len(of.points_m) // MOST_POINTS)]).query(
        cloud.points_m, distance_upper_bound=_BESIDE_M
    )
    alone = np.isinf(off)
    return Cloud(cloud.points_m[alone], cloud.colors[alone], cloud.size_m)


def _with_pieces(cloud: Cloud, picture: Picture, color: str) -> Cloud:
    """Tint the points of floating pieces in the colours that the flattened view marks them with."""
    if not picture.sheet.pieces or color != "color":
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


FRAME_MARGIN = 1.15
"""Share of the window that the item fills, inverted. Chosen."""


class Scene:
    """Owns a viser server that only this process reaches, at ``path``; methods may be called from any thread.

    viser is loaded, and its server begins, when something is shown, or ``path`` is asked for.

    Parameters
    ----------
    integration : Integration
        Has the turning axis, the real camera, and all views.

    What takes long is given to ``in_background``; ``on_ray`` gets the clicks.
    """

    def __init__(self, integration: Integration) -> None:
        self._axis = integration.axis
        self._recording = integration.recording  # that of an active loop grows
        self._integration = integration
        self._all: tuple[Hashable, Cloud] = None, NOTHING  # all views, and what their points depend on
        self._color = "color"
        self._axis_span_m = (-0.5, 0.5)
        self._picture: Picture | None = None
        self._lock = threading.RLock()
        self._clouds: dict[str, viser.PointCloudHandle] = {}
        self._points: dict[str, Float32] = {}
        self._hidden = {ALL}
        self._shown: int | None = None  # the present view
        self._view_from: tuple[Float64, Float64, float, float] | None = None
        self._follow = True
        self._viser: PrivateViser | None = None
        self._is_closed = False
        self.on_ray: Callable[[tuple[float, ...], tuple[float, ...]], None] = lambda _o, _d: None
        self.in_background: Callable[[Callable[[], None]], object] = lambda job: job()

    @property
    def path(self) -> Path:
        """The socket file of its server."""
        return self._opened.path

    @property
    def _server(self) -> viser.ViserServer:
        return self._opened.server

    @property
    def _opened(self) -> PrivateViser:
        from flatcloth.viewer.scene.private_viser import PrivateViser

        with self._lock:
            if self._viser is None:
                if self._is_closed:
                    raise ServerError("The 3D scene is closed.")
                self._viser = PrivateViser()
                self._build(self._viser.server)
            return self._viser

    def _build(self, server: viser.ViserServer) -> None:
        intrinsics = self._recording.intrinsics
        server.gui.configure_theme(show_logo=False, show_share_button=False)
        server.scene.set_up_direction("-y")
        self._frustum = server.scene.add_camera_frustum(
            "/camera",
            fov=2 * float(np.arctan(intrinsics.height / 2 / intrinsics.fy)),
            aspect=intrinsics.width / intrinsics.height,
            scale=0.06,
            color=(59, 130, 196),
            thickness=1.5,
            thickness_units="screen",
        )
        self._axis_line = server.scene.add_line_segments(
            "/axis", self._axis_points(), (140, 140, 140), thickness=1.5, thickness_units="screen"
        )

        @server.scene.on_click()
        def _(event: viser.SceneClickEvent) -> None:
            self.on_ray(event.ray_origin, event.ray_direction)

        self._arrange_lines()

        @server.on_client_connect
        def _(client: viser.ClientHandle) -> None:
            self._aim(client)

    def stop(self) -> None:
        """Close the viser server."""
        with self._lock:
            self._is_closed, opened = True, self._viser
        if opened is not None:
            opened.stop()

    def visible_points(self) -> Float32:
        """Return the points (N, 3) of all visible clouds."""
        with self._lock:
            seen = [p for name, p in self._points.items() if self._is_visible(name)]
        return np.concatenate(seen) if seen else np.zeros((0, 3), dtype=np.float32)

    def show(self, picture: Picture | None) -> None:
        """Show a document, or an empty scene."""
        with self._lock, self._server.atomic():
            self._show(picture)
        self._server.flush()

    def see(self, points_m: Float32, colors: Uint8, *, anew: bool) -> None:
        """Show the cloud of a camera in its own frame; ``anew`` resets the view to show all of it."""
        with self._lock, self._server.atomic():
            self._fill(LIVE, Cloud(points_m, colors, 0.0022))
            if len(points_m) and (anew or self._view_from is None):
                self._shown = None
                self._frame_view(0.0, 0)
        self._server.flush()

    def _show(self, picture: Picture | None) -> None:
        self._picture = picture
        if picture is None:
            for name in self._clouds:
                self._fill(name, NOTHING)
            self._shown = None
            return
        if LIVE in self._points:  # what was seen before there was a picture
            self._fill(LIVE, NOTHING)
        shown = clouds_of(picture, self._axis, len(self._recording), self._color)
        shown[ALL] = NOTHING if ALL in self._hidden else self._of_all_views()
        for name, cloud in shown.items():
            self._fill(name, cloud)
        self._frame_view(picture.angle_deg, picture.present_view)

    def arrange(self, settings: Settings) -> None:
        """Show what is wanted; let the cameras go to the real camera's position at each new view, or not."""
        wanted = {
            LIVE: settings.show_view,
            HELD: settings.show_shape,
            PROPOSAL: settings.show_new,
            ALL: settings.show_all,
            "/axis": settings.show_axis,
            # From where the camera stood, its frustum is a frame around everything.
            "/camera": settings.show_camera and not settings.follow,
        }
        with self._lock:
            self._hidden = {node for node, on in wanted.items() if not on}
            begins, self._follow = settings.follow and not self._follow, settings.follow
            if self._viser is None:
                return
            with self._server.atomic():
                if settings.show_all and ALL not in self._points and self._picture is not None:
                    self._fill(ALL, self._of_all_views())
                for name, cloud in self._clouds.items():
                    cloud.visible = self._is_visible(name)
                self._arrange_lines()
        self._server.flush()
        if begins:
            self._aim_all()

    def _arrange_lines(self) -> None:
        self._frustum.visible, self._axis_line.visible = (n not in self._hidden for n in ("/camera", "/axis"))

    def look_from(self, angle_deg: float) -> None:
        """Let all cameras look from where the real camera stood at an angle, the item in the middle."""
        with self._lock:
            if self._view_from is None:
                return
            eye_m = object_from_camera(self._axis, angle_deg).translation_m
            self._view_from = (self._view_from[0], eye_m, *self._view_from[2:])
        self._aim_all()

    def _fill(self, name: str, cloud: Cloud) -> None:
        count = len(cloud.points_m)
        self._points.pop(name, None)
        if count:
            keep: Any = slice(None)
            if count > MOST_POINTS:
                keep = np.linspace(0, count - 1, MOST_POINTS).astype(np.intp)
            points, shades = cloud.points_m[keep].astype(np.float32), cloud.colors[keep]
            self._points[name] = points
            if name in self._clouds:
                self._clouds[name].points = points
                self._clouds[name].colors = shades
            else:
                self._clouds[name] = self._server.scene.add_point_cloud(
                    name, points, shades, point_size=cloud.size_m, point_shape="circle",
                    precision="float32", point_shading="flat",
                )  # fmt: skip
        if name in self._clouds:
            self._clouds[name].visible = self._is_visible(name)

    def _of_all_views(self) -> Cloud:
        """Return the points of all views, in color or by view; none while they are being read."""
        axis, color = self._axis, self._color
        key = axis.point_m.tobytes(), axis.direction.tobytes(), color == "source"

        def read() -> None:
            cloud = all_views(self._integration, color)
            with self._lock:
                if self._all[0] == key:
                    self._all = key, cloud
            self._show_again()

        if self._all[0] != key:
            self._all = key, NOTHING
            self.in_background(read)
        return self._all[1]

    def _is_visible(self, name: str) -> bool:
        return name in self._points and name not in self._hidden

    def _frame_view(self, angle_deg: float, present_view: int) -> None:
        held = object_from_camera(self._axis, angle_deg)
        self._frustum.position = held.translation_m
        self._frustum.wxyz = quaternion_wxyz(held.rotation)
        clouds = [self._points[n] for n in (LIVE, HELD) if n in self._points]
        if not clouds:
            return
        points = np.concatenate(clouds)
        along = (points - self._axis.point_m) @ self._axis.direction
        self._axis_span_m = (float(along.min()) - 0.05, float(along.max()) + 0.08)
        ends: Any = self._axis_points()
        self._axis_line.points = ends
        center = (np.percentile(points, 1, axis=0) + np.percentile(points, 99, axis=0)) / 2
        offset = np.abs(points - center)
        half_height = float(np.percentile(offset[:, 1], 99.5))
        half_width = float(np.percentile(np.hypot(offset[:, 0], offset[:, 2]), 99.5))
        self._view_from = (center, held.translation_m, half_width, half_height)
        first = self._shown is None
        turned = self._shown is not None and self._shown != present_view
        self._shown = present_view
        initial = self._server.initial_camera
        initial.fov, initial.position = self._fov_rad(1.0), held.translation_m
        initial.look_at = center
        if first or (turned and self._follow):
            self._aim_all()

    def _fov_rad(self, aspect: float) -> float:
        """Return the vertical field of view that contains the whole item from the camera's position."""
        assert self._view_from is not None
        center, camera, half_width, half_height = self._view_from
        distance = max(float(np.linalg.norm(camera - center)) - half_width, 0.05)
        aspect = aspect if math.isfinite(aspect) else 1.0  # viser passes on any value of a browser
        tangent = FRAME_MARGIN * max(half_height, half_width / max(aspect, 0.2)) / distance
        return float(np.clip(2 * np.arctan(tangent), 0.2, 2.2))

    def _aim_all(self) -> None:
        for client in self._server.get_clients().values():
            self._aim(client)

    def _aim(self, client: viser.ClientHandle) -> None:
        if self._view_from is None:
            return
        with client.atomic():
            client.camera.fov = self._fov_rad(client.camera.aspect)
            client.camera.position = self._view_from[1]
            client.camera.look_at = self._view_from[0]
        client.flush()

    def color_by(self, layer: str) -> None:
        """Colour the shape and the proposal by a layer of the flattened view."""
        if layer != self._color:
            self._color = layer
            self._show_again()

    def _show_again(self) -> None:
        with self._lock, self._server.atomic():
            if self._picture is not None:
                self._show(self._picture)
        self._server.flush()

    def _axis_points(self) -> Float64:
        axis = self._axis
        return np.array([[axis.point_m + x * axis.direction for x in self._axis_span_m]])
