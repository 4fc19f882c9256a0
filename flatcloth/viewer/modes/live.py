"""Live mode of the page: a recording is played, inspected and picked on, without decisions."""

from __future__ import annotations

import time
from dataclasses import replace

import msgspec
import numpy as np
from msgspec import structs

from flatcloth.core.errors import FlatclothError, IllegalDecisionError
from flatcloth.core.parcel import Parcel
from flatcloth.core.types import Floats
from flatcloth.engine.integration import Integration
from flatcloth.grasping.grasps import LOST_AT_M, pixel_of_point
from flatcloth.rendering import layers
from flatcloth.rendering.pictures import grid_of
from flatcloth.session.store import SessionFolder
from flatcloth.viewer.hub import Hub
from flatcloth.viewer.modes.controller import PageController
from flatcloth.viewer.modes.player import LiveLoop, Player, Playhead, Shown
from flatcloth.viewer.protocol import messages
from flatcloth.viewer.protocol.actions import IN_LIVE_MODE
from flatcloth.viewer.protocol.answers import FrameInfo
from flatcloth.viewer.protocol.picture import Picture
from flatcloth.viewer.protocol.sent import UV, Grid, Legend, encoded, typed
from flatcloth.viewer.protocol.snapshot import of_live
from flatcloth.viewer.protocol.state import LiveInfo, PageState
from flatcloth.viewer.scene.scene import Scene
from flatcloth.viewer.worker import Worker, attempt

DEFAULT_FPS = 30.0
"""Rate of a film without a recorded rate: that of a D435."""
STATE_INTERVAL_S = 0.25
"""Interval of updates of picks and numbers while playing; when paused they are immediate."""


class LiveApplication(PageController):
    """Plays a recording; :class:`flatcloth.viewer.modes.player.LiveLoop` is its thread.

    Parameters
    ----------
    integration, folder, scene_view, sink
        See :class:`flatcloth.viewer.modes.controller.PageController`.
    player : Player
        Flattens the frames.
    fps : float
        Initial frames per second.
    """

    def __init__(
        self,
        integration: Integration,
        folder: SessionFolder,
        scene_view: Scene,
        sink: Hub,
        player: Player,
        fps: float = DEFAULT_FPS,
    ) -> None:
        super().__init__(integration, folder, scene_view, sink)
        self._state_at_s = 0.0
        self._shown: Shown | None = None
        self._staged: Shown | None = None
        self._background = Worker("flatcloth-background")
        self._loop = LiveLoop(
            player,
            integration.recording.angles_deg,
            fps,
            prepare=self._prepare,
            deliver=self._deliver,
            report=lambda text: self._put(None, lambda: self._tell(None, "error", text)),
        )

    def start(self) -> None:
        """Start playing; without masks, the side of interest is found meanwhile."""
        self._put(None, self._begin)
        self._loop.start()
        if self._integration.views.sides is not None:
            self._background.put(self._find_sides)

    def _find_sides(self) -> None:
        """Find the side of interest in all views, with the session's strokes."""
        look = "Looking for the side of interest in all views; until then, the whole item is shown."
        self._put(None, lambda: self._tell(None, "info", look))
        strokes = self._folder.state.document.strokes
        masks = attempt(lambda: self._integration.views.segment(strokes), "finding the side of interest")
        if isinstance(masks, str):
            text = f"{masks} All of the item is shown."
            self._put(None, lambda: self._tell(None, "warning", text))
            return
        assert masks is not None
        found = masks.segmentation.text
        self._put(None, lambda: self._tell(None, "info", found))
        self._loop.again()

    def _prepare(self, frame: int) -> object:
        """Read a frame ahead, on a second thread."""
        return self._integration.views.cloud(frame)

    def stop(self) -> None:
        """Stop playing, and both threads."""
        self._loop.stop(timeout_s=5.0)
        self._front.stop(timeout_s=5.0)
        self._background.stop(timeout_s=2.0)

    def leave(self, client: int) -> None:
        """Handle the closing of a tab."""
        self._loop.leave(client)

    # --- the page's own thread ---------------------------------------------------------------

    def _begin(self) -> None:
        self._scene_view.follow(self._page_settings.now.follow)
        self._publish()

    def _take(self, client: int, message: messages.Message) -> None:
        match message:
            case messages.Ready(layer=layer):
                self._loop.ready(client, layer)
            case messages.Play():
                by_hand = message.frame is not None or message.step is not None
                if self._loop.head.playing and self._shown and (by_hand or message.playing is False):
                    # A frame flattened ahead must not appear after the pause.
                    self._loop.hold(self._shown.sequence)
                self._loop.change(lambda head: _changed(head, message))
                self._publish()
            case messages.PickAt(u_m=u, v_m=v, revision=revision):
                self._picks.add(self._held(revision), u, v)
                self._publish()
            case _:
                raise IllegalDecisionError(IN_LIVE_MODE)

    def _pick_on_ray(self, origin_m: Floats, direction: Floats) -> None:
        shown = self._shown
        points_m = self._scene_view.visible_points()
        if shown is not None and self._picks.add_on_ray(shown.picture, points_m, origin_m, direction):
            self._held(shown.sequence)
            self._publish()

    def _held(self, sequence: int | None) -> Picture:
        """Pause at the clicked frame, and return it."""
        if sequence is None and self._shown is not None:
            sequence = self._shown.sequence
        shown = self._loop.hold(sequence)
        if shown is None or shown.picture is None:
            raise FlatclothError("This frame shows no cloth to pick; go to another one.")
        self._shown, self.picture = shown, shown.picture
        return shown.picture

    def _page_state(self) -> PageState:
        head, shown = self._loop.head, self._shown
        live = LiveInfo(playing=head.playing, forward=head.forward, fps=head.fps)
        picture, frame = (None, None) if shown is None else (shown.picture, shown.frame)
        return self._state_of(picture, **of_live(self._integration.recording.angles_deg, live, frame))

    # --- the loop's threads ------------------------------------------------------------------

    def _deliver(self, shown: Shown, tabs: dict[int, str]) -> None:
        self._shown, self.picture = shown, shown.picture
        if shown is not self._staged:
            self._staged = shown
            self._put_on_stage(shown)
        frames = {layer: self._frame(shown, layer) for layer in set(tabs.values())}
        for client, layer in tabs.items():
            self._sink.send_frame(client, frames[layer])
        now_s = time.monotonic()
        if not self._loop.head.playing or now_s - self._state_at_s > STATE_INTERVAL_S:
            self._state_at_s = now_s
            self._put(None, self._publish)

    def _put_on_stage(self, shown: Shown) -> None:
        self._scene_view.play(shown.picture)

    def _frame(self, shown: Shown, layer: str) -> bytes:
        picture, integration = shown.picture, self._integration
        info = self._frame_info(shown, layer)
        if picture is None:
            return _parcel(info).pack()
        axis, angles_deg = integration.axis, integration.recording.angles_deg
        info = structs.replace(
            info,
            grid=Grid(**grid_of(picture.view)),
            area_cm2=picture.view.area_m2 * 1e4,
            legend=typed(layers.legend(picture.view, layer, axis, angles_deg), Legend),
            pick_uv_m=self._pick_uv_m(picture),
        )
        parcel, rgba = _parcel(info), layers.rgba(picture.view, layer, axis, len(angles_deg))
        parcel.picture("frame", layers.png(rgba), rgba.shape[:2])
        return parcel.pack()

    def _frame_info(self, shown: Shown, layer: str) -> FrameInfo:
        """Return the data sent with every frame, also with one that could not be flattened."""
        head = self._loop.head
        return FrameInfo(
            sequence=shown.sequence,
            view_index=shown.frame,
            angle_deg=shown.angle_deg,
            reason=shown.reason,
            flatten_ms=shown.flatten_ms,
            playing=head.playing,
            forward=head.forward,
            layer=layer,
        )

    def _pick_uv_m(self, picture: Picture) -> UV | None:
        current = self._picks.current
        if current is None or not picture.view.valid.any():
            return None
        rc, distance_m = pixel_of_point(picture.view, current.pick.position_held_m)
        if distance_m > LOST_AT_M:
            return None
        u_m, v_m = picture.view.uv_from_rc(np.array(rc)).tolist()
        return u_m, v_m


def _parcel(info: FrameInfo) -> Parcel:
    """Return what is sent with a frame; encoding makes NaN null."""
    return Parcel(msgspec.json.decode(encoded(info)))


def _changed(head: Playhead, wish: messages.Play) -> Playhead:
    if wish.fps is not None:
        head = replace(head, fps=wish.fps)
    if wish.forward is not None:
        head = head.turned(wish.forward)
    if wish.frame is not None or wish.step is not None:
        # Stepping by hand pauses the player.
        frame = head.frame if wish.frame is None else wish.frame
        head = replace(head.at(frame + (wish.step or 0)), playing=False)
    if wish.playing is not None:
        head = replace(head, playing=wish.playing)
    return head
