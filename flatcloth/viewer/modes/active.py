"""The page of an active loop: a session whose recording grows, with proposals and verdicts, or Auto.

The loop asks for angles; a simulated cell turns there at a click, or by itself with Auto. A robot may turn,
too (``/robot/next``, ``/robot/view``). A view is taken on the thread of the computations; its proposal is
decided as any other; then the loop learns from it and chooses the next angle.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from msgspec import structs
from starlette.requests import Request
from starlette.routing import BaseRoute

from flatcloth.active.choosing import FIRST, End, Next, Waiting
from flatcloth.active.eye import CameraEye
from flatcloth.active.goal import Goal, Knowledge, parse_goal
from flatcloth.active.incoming import SeenView, Taken
from flatcloth.active.loop import ActiveLoop
from flatcloth.active.service import ActiveService, Eye
from flatcloth.core.errors import FlatclothError, IllegalDecisionError, RecordingError
from flatcloth.engine.headless import better_start
from flatcloth.session.document import UNSURE
from flatcloth.session.machine import Phase, Propose, Reject, Restart, SessionState, Start
from flatcloth.viewer import http
from flatcloth.viewer.hub import Hub
from flatcloth.viewer.modes.session import Answer, Application
from flatcloth.viewer.protocol import messages
from flatcloth.viewer.protocol.actions import Action
from flatcloth.viewer.protocol.robot import PostedView
from flatcloth.viewer.protocol.sent import ActiveStatus, AutoInfo
from flatcloth.viewer.worker import result_of

if TYPE_CHECKING:
    from flatcloth.viewer.scene.scene import Scene

MAX_BODY_BYTES = 32 * 2**20
"""Limit of a view's body. Chosen: raw color and depth of 1920 x 1080 pixels take 14 MB in base64."""
ANSWER_S = 60.0
"""Longest time that a robot waits for a computation. Chosen: a view takes a few seconds."""
STEPS_SHOWN = 6
"""Steps of the loop that the page shows. Chosen: what fits into the panel."""


class PageLoop(ActiveLoop):
    """A loop whose views are decided on the page, once it has one."""

    page: ActiveApplication | None = None

    def _grow_session(self) -> None:
        if self.page is None:
            super()._grow_session()
        else:
            self.page.answered(super()._grow_session)

    def _after(self, number: int, told: list[str]) -> Taken:
        if self.page is None:
            return super()._after(number, told)
        reason = f"View {number} is being placed; its proposal is decided on the page."
        asked = self.asked if isinstance(self.asked, Next) else FIRST
        self.asked = Waiting(reason=reason, new_m2=asked.new_m2)
        self.page.propose_view(number)
        return Taken(number=number, told=tuple(told))

    def settled(self, number: int) -> None:
        """Choose the next angle after a view that was decided, and begin to learn from it."""
        with self.lock:
            used = number in self.document.used_views
            told = [] if used else [f"View {number} is not part of the shape."]
            self._answer(number, told, joined=used)

    def _learn_from(self, before: Knowledge, line: dict[str, Any], *, ends: bool = False) -> None:
        super()._learn_from(before, line, ends=ends)
        if self.page is not None:
            self.page.learnt()


class ActiveApplication(Application):
    """The page of an active loop; see :class:`flatcloth.viewer.modes.session.Application`.

    Parameters
    ----------
    loop : PageLoop
        With at least one view.
    eye : callable
        Turns a cell to an angle and looks; a robot may send views, too.
    """

    def __init__(self, loop: PageLoop, scene: Scene, tabs: Hub, eye: Eye) -> None:
        assert loop.integration is not None
        assert loop.session is not None
        super().__init__(loop.integration, loop.session, scene, tabs)
        self.loop, self._eye = loop, eye
        self._undecided: int | None = None
        self._is_learning = self._is_turning = False
        self._restarted_with: int | None = None
        loop.garments = self.garments
        loop.page = self

    def routes(self) -> list[BaseRoute]:
        """Return the routes of a session, and those by which a robot turns the item."""
        service = ActiveService(self.loop, self._eye, lambda: self.base_from_camera, self.take_view)
        return [*super().routes(), *active_routes(service)]

    def take_view(self, view: SeenView, answers: int | None = None) -> Taken:
        """Take a view that a robot sends; it is decided on the page."""
        return result_of(self.executor.put("work", lambda: self.loop.take(view, answers)), ANSWER_S)

    # --- the application thread --------------------------------------------------------------

    def _take(self, client: int, message: messages.Message) -> None:
        match message:
            case messages.Capture(action="turned") | messages.Do(action="step"):
                self._turn()
            case messages.Aim(goal=goal):
                self.executor.put(
                    "work", functools.partial(self._aim, parse_goal(goal, 1e3 * self.loop.goal.within_m))
                )
            case _:
                super()._take(client, message)

    def _turn(self) -> None:
        """Let the cell turn to where the loop asks, and look."""
        asked = self.loop.asked
        if self._is_turning or isinstance(asked, Waiting):
            raise IllegalDecisionError("A view is being taken; decide about its proposal first.")
        if isinstance(asked, End):
            raise IllegalDecisionError(f"The loop has ended. {asked.reason}")
        self._is_turning = True
        self.executor.compute("work", lambda: self._look(asked), self._turned, "taking a view")
        self.publish()

    def propose_view(self, number: int) -> None:
        """Propose a view that was taken; called on the thread of the computations."""

        def propose() -> None:
            self._undecided = number
            started = self._state.document.start_view is not None
            self._do(Propose(number) if started else Start())

        self._put(None, propose)

    def _settle(self) -> None:
        super()._settle()
        number = self._undecided
        if number is None or self._is_learning or self._state.phase in (Phase.COMPUTING, Phase.DECIDING):
            return
        self._is_learning = True
        self.executor.compute("work", lambda: self._learn(number), self._settled, "learning from a view")

    def _go_on(self) -> None:
        """Propose nothing after a verdict: the loop asks for the next view."""

    def _look_ahead(self) -> None:
        """Foresee nothing: the next view is still to be taken."""

    def answered_with(self, asked: SessionState, answer: Answer | str) -> None:
        """Also let Auto go on after a view that cannot be placed: it is put off, as without a page."""
        puts_off = self._auto.running and self._undecided is not None
        super().answered_with(asked, answer)
        if isinstance(answer, str) and puts_off:
            self._auto = AutoInfo(running=True)

    def _auto_step(self) -> None:
        """Also let the cell turn, and put off what is not sure, as a run without an operator does."""
        pending = self._state.document.pending
        if self._state.phase is Phase.FINISHED or (pending is None and self._undecided is not None):
            if self._auto.running and self._undecided is None and not self._is_turning:
                if isinstance(self.loop.asked, Next):
                    if not isinstance(self._eye, CameraEye):  # a person turns, and says so
                        self._turn()
                elif isinstance(self.loop.asked, End):
                    self._end_auto("info", self.loop.asked.reason)
            return
        low = pending is not None and not pending.score >= self.settings.now.auto_threshold
        is_up_to_date = self.picture is not None and self.picture.document is self._state.document
        if self._auto.running and pending is not None and low and is_up_to_date:
            self._do(Reject(pending.view_index, UNSURE))
            return
        super()._auto_step()

    def _fields(self) -> dict[str, Any]:
        fields = super()._fields()
        return {**fields, "active": self.status(), "actions": tuple(map(self._allowed, fields["actions"]))}

    def _allowed(self, action: Action) -> Action:
        """Return an action with the reason why it is not allowed now, for those that the loop changes."""
        asks = isinstance(self.loop.asked, Next)
        if action.name == "auto" and asks:
            return structs.replace(action, why_not=None)
        if action.name in ("step", "capture_turned"):
            about = "Turn the item to the next angle and take a view; Auto does it by itself."
            why_not = None if asks and not self._is_turning else "No turn is asked of the cell now."
            return structs.replace(action, description=about, why_not=why_not)
        return action

    def status(self) -> ActiveStatus:
        """Return the state of the loop for the page."""
        loop, asked = self.loop, self.loop.asked
        following = asked if isinstance(asked, Next) else None
        return ActiveStatus(
            goal=str(loop.goal),
            budget=str(loop.budget),
            folder=str(loop.folder),
            views=loop.views,
            knows=loop.knowledge.about(loop.goal),
            angle_deg=None if following is None else following.angle_deg,
            turn_deg=None if following is None else following.turn_deg,
            why="" if following is None else following.why,
            end=asked.reason if isinstance(asked, End) else None,
            waiting=asked.reason if isinstance(asked, Waiting) else "",
            turning=self._is_turning,
            is_simulated=not isinstance(self._eye, CameraEye),
            steps=tuple(loop.steps()[-STEPS_SHOWN:]),
        )

    # --- the thread of the computations ---------------------------------------------------------

    def _look(self, asked: Next) -> str:
        """Take a view; return what there is to tell of it."""
        try:
            taken = self.loop.take(self._eye(asked.angle_deg, self.loop.views), self.loop.views)
        except FlatclothError as error:
            self.loop.fail(str(error))
            raise
        return " ".join(taken.told)

    def _aim(self, goal: Goal) -> None:
        self.loop.aim_at(goal)
        self._put(None, self._settle)

    def _turned(self, trouble: str) -> None:
        self._is_turning = False
        if trouble:
            self.tell(None, "warning", trouble)
        self.publish()

    def _learn(self, number: int) -> int | None:
        """Return the start view that Auto begins again with, once each, or ask for the next view."""
        better = better_start(self.integration, self._state.document) if self._auto.running else None
        if better is not None and better != self._restarted_with:
            return better
        self.loop.settled(number)
        return None

    def _settled(self, better: int | str | None) -> None:
        self._is_learning = False
        if isinstance(better, str):
            self.tell(None, "warning", better)
        elif better is not None:
            self._restarted_with = better
            self._do(Restart(better))
            return
        self._undecided = None
        self._settle()

    def learnt(self) -> None:
        """Show what is known now; called on any thread when a view was learnt from."""

        def show() -> None:
            if isinstance(self.loop.asked, End):
                self.tell(None, "info", self.loop.asked.reason)
                self.executor.put("work", self._write)
            self._settle()
            self.publish()

        self._put(None, show)

    def _write(self) -> None:
        """Write the result to the folder when the loop has ended."""
        try:
            self.answered(lambda: self.loop.write(self.base_from_camera))
        except FlatclothError as error:
            self._put(None, functools.partial(self.tell, None, "error", str(error)))


def active_routes(
    service: ActiveService, on_answer: Callable[[dict[str, Any]], object] = lambda _: None
) -> list[BaseRoute]:
    """Return the routes; ``on_answer`` is called with each answer before it is sent."""

    def answered(answer: dict[str, Any]) -> dict[str, Any]:
        on_answer(answer)
        return answer

    def view(request: Request, posted: PostedView) -> dict[str, Any]:
        rotation_deg = http.rotation_of(request)
        if posted.color is None and posted.depth is None and posted.K is None:
            return answered(service.look(posted.angle_deg, posted.number, rotation_deg))
        try:
            seen = posted.view()
        except (ValueError, RecordingError) as error:
            raise http.RefusedError(f"The view was not read: {error}", 400) from error
        return answered(service.take(seen, posted.number, rotation_deg))

    return [
        http.get("/robot/next", lambda request: answered(service.next(http.rotation_of(request)))),
        http.post("/robot/view", PostedView, view, MAX_BODY_BYTES),
    ]
