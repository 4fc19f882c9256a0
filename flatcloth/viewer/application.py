"""The one thread that owns the session: everything that happens arrives on its queue.

Sockets, viser's callbacks and the worker only put jobs on the queue; the session, the picks and the
messages are changed nowhere else. What is read from other threads (the picture) is immutable.
"""

from __future__ import annotations

import itertools
import logging
import math
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from flatcloth.errors import CancelledError, FlatclothError, IllegalDecisionError
from flatcloth.session import (
    Accept,
    Command,
    Document,
    Event,
    Failed,
    Nudge,
    Phase,
    Propose,
    Request,
    Start,
    apply,
)
from flatcloth.types import Float64, Floats
from flatcloth.viewer import messages
from flatcloth.viewer.actions import command_of, nudge_about
from flatcloth.viewer.picks import PickDesk, PlaceBook
from flatcloth.viewer.picture import Picture, attributes_at, make_picture
from flatcloth.viewer.snapshot import Desk, Note, center_uv_m, snapshot
from flatcloth.viewer.worker import Worker

if TYPE_CHECKING:
    from flatcloth.integration import Integration
    from flatcloth.journal import SessionFolder

_log = logging.getLogger(__name__)

MESSAGES_KEPT = 100
PROGRESS_INTERVAL_S = 0.05


class Audience(Protocol):
    """Who is told: the open tabs. All methods may be called from any thread and return at once."""

    def show(self, state: dict[str, Any]) -> None:
        """Send the whole state to every tab."""

    def tell(self, client: int | None, message: dict[str, Any]) -> None:
        """Send one message to one tab, or to all of them."""


class Stage(Protocol):
    """The 3D side of the page."""

    def show(self, picture: Picture | None) -> None:
        """Show what a document looks like, or an empty scene."""

    def show_pick(self, position_m: Float64 | None, normal: Float64 | None) -> None:
        """Show the ball and the arrow of the current pick, or hide them."""

    def visible_points(self) -> Floats:
        """Return the points (N, 3) that a ray of the eye can hit."""

    def follow(self, on: bool) -> None:
        """Let the cameras follow the view, or not."""


class Application:
    """Owns one session and its page; see the module's docstring for its threads.

    Parameters
    ----------
    integration : Integration
        Does the heavy work; called from the worker thread, apart from its cheap attributes.
    folder : SessionFolder
        Holds the state to start from, and keeps every decision and pick.
    stage, audience
        Where things are shown.
    """

    def __init__(
        self,
        integration: Integration,
        folder: SessionFolder,
        stage: Stage,
        audience: Audience,
    ) -> None:
        self._integration = integration
        self._folder = folder
        self._stage = stage
        self._audience = audience
        self._state = folder.state
        self._desk = Desk(auto_threshold=integration.config.alignment.accept_score)
        self._picks = PickDesk(folder, integration.axis, stage.show_pick)
        self._picture: Picture | None = None
        self._made: Picture | None = None
        self._asked: Document | None = None
        self._cancel: tuple[int, threading.Event] | None = None
        self._places = PlaceBook()
        self._note_ids = itertools.count(1)
        self._revision = 0
        self._snapshot: dict[str, Any] = {}
        self._progress_at_s = 0.0
        self._front = Worker("flatcloth-session")
        self._back = Worker("flatcloth-work")

    # --- from any thread ---------------------------------------------------------------------

    @property
    def picture(self) -> Picture | None:
        """What is shown at present; immutable."""
        return self._picture

    @property
    def last_snapshot(self) -> dict[str, Any]:
        """The state that was sent last; not to be changed."""
        return self._snapshot

    def start(self) -> None:
        """Show the session as it was left, and ask for the start view if there is none."""
        self._put(None, self._begin)

    def stop(self) -> None:
        """Stop the running work and both threads; the session stays as the journal has it."""
        self._put(None, self._stop_work)
        self._front.stop(timeout_s=5.0)
        self._back.stop(timeout_s=2.0)

    def receive(self, client: int, text: str) -> None:
        """Take a message of a tab; errors come back as notifications."""
        self._put(client, lambda: self._receive(client, text))

    def click_ray(self, origin_m: tuple[float, ...], direction: tuple[float, ...]) -> None:
        """Take a click in the 3D scene."""
        self._put(None, lambda: self._pick_on_ray(np.array(origin_m), np.array(direction)))

    def set_follow(self, follow: bool) -> None:
        """Let the cameras follow the view, or not."""
        self._put(None, lambda: self._set_follow(follow))

    def describe(self, hover: messages.Hover) -> dict[str, Any]:
        """Answer a hover read-out; cheap, reads only the present picture."""
        picture, axis = self._picture, self._integration.axis
        shape = None if picture is None else attributes_at(picture.view, hover.u_m, hover.v_m, axis)
        overlay = None if picture is None else picture.overlay
        proposal = None if overlay is None else attributes_at(overlay.view, hover.u_m, hover.v_m, axis)
        return {"type": "hover", "id": hover.id, "shape": shape, "proposal": proposal}

    def grasps(self) -> dict[str, Any]:
        """Return the list of picks as it is exported.

        Raises
        ------
        FlatclothError
            If nothing is flattened yet.
        """
        from flatcloth.export import grasps_document

        if self._picture is None:
            raise FlatclothError("Nothing is flattened yet; there are no grasp points to export.")
        return grasps_document(self._picture.view, self._picks.picks)

    # --- the application thread --------------------------------------------------------------

    def _put(self, client: int | None, job: Callable[[], None]) -> None:
        self._front.put(lambda: self._guarded(client, job))

    def _guarded(self, client: int | None, job: Callable[[], None]) -> None:
        try:
            job()
        except IllegalDecisionError as error:
            self._tell(client, "warning", str(error))
        except FlatclothError as error:
            _log.warning("%s", error)
            self._tell(client, "error", str(error))
        except Exception as error:  # noqa: BLE001 - told and logged
            _log.exception("a command failed")
            self._tell(client, "error", f"Unexpected error: {error!r}. The terminal shows more.")

    def _begin(self) -> None:
        self._stage.follow(self._desk.follow)
        if self._state.request is None and self._state.document.start_view is None:
            self._do(Start())
        else:
            self._settle()

    def _stop_work(self) -> None:
        if self._cancel is not None:
            self._cancel[1].set()

    def _receive(self, client: int, text: str) -> None:
        message = messages.parse(text)
        match message:
            case messages.Do(action=action, view_index=view, reason=reason):
                given = {"view_index": view, "reason": reason}
                given = {k: v for k, v in given.items() if v is not None}
                self._by_hand(command_of(action, self._state, given))
            case messages.Move(view_index=view, theta_rad=theta, u_m=u, v_m=v):
                overlay = None if self._picture is None else self._picture.overlay
                center = (0.0, 0.0) if overlay is None else center_uv_m(overlay.view)
                self._by_hand(Nudge(view, nudge_about(center, theta, u, v)))
            case messages.PickAt(u_m=u, v_m=v):
                self._picks.add(self._picture, u, v)
                self._publish()
            case messages.ShowPick(id=pick_id):
                self._picks.show(pick_id)
                self._publish()
            case messages.RenamePick(id=pick_id, name=name):
                self._picks.rename(pick_id, name.strip())
                self._publish()
            case messages.DeletePick(id=pick_id):
                self._picks.delete(pick_id)
                self._publish()
            case messages.SetAuto(running=running, threshold=threshold):
                desk = self._desk
                self._desk = replace(
                    desk,
                    auto=desk.auto if running is None else running,
                    auto_threshold=desk.auto_threshold if threshold is None else threshold,
                )
                self._settle()
            case messages.SetFollow(follow=follow):
                self._set_follow(follow)
            case messages.Hover():
                self._audience.tell(client, self.describe(message))

    def _by_hand(self, command: Command) -> None:
        # Whoever decides by hand takes over from Auto.
        self._desk = replace(self._desk, auto=False)
        self._do(command)

    def _do(self, command: Command | Event) -> None:
        state = apply(self._state, command)
        if state is self._state:
            return  # the answer to a question that nobody asks any more
        # The journal comes first: what is not on disk has not been decided.
        self._folder.record(command)
        self._state = state
        self._settle()

    def _settle(self) -> None:
        """Bring the work, the picture, Auto and the tabs in line with the state."""
        self._settle_work()
        document = self._state.document
        if document.start_view is None:
            if self._picture is not None or self._asked is not None:
                self._picture = self._asked = None
                self._stage.show(None)
        elif self._asked is not document:
            self._asked = document
            self._back.put(lambda: self._work_on_picture(document))
        self._publish()
        if self._desk.auto:
            self._put(None, self._auto_step)

    def _settle_work(self) -> None:
        request = self._state.request
        if self._cancel is not None and (request is None or self._cancel[0] != request.token):
            self._cancel[1].set()
            self._cancel = None
            self._desk = replace(self._desk, progress=None)
        if request is not None and self._cancel is None:
            cancelled = threading.Event()
            self._cancel = (request.token, cancelled)
            self._desk = replace(self._desk, progress=(0.0, "Waiting"))
            document = self._state.document
            self._back.put(lambda: self._work_on_request(document, request, cancelled))

    def _auto_step(self) -> None:
        state, desk = self._state, self._desk
        up_to_date = self._picture is not None and self._picture.document is state.document
        started = state.document.start_view is not None
        if not desk.auto or state.phase is Phase.COMPUTING or (started and not up_to_date):
            return
        pending = state.document.pending
        if state.phase is Phase.FINISHED:
            self._end_auto("info", f"Auto has finished. {state.document.finished}")
        elif pending is None:
            self._do(Propose() if started else Start())
        elif math.isfinite(pending.score) and pending.score >= desk.auto_threshold:
            self._do(Accept(pending.view_index))
        else:
            self._end_auto(
                "warning",
                f"Auto stopped: the score of view {pending.view_index} is {pending.score:.2f}, below"
                f" {desk.auto_threshold:.2f}. Accept, move or reject it.",
            )

    def _end_auto(self, level: str, text: str) -> None:
        self._desk = replace(self._desk, auto=False)
        self._tell(None, level, text)

    def _publish(self) -> None:
        self._revision += 1
        self._snapshot = snapshot(
            self._revision,
            self._state,
            self._desk,
            self._picks,
            self._picture,
            self._integration,
            self._places,
        )
        self._audience.show(self._snapshot)

    def _tell(self, client: int | None, level: str, text: str) -> None:
        note = Note(id=next(self._note_ids), level=level, text=text, time_s=time.time())
        if client is None:
            self._desk = replace(self._desk, log=(*self._desk.log, note)[-MESSAGES_KEPT:])
            self._publish()
        else:
            self._audience.tell(client, {"type": "note", **note.plain()})

    def _pick_on_ray(self, origin_m: Floats, direction: Floats) -> None:
        # A click on the background picks nothing and changes nothing.
        if self._picks.add_on_ray(self._picture, self._stage.visible_points(), origin_m, direction):
            self._publish()

    def _set_follow(self, follow: bool) -> None:
        self._desk = replace(self._desk, follow=follow)
        self._stage.follow(follow)
        self._publish()

    # --- the worker --------------------------------------------------------------------------

    def _work_on_request(self, document: Document, request: Request, cancelled: threading.Event) -> None:
        def progress(share: float, text: str) -> None:
            if cancelled.is_set():
                raise CancelledError
            self._put(None, lambda: self._note_progress(request, share, text))

        try:
            progress(0.0, "Starting")
            event = self._integration.answer(document, request, progress)
        except CancelledError:
            return
        except FlatclothError as error:
            text = str(error)
            _log.warning("%s", error)
        except Exception as error:  # noqa: BLE001 - told and logged
            _log.exception("the work on %s failed", request)
            text = f"Unexpected error while computing: {error!r}. The terminal shows more."
        else:
            self._put(None, lambda: self._answered(event))
            return
        self._put(None, lambda: self._failed(request, text))

    def _answered(self, event: Event) -> None:
        self._do(event)

    def _failed(self, request: Request, text: str) -> None:
        if self._state.request != request:
            return
        self._desk = replace(self._desk, auto=False)
        self._do(Failed(request.token))
        self._tell(None, "error", text)

    def _note_progress(self, request: Request, share: float, text: str) -> None:
        if self._state.request != request:
            return
        self._desk = replace(self._desk, progress=(share, text))
        now_s = time.monotonic()
        if now_s - self._progress_at_s >= PROGRESS_INTERVAL_S:
            self._progress_at_s = now_s
            self._audience.tell(None, {"type": "progress", "share": share, "text": text})

    def _work_on_picture(self, document: Document) -> None:
        if self._asked is not document:
            return  # decided otherwise in the meantime
        try:
            # Revisions go on from the last picture made, even if it was never shown.
            picture = self._made = make_picture(self._integration, document, self._made)
        except FlatclothError as error:
            text = str(error)
        except Exception as error:  # noqa: BLE001 - told and logged
            _log.exception("a picture could not be computed")
            text = f"Unexpected error while drawing: {error!r}. The terminal shows more."
        else:
            self._put(None, lambda: self._show_picture(picture))
            return
        self._put(None, lambda: self._end_auto("error", text))

    def _show_picture(self, picture: Picture) -> None:
        if self._asked is not picture.document:
            return
        self._picture = picture
        self._stage.show(picture)
        self._settle()
