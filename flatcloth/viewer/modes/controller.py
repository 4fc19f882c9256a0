"""The common part of all modes: one thread that owns the state, the picks, and the messages to the tabs.

Sockets, viser's callbacks and workers only put jobs into the thread's queue; only the thread changes picks
and messages. Data read by other threads (the picture) are immutable.
"""

from __future__ import annotations

import itertools
import logging
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from starlette.requests import Request
from starlette.routing import BaseRoute, Route

from flatcloth.core.errors import FlatclothError, IllegalDecisionError
from flatcloth.core.geometry import Rigid3
from flatcloth.core.types import Floats
from flatcloth.engine.garment import GarmentService
from flatcloth.engine.integration import Integration
from flatcloth.grasping.grasps import Grip
from flatcloth.grasping.measuring import measure
from flatcloth.session.journal import Pick, SheetSide
from flatcloth.session.store import SessionFolder
from flatcloth.viewer.http import RefusedError, get
from flatcloth.viewer.hub import Hub
from flatcloth.viewer.protocol import messages, sent
from flatcloth.viewer.protocol.actions import REJECT_REASONS
from flatcloth.viewer.protocol.picks import PickStore, faces_away, hit_by
from flatcloth.viewer.protocol.picture import Frame, Picture, described, layers_of
from flatcloth.viewer.protocol.sent import UV, AutoInfo
from flatcloth.viewer.protocol.settings import Settings, SettingsStore
from flatcloth.viewer.worker import Background, Executor, Worker, result_of

if TYPE_CHECKING:  # viser is loaded with the first source, and not at all for a robot without a page
    from flatcloth.viewer.scene.scene import Scene

_log = logging.getLogger(__name__)

T = TypeVar("T")

MOST_WAITING = 200
"""Most messages in the queue of the page's thread. Chosen: no operator is faster; it bounds memory."""
ANSWER_S = 30.0
"""Longest time that a program waits for the page's thread. Chosen: above the time limits of HTTP clients."""
PROGRESS_INTERVAL_S = 0.2
"""Interval between states of which only the progress is new. Chosen: each takes some milliseconds."""
MESSAGES_KEPT = 100
"""Number of recent messages that a newly opened tab receives. Chosen."""


class PageController(ABC):
    """The part of a page's application that does not depend on its mode.

    Parameters
    ----------
    integration : Integration
        Data source of the page.
    folder : SessionFolder
        Stores the picks.
    scene, tabs
        The 3D side and the tabs.
    """

    has_camera = False

    def __init__(self, integration: Integration, folder: SessionFolder, scene: Scene, tabs: Hub) -> None:
        self.integration, self.folder, self.scene, self.tabs = integration, folder, scene, tabs
        self.settings = SettingsStore(folder.folder, Settings(auto_threshold=integration.accept_score))
        self._auto = AutoInfo()
        self._log: tuple[sent.Note, ...] = ()
        self._picks = PickStore(folder, integration, self._highlight)
        self.garments = GarmentService(integration)
        self.picture: Frame | None = None  # what is shown at present; immutable
        self.lesson: sent.Progress | None = None  # how far one is that is being made
        self.base_from_camera: Rigid3 | None = None  # with it, poses are also in the frame of the robot
        self._note_ids = itertools.count(1)
        self._questions: dict[tuple[int, type[messages.Said]], Background] = {}  # the last one of each tab
        self._revision, self._published_at_s, self._reported = 0, 0.0, ""
        self.last_state: sent.PageState | None = None  # what was sent last
        self._front = Worker("flatcloth-session")
        self.executor = Executor(partial(self._put, None))
        scene.in_background = partial(self.executor.put, "clouds")

    # --- from any thread ---------------------------------------------------------------------

    @property
    def is_swamped(self) -> bool:
        """Whether the queue of messages is too long to accept more."""
        return self._front.waiting >= MOST_WAITING

    @property
    def picks(self) -> tuple[Pick, ...]:
        """The list of picks."""
        return self._picks.picks

    @property
    def grips(self) -> Mapping[int, Grip]:
        """The grips of picks for which the operator chose one."""
        return self._picks.book.grips

    def routes(self) -> list[BaseRoute]:
        """Return the routes of this mode."""
        return []

    def of_view(self, path: str, make: Callable[[Request, int], Any], **options: Any) -> Route:
        """Return a route (:func:`flatcloth.viewer.http.get`) of each ``{view}`` of the recording."""

        def made(request: Request) -> Any:
            view = int(request.path_params["view"])
            if view >= len(self.integration.recording):
                raise RefusedError(f"View {view} does not exist.", 404)
            return make(request, view)

        return get(path, made, **options)

    @abstractmethod
    def start(self) -> None:
        """Start showing."""

    def stop(self) -> None:
        """Stop all threads."""
        self._front.stop(timeout_s=5.0)
        self.executor.stop()

    def receive(self, client: int, message: messages.Message | messages.MessageError) -> None:
        """Process a message of a tab, or what is wrong with it; errors are returned as notifications."""
        self._put(client, lambda: self._receive(client, message))

    def click_ray(self, origin_m: tuple[float, ...], direction: tuple[float, ...]) -> None:
        """Process a click in the 3D scene, unless too many wait."""
        if self.is_swamped:
            return
        self._put(None, lambda: self._pick_on_ray(np.array(origin_m), np.array(direction)))

    def pointed_at(self, hover: messages.Hover | messages.HoverRay) -> sent.HoverAnswer | sent.RayAnswer:
        """Describe what is under the pointer; fast, because it only reads the present picture."""
        if isinstance(hover, messages.HoverRay):
            return hit_by(self.picture, self.scene.visible_points(), hover)
        return described(self.picture, self.integration, hover)

    def grasps(self, rotation_deg: float | None = None, *, with_garment: bool = True) -> dict[str, Any]:
        """Return the list of picks as it is exported, with the seen points of the garment if wanted.

        ``rotation_deg`` is the rotation of the item for the poses, by default that of the shown view.

        Raises
        ------
        FlatclothError
            If nothing is flattened yet.
        """
        from flatcloth.export.data import GraspFrames, grasps_document

        picture = self.picture
        if picture is None:
            raise FlatclothError("Nothing is flattened yet, so there are no grasp points to export.")
        frames = GraspFrames(
            axis=self.integration.axis,
            rotation_deg=picture.angle_deg if rotation_deg is None else rotation_deg,
            grips=self.grips,
            base_from_camera=self.base_from_camera,
        )
        named = self.named_points() if with_garment else ()
        view, *floating = picture.pieces("this")
        return grasps_document(view, self._picks.picks, frames, named, floating, picture.pieces("other"))

    def named_points(self) -> Sequence[Pick]:
        """Return the named points of the garment that were seen, as grasps; may take a second."""
        from flatcloth.export.garment import named_points

        picture = self.picture
        if not isinstance(picture, Picture):
            return ()
        known, other = self.garments.known(picture.document), picture.other
        return named_points(known, None if other is None else other.sides)

    def propose_pick(self, place: tuple[float, ...], name: str = "", revision: int | None = None) -> int:
        """Add a pick of a program and return its number, when it is stored; from any other thread.

        ``place`` is (u, v) on the plane of the shape, or (x, y, z) in the object frame, metres.

        Raises
        ------
        FlatclothError
            If no cloth of the shown shape is near, or its revision is not ``revision``.
        """

        def add() -> int:
            pick = self._picks.add_near(self.picture, place, name, revision)
            self.tell(None, "info", f"A program picked {pick.name}.")
            return pick.id

        return self.answered(add)

    def answered(self, job: Callable[[], T]) -> T:
        """Run a job on the page's own thread, and return its result; from any other thread.

        Raises
        ------
        FlatclothError
            If the job does, or the page is not ready for it within 30 seconds.
        """
        if self.is_swamped:
            raise FlatclothError("The page has too much to do; ask again in a moment.")
        return result_of(self._front.put(job), ANSWER_S)

    # --- the page's own thread ---------------------------------------------------------------

    def _put(self, client: int | None, job: Callable[[], None]) -> None:
        self._front.put(lambda: self._guarded(client, job))

    def _guarded(self, client: int | None, job: Callable[[], None]) -> None:
        try:
            job()
        except IllegalDecisionError as error:
            self.tell(client, "warning", str(error))
        except FlatclothError as error:
            _log.warning("%s", error)
            self.tell(client, "error", str(error))
        except BaseException as error:  # noqa: BLE001 - reported and logged
            _log.exception("a command failed")
            self.tell(client, "error", f"Unexpected error: {error!r:.300}. See the terminal.")
        for text in self.folder.take_notices():
            self.tell(None, "warning", text)

    def draw_again(self) -> None:  # noqa: B027 - frames of a camera are drawn again anyway
        """Draw the shown document again: it is shown otherwise by what is known now."""

    def _receive(self, client: int, message: messages.Message | messages.MessageError) -> None:
        match message:
            case messages.MessageError():
                raise message
            case messages.ShowPick(id=pick_id, keep=keep):
                self._picks.show(pick_id, keep=keep)
                self._turn_to_pick()
                self.publish()
            case messages.RenamePick(id=pick_id, name=name):
                self._picks.rename(pick_id, name.strip())
                self.publish()
            case messages.DeletePick(id=pick_id):
                self._picks.delete(pick_id)
                self.publish()
            case messages.SetGrip():
                self._picks.grip(self.picture, message)
                self.publish()
            case messages.Set(values=values, reset=reset):
                self.settings.change(values, reset=reset)
                self.scene.arrange(self.settings.now)
                self.publish()
            case messages.TurnTo(view_index=view):
                self._turn_to(view)
            case messages.Look(layer=layer):
                self.scene.color_by(layer)
            case messages.Measure():
                self.tabs.tell(client, self._measured(message))
            case _:
                self._take(client, message)

    def _pick_at(self, u_m: float, v_m: float, name: str = "", side: SheetSide = "this") -> None:
        self._picks.add(self.picture, u_m, v_m, name=name, side=side)
        self._turn_to_pick()
        self.publish()

    def _highlight(self, pick: Pick, uv_m: UV) -> None:
        """Let the tabs mark a new pick immediately, before its numbers and the scene are updated."""
        x, y, z = map(float, pick.position_held_m)
        self.tabs.tell(None, sent.Picked(id=pick.id, position_held_m=(x, y, z), side=pick.side, uv_m=uv_m))

    def _turn_to(self, view_index: int) -> None:
        angles_deg = self.integration.recording.angles_deg
        if not 0 <= view_index < len(angles_deg):
            raise FlatclothError(f"The recording has no view {view_index}.")
        self.scene.look_from(angles_deg[view_index])

    def _turn_to_pick(self) -> None:
        """Turn the camera to a view that saw the current pick, if the pick faces away from it now."""
        current, picture = self._picks.current, self.picture
        if current is None or picture is None:
            return
        if faces_away(current, self.integration.axis, picture.angle_deg):
            self._turn_to(current.view_index)

    def _measured(self, asked: messages.Measure) -> sent.Measured:
        if self.picture is None:
            raise FlatclothError("Nothing is flattened yet, so nothing can be measured.")
        ends = np.array([[asked.from_u_m, asked.from_v_m], [asked.to_u_m, asked.to_v_m]])
        found = measure(self.picture.side(asked.sheet), ends[0], ends[1])
        return sent.Measured(
            id=asked.id,
            flat_mm=1000 * found.flat_m,
            cloth_mm=1000 * found.cloth_m,
            air_mm=1000 * found.air_m,
            path_uv_m=found.path_uv_m.tolist(),
        )

    def answer_newest(
        self,
        client: int,
        asked: messages.Preview | messages.PreviewPoint,
        make: Callable[[], sent.ServerMessage],
        refuse: Callable[[str], sent.ServerMessage | None] = lambda _: None,
    ) -> None:
        """Answer a question of a tab about what it drags, unless a newer one follows until then.

        A drag asks faster than can be computed: it has a lane of its own, so that nothing else waits for it.
        """

        def take(made: sent.ServerMessage | str) -> None:
            answer = refuse(made) if isinstance(made, str) else made
            if answer is not None:
                self.tabs.tell(client, answer)

        kind = client, type(asked)
        newest = self._questions.setdefault(kind, Background(self.executor, "repair", "looking ahead"))
        newest.ask(asked.id, lambda _: make(), take)

    @abstractmethod
    def _take(self, client: int, message: messages.Message) -> None:
        """Process a message that depends on the mode."""

    def _fields(self) -> dict[str, Any]:
        """Return the fields of the state for the tabs; each mode adds its own."""
        integration, recording, picture = self.integration, self.integration.recording, self.picture
        return {
            "revision": self._revision,
            "method": integration.method,
            "recording": sent.RecordingInfo(
                name=recording.name, description=recording.description, n_views=len(recording)
            ),
            "notes": tuple(integration.notes),
            "auto": self._auto,
            "layers": None if picture is None else layers_of(picture),
            "pick": self._picks.current_info(picture),
            "picks": self._picks.listed(picture),
            "lesson": self.lesson,
            "log": self._log,
            "settings": self.settings.now,
            "settings_rows": self.settings.rows,
            "reject_reasons": REJECT_REASONS,
        }

    def publish(self) -> None:
        """Send the present state to every tab; on the page's own thread."""
        self._revision, self._published_at_s = self._revision + 1, time.monotonic()
        self.last_state = sent.PageState(**self._fields())
        self.tabs.show(self.last_state)

    def report(self, about: str = "") -> None:
        """Send the state, of which only a progress is new, unless one about the same was sent just now."""
        is_same, self._reported = about == self._reported, about
        if not is_same or time.monotonic() - self._published_at_s >= PROGRESS_INTERVAL_S:
            self.publish()

    def tell_lesson(self, progress: sent.Progress | None) -> None:
        """Tell how far a lesson of the teaching mode is; None: none is made."""
        self.lesson = progress
        self.report("" if progress is None else progress.text)

    def tell(self, client: int | None, level: sent.NoteLevel, text: str) -> None:
        """Notify a tab, or (None) all, with the state, whose log keeps it; on the page's own thread."""
        note = sent.Note(id=next(self._note_ids), level=level, text=text, time_s=time.time())
        if client is None:
            self._log = (*self._log, note)[-MESSAGES_KEPT:]
            try:
                self.publish()
                return
            except Exception:  # noqa: BLE001 - logged only, as a message would publish the state again
                _log.exception("the state of the page cannot be published")
        self.tabs.tell(client, note)

    def _pick_on_ray(self, origin_m: Floats, direction: Floats) -> None:
        # A click on the background changes nothing.
        # The camera does not turn: the clicked point is visible already.
        if self._picks.add_on_ray(self.picture, self.scene.visible_points(), origin_m, direction):
            self.publish()
