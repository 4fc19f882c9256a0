"""The page of a camera: its live cloud and flattened view, and the guided capture.

The camera's thread processes every frame; work that takes longer than a frame runs on the lanes of the page.
The newest frame is flattened, and sent as any picture, once a tab has drawn the one before: so a slow tab
misses frames, and nothing is queued. One lock protects the state of the capture.

A turntable or a robot announces the angles and reads the status over HTTP: ``GET /capture`` returns the
status; ``POST /capture/angle`` with ``{"angle_deg": 20.0}`` announces the item's present angle, since view 0.
``POST /capture/begin``, ``keep``, ``repeat`` and ``finish`` act like the buttons of the page. Every answer is
the status as JSON, or ``{"error": reason}`` with code 400 (malformed), 404 (no such address), 409 (not
allowed now) or 503 (the camera has ended).
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import msgspec
import numpy as np
from msgspec import structs
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route

from flatcloth.cameras import capture
from flatcloth.cameras.base import CameraError, CameraFrame
from flatcloth.cameras.capture import HOLD_S, Capture, Phase
from flatcloth.cameras.checks import check_frame
from flatcloth.cameras.feed import CameraFeed
from flatcloth.cameras.guided_capture import GuidedCapture, TakenView, writer_for
from flatcloth.checking.check import check_recording
from flatcloth.checking.findings import Check
from flatcloth.core.errors import FlatclothError, IllegalDecisionError
from flatcloth.core.types import Floats
from flatcloth.engine.integration import Integration
from flatcloth.engine.live import LiveFlattening, cloud_of
from flatcloth.recordings import open_recording
from flatcloth.rendering import layers
from flatcloth.rendering.colormaps import apply_table, color_table
from flatcloth.session.store import SessionFolder
from flatcloth.viewer import http
from flatcloth.viewer.hub import Hub
from flatcloth.viewer.modes.controller import PageController
from flatcloth.viewer.protocol import messages, sent
from flatcloth.viewer.protocol.actions import ONLY_A_CAMERA, Action, action_table
from flatcloth.viewer.protocol.picture import Frame, legends_of

if TYPE_CHECKING:
    from flatcloth.viewer.scene.scene import Scene

FRAMES_KEPT = 8
"""Number of past frames that a click may refer to."""
LONGEST_WAIT_S = 2.0
"""If no tab says for so long that it has drawn a frame, the next one is shown all the same. Chosen."""


LOOK_INTERVAL_S = 0.5
"""Interval of the checks of the image. Chosen."""
RATE_WINDOW_S = 1.0
"""Time over which the camera's rate is measured. Chosen."""
REFRAME_M = 0.15
"""If the item moves this far from the centre of the 3D view, the view is framed again."""

_NO_RECORDING = "A camera shows one frame only; open the captured recording with view."
_OF_RECORDINGS = ("teach", "export", "source_image", "source_mask", "source_states")
"""Actions that need a whole recording."""

CHECKED_VIEWS = 6
"""Views on disk after which a capture is checked: fewer pairs are no evidence. Chosen."""

_COMMANDS: dict[str, capture.Command] = {
    "keep": capture.keep,
    "repeat": capture.repeat,
    "turned": capture.turned,
    "finish": capture.finish,
}
_WANTED = 'Send {"angle_deg": 20.0}, and "keep": false if an operator decides.'
_HEARD = ("begin", "keep", "repeat", "finish")
"""Actions that a program may post, besides an angle."""


class _Announcement(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The body of ``POST /capture/angle``; without ``keep`` the view is kept automatically."""

    angle_deg: Annotated[float, msgspec.Meta(ge=-messages.MAX_ANGLE_DEG, le=messages.MAX_ANGLE_DEG)]
    keep: bool = True


@dataclass(frozen=True, kw_only=True)
class CaptureSettings:
    """Where and how views are captured; with ``resume`` an existing recording is continued."""

    folder: Path
    step_deg: float = 10.0
    frames: int = capture.FRAMES
    resume: bool = False


class CaptureApplication(PageController):
    """The page of a camera; see :class:`flatcloth.viewer.modes.controller.PageController`.

    Parameters
    ----------
    integration, folder, scene, tabs
        The integration is that of a :func:`flatcloth.engine.live.camera_recording`.
    feed : CameraFeed
        The camera; it is started and stopped with the page.
    settings : CaptureSettings
        The settings of the capture.
    """

    has_camera = True

    def __init__(
        self,
        integration: Integration,
        folder: SessionFolder,
        scene: Scene,
        tabs: Hub,
        feed: CameraFeed,
        settings: CaptureSettings,
    ) -> None:
        super().__init__(integration, folder, scene, tabs)
        self._feed, self._chosen = feed, settings
        self._flattening = LiveFlattening(integration, feed)
        self._frames: deque[Frame] = deque(maxlen=FRAMES_KEPT)
        self._playing, self._trouble = True, ""  # why the newest frame is not shown
        self._is_flattening, self._is_drawn, self._began_s = False, True, 0.0
        self._lock = threading.Lock()
        self._guided: GuidedCapture | None = None
        self._view_number = 0
        self.view_png = b""  # color and depth of the last view side by side; empty if there is none
        self._resume = settings.resume
        self._ended: str | None = None
        self._warnings: tuple[str, ...] = ()
        self._doubts: tuple[str, ...] = ()
        self._checked_views = 0
        self._came_s: deque[float] = deque()  # the frames of the last second
        self._camera_fps = 0.0
        self._looked_s = 0.0
        self._framed_at: np.ndarray[Any, Any] | None = None
        self._busy = threading.Event()
        feed.on_frame, feed.on_end = self._on_frame, self._on_end

    def start(self) -> None:
        """Start the camera."""
        self._feed.start()
        self._put(None, self._begin)

    def _begin(self) -> None:
        self.scene.arrange(self.settings.now)
        self.publish()

    def stop(self) -> None:
        """Stop the camera and all threads; kept views are on disk."""
        self._feed.stop(timeout_s=5.0)
        super().stop()
        with self._lock:
            if self._guided is not None:
                self._guided.close()

    # --- the camera's thread -------------------------------------------------------------------

    def _on_frame(self, frame: CameraFrame) -> None:
        now_s = time.monotonic()
        self._camera_fps = self._rate(now_s)
        changed = False
        with self._lock:
            if self._guided is not None:
                before = self._guided.state
                try:
                    self._guided.see(frame)
                except FlatclothError as error:
                    self._put(None, partial(self.tell, None, "error", str(error)))
                changed = self._note_view() or _place(before) != _place(self._guided.state)
                self._check_if_doubled(len(self._guided.state.kept_deg))
        self._put(None, self.publish if changed else self.report)
        self._put(None, self._show_newest)
        if not self._busy.is_set() and self._playing:
            self._busy.set()
            self.executor.put("scene", lambda: self._look(frame, now_s))

    def _rate(self, now_s: float) -> float:
        """Count a frame, and return the frames per second of the last second."""
        came_s = self._came_s
        came_s.append(now_s)
        while now_s - came_s[0] > RATE_WINDOW_S:
            came_s.popleft()
        span_s = now_s - came_s[0]
        return (len(came_s) - 1) / span_s if span_s > 0 else 0.0

    def _on_end(self, text: str) -> None:
        self._ended, self._playing = text, False
        self._put(None, lambda: self.tell(None, "error", text))

    # --- the lanes -------------------------------------------------------------------------------------

    def _look(self, frame: CameraFrame, now_s: float) -> None:
        """Draw the cloud, and check the view from time to time."""
        try:
            view = frame.rgbd(self._feed.camera)
            points, colors = cloud_of(view)
            reset_view = False
            if now_s - self._looked_s >= LOOK_INTERVAL_S:
                self._looked_s = now_s
                self._warnings = check_frame(view).warnings
                center = np.median(points, axis=0) if len(points) else None
                if center is not None:
                    gone = self._framed_at is None or np.linalg.norm(center - self._framed_at) > REFRAME_M
                    reset_view = bool(gone and self.settings.now.follow)
                    self._framed_at = center if reset_view or self._framed_at is None else self._framed_at
            self.scene.see(points, colors, anew=reset_view)
        finally:
            self._busy.clear()

    def _check_if_doubled(self, kept: int) -> None:
        """Check the views on disk once there are enough, and again whenever they have doubled."""
        if kept >= max(CHECKED_VIEWS, 2 * self._checked_views):
            self._checked_views = kept
            folder = str(self._chosen.folder)
            self.executor.compute(
                "work", lambda: check_recording(open_recording(folder)), self._checked, "checking"
            )

    def _checked(self, found: Check | str) -> None:
        if isinstance(found, str):
            self.tell(None, "warning", found)
        else:
            self._doubts = tuple(finding.line for finding in found.findings if finding.stops)
            self.publish()

    # --- the web server's threads ---------------------------------------------------------------

    def routes(self) -> list[BaseRoute]:
        """Return the routes of a guided capture."""

        def view(_request: Request) -> bytes:
            if not self.view_png:
                raise http.RefusedError("No view has been taken yet.", 404)
            return self.view_png

        def done(
            action: str, angle_deg: float | None = None, keeps_itself: bool = False
        ) -> sent.CaptureStatus:
            self.act(action, angle_deg, keeps_itself)
            self._put(None, self.publish)
            return self.status()

        def hear(request: Request) -> Response:  # on a thread
            word = request.path_params["action"]
            if word not in _HEARD:
                known = ", ".join(("angle", *_HEARD))
                raise http.RefusedError(f"Unknown address /capture/{word:.40}; choose one of {known}.", 404)
            return http.as_json(request, done(word))

        def announce(_request: Request, said: _Announcement) -> sent.CaptureStatus:
            return done("announce", said.angle_deg, said.keep)

        return [
            http.get("/capture", lambda _: self.status()),
            http.get("/capture/view.png", view),
            http.post("/capture/angle", _Announcement, announce, hint=_WANTED),
            Route("/capture/{action}", hear, methods=["POST"]),
        ]

    # --- frames ----------------------------------------------------------------------------------

    def _show_newest(self) -> None:
        """Flatten the newest frame if the picture follows the camera, and a tab has drawn the one before."""
        now_s = time.monotonic()
        is_wanted = self._is_drawn or now_s - self._began_s > LONGEST_WAIT_S
        if self._playing and is_wanted and not self._is_flattening:
            self._is_flattening, self._is_drawn, self._began_s = True, False, now_s
            self.executor.compute("frames", self._flattened_newest, self._flattened, "showing the camera")

    def _flattened_newest(self) -> Frame | FlatclothError:
        try:
            view = self._flattening.newest()
        except FlatclothError as error:
            return error  # the next frame may show more
        revision = self._frames[-1].revision + 1 if self._frames else 1
        return Frame(revision=revision, view=view, legends=legends_of(view, self.integration))

    def _flattened(self, made: Frame | FlatclothError | str) -> None:
        self._is_flattening = False
        if not self._playing:
            return  # an earlier frame is held since
        if isinstance(made, Frame):
            self._frames.append(made)
            self.picture, self._trouble = made, ""
            self.publish()
        else:
            self.picture, self._trouble, self._is_drawn = None, str(made), True
            self._playing = not isinstance(made, str)
            self.report(self._trouble)

    # --- commands ------------------------------------------------------------------------------

    def _take(self, client: int, message: messages.Message) -> None:
        match message:
            case messages.Capture(action=action, angle_deg=angle_deg):
                self.act(action, angle_deg)
                self.publish()
            case messages.Play(playing=playing):
                self._playing = self._is_drawn = playing
                self._show_newest()
                self.publish()
            case messages.Drawn(revision=revision):
                self._is_drawn |= self.picture is not None and self.picture.revision == revision
                self._show_newest()
            case messages.PickAt(u_m=u, v_m=v, revision=revision):
                self._picks.add(self._held(revision), u, v)
                self.publish()
            case _:
                raise IllegalDecisionError(ONLY_A_CAMERA)

    def _pick_on_ray(self, origin_m: Floats, direction: Floats) -> None:
        picture, points_m = self.picture, self.scene.visible_points()
        if picture is not None and self._picks.add_on_ray(picture, points_m, origin_m, direction):
            self._held(picture.revision)
            self.publish()

    def _held(self, revision: int | None) -> Frame:
        """Hold the frame that was clicked, or the last one, and return it."""
        self._playing = False
        self.picture = next((each for each in self._frames if each.revision == revision), self.picture)
        if self.picture is None:
            raise FlatclothError("This frame shows no cloth to pick; wait for the next one.")
        return self.picture

    def act(self, action: str, angle_deg: float | None = None, keeps_itself: bool = False) -> None:
        """Execute an action of the operator or of a program; may be called from any thread.

        Parameters
        ----------
        action : str
            ``begin``, ``keep``, ``repeat``, ``turned``, ``aim``, ``announce`` or ``finish``.
        angle_deg : float, optional
            For ``aim`` and ``announce``.
        keeps_itself : bool
            For ``announce``: keep the view without the operator.

        Raises
        ------
        FlatclothError
            If it is not allowed now, or fails; the message gives the reason.
        """
        angle = math.nan if angle_deg is None else angle_deg
        with self._lock:
            if self._ended is not None and action != "finish":
                raise CameraError(self._ended)
            if action == "begin" or (action == "announce" and self._guided is None):
                self._begin_capture()
            guided = self._guided
            if guided is None:
                raise IllegalDecisionError("No capture is running; start one first.")
            match action:
                case "begin":
                    return
                case "keep":
                    guided.keep()
                case "aim":
                    guided.do(lambda state: capture.aim(state, angle))
                case "announce":
                    guided.do(lambda state: capture.announce(state, angle, keeps_itself))
                case _:
                    guided.do(_COMMANDS[action])
            self._note_view()
            if guided.state.phase is Phase.DONE:
                guided.close()

    def _begin_capture(self) -> None:
        guided, chosen, camera = self._guided, self._chosen, self._feed.camera
        if guided is not None and guided.state.phase is not Phase.DONE:
            raise IllegalDecisionError("A capture is running; finish it first.")
        folder = chosen.folder
        self._guided = GuidedCapture(
            camera,
            lambda: writer_for(camera, str(folder), folder.name, self._resume),
            chosen.step_deg,
            chosen.frames,
        )
        self._resume = True  # a new start after an end continues the same recording

    def _note_view(self) -> bool:
        """Give a new view its number and its picture; return whether there is a new one."""
        taken = None if self._guided is None else self._guided.taken
        if taken is None or taken is self._last_taken:
            return False
        self._last_taken = taken
        self._view_number += 1
        self.view_png = _picture(taken)
        return True

    _last_taken: TakenView | None = None

    # --- the state --------------------------------------------------------------------------

    def status(self) -> sent.CaptureStatus:
        """Return the status of the capture."""
        with self._lock:
            guided, state = self._guided, Capture(step_deg=0.0)
            taken = view = None
            phase = "idle"
            if guided is not None:
                state, taken = guided.state, guided.taken
                phase = state.phase.value
            if taken is not None:
                view = sent.CapturedView(
                    number=self._view_number,
                    angle_deg=state.target_deg,
                    frames=taken.frames,
                    noise_mm=round(taken.noise_mm, 2),
                    warnings=tuple(taken.warnings),
                )
            return sent.CaptureStatus(
                camera=self._feed.camera.name,
                camera_fps=round(self._camera_fps, 1),
                playing=self._playing,
                ended=self._ended,
                warnings=(*self._warnings, *self._doubts),
                folder=str(self._chosen.folder),
                phase=phase,
                step_deg=self._chosen.step_deg,
                hold_s=HOLD_S,
                frames=self._chosen.frames,
                target_deg=state.target_deg,
                turn_by_deg=state.turn_by_deg,
                taken=state.taken,
                still_s=round(state.still_s, 2),
                speed_px_s=None if state.speed_px_s is None else round(state.speed_px_s, 1),
                announced=state.announced,
                kept_deg=tuple(state.kept_deg),
                view=view,
            )

    def _fields(self) -> dict[str, Any]:
        status = self.status()
        kept = tuple(
            sent.ViewRow(index=i, angle_deg=angle, state="accepted", why_not="It is on disk.")
            for i, angle in enumerate(status.kept_deg)
        )
        fields = super()._fields()
        return {
            **fields,
            "recording": structs.replace(fields["recording"], n_views=len(kept)),
            "mode": "camera",
            "phase": "camera",
            "capture": status,
            "trouble": self._trouble,
            "views": kept,
            "present_view": None,
            "angle_deg": None,
            "actions": tuple(map(self._allowed, action_table(None))),
        }

    def _allowed(self, action: Action) -> Action:
        """Return an action with the reason why it is not allowed now."""
        command = _COMMANDS.get(action.name.removeprefix("capture_"))
        if command is None:
            why = _NO_RECORDING if action.name in _OF_RECORDINGS else action.why_not
            return structs.replace(action, why_not=why)
        try:
            command(Capture(step_deg=0.0) if self._guided is None else self._guided.state)
        except IllegalDecisionError as error:
            return structs.replace(action, why_not=str(error))
        return structs.replace(action, why_not=None)


def _place(state: Capture) -> tuple[Phase, int, float]:
    return state.phase, len(state.kept_deg), state.target_deg


def _picture(view: TakenView) -> bytes:
    """Return color and depth side by side as PNG; pixels without depth are grey."""
    depth = view.depth_m
    measured = depth > 0
    low, high = np.percentile(depth[measured], [1, 90]) if measured.any() else (0.0, 1.0)
    shaded = apply_table(color_table("sequential"), -depth, -float(high), -float(low))
    shaded[~measured] = 128
    both = np.concatenate([view.color, shaded], axis=1)
    opaque = np.full((*both.shape[:2], 1), 255, dtype=np.uint8)
    return layers.png(np.concatenate([both, opaque], axis=2))
