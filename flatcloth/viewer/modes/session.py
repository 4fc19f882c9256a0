"""The page of a session: decisions, their computations, and Auto."""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import Any

import numpy as np
from msgspec import structs
from starlette.routing import BaseRoute

from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import Floats, RotationAxis
from flatcloth.engine.garment import GarmentService
from flatcloth.engine.integration import Integration
from flatcloth.engine.placing import RefinedScore
from flatcloth.session.document import Document, Pending
from flatcloth.session.kept import keep_ghosts, read_ghosts
from flatcloth.session.machine import (
    Accept,
    Command,
    Event,
    Failed,
    Followed,
    LeaveOut,
    Nudge,
    Phase,
    Propose,
    Reject,
    Restart,
    SessionState,
    Skip,
    Start,
    TakePart,
    apply,
    paint,
)
from flatcloth.session.store import SessionFolder
from flatcloth.viewer import auto
from flatcloth.viewer.hub import Hub
from flatcloth.viewer.modes import repair, session_work
from flatcloth.viewer.modes.controller import PageController
from flatcloth.viewer.modes.garment import GarmentController
from flatcloth.viewer.modes.joints import JointService
from flatcloth.viewer.modes.other_side import OtherSideController
from flatcloth.viewer.modes.review import ReviewService, diagnostics_routes
from flatcloth.viewer.modes.session_work import Answer, SessionWork
from flatcloth.viewer.modes.sides import SideController
from flatcloth.viewer.protocol import messages
from flatcloth.viewer.protocol.actions import NO_CAMERA, command_of
from flatcloth.viewer.protocol.picture import Overlay, Picture
from flatcloth.viewer.protocol.sent import NoteLevel
from flatcloth.viewer.protocol.snapshot import of_session
from flatcloth.viewer.protocol.state import AutoInfo
from flatcloth.viewer.scene.scene import Scene

_log = logging.getLogger(__name__)

UNDRAWN = "Undo (U) takes back what was done last; Restart chooses another start view."
"""What to do if the shape of a session cannot be drawn."""


class Application(PageController):
    """Owns one session and its page; see the module's docstring for its threads.

    Parameters
    ----------
    integration : Integration
        Does the heavy work; called from the worker thread, apart from its cheap attributes.
    folder : SessionFolder
        Contains the initial state, and stores every decision and pick.
    scene, tabs
        Where things are shown.
    """

    def __init__(self, integration: Integration, folder: SessionFolder, scene: Scene, tabs: Hub) -> None:
        super().__init__(integration, folder, scene, tabs)
        self._trouble = ""  # why the shape of the present document cannot be drawn
        self._going_on = False
        self._expected: tuple[Document, float | None] | None = None
        self._joins: tuple[Document, bool] | None = None
        self._placing = session_work.Placing(ghosts=read_ghosts(self.place))
        self.other = OtherSideController(self, self.garments, self._other_made)
        self._work = SessionWork(self, self._answered, self._drawn, self.other.laid)
        self._repair = repair.RepairService(self)
        self._review = ReviewService(self)
        self._sides = SideController(self)
        self._joints = JointService(self)
        self._garment = GarmentController(self)

    @property
    def _state(self) -> SessionState:
        return self.folder.state

    # --- from any thread ---------------------------------------------------------------------

    def routes(self) -> list[BaseRoute]:
        """Return the routes of a session."""
        return [
            *super().routes(),
            *diagnostics_routes(self),
            *self._review.routes(),
            *self._joints.routes(),
            *self._sides.routes(),
            *self.other.routes(),
        ]

    def both(self) -> GarmentService | None:
        """Return the other side of the item if the page shows it."""
        return None if self.other.made is None else self.other.both

    def start(self) -> None:
        """Show the session in its last state, and request the start view if there is none."""
        self._put(None, self._begin)

    def stop(self) -> None:
        """Stop the running work and all threads; the journal keeps the session."""
        self._put(None, self._work.cancel)
        self.other.stop()
        super().stop()
        self._review.keep_summary()

    # --- the application thread --------------------------------------------------------------

    def _begin(self) -> None:
        self.scene.arrange(self.settings.now)
        document = self._state.document
        if self._sides.available and document.start_view is None:
            self._sides.look_first()
        if self._state.request is None and document.start_view is None:
            self._do(Start())
        elif self._state.phase is Phase.READY and document.later:
            self._do(Propose())  # the program ended while later decisions followed
        else:
            self._settle()

    def _restart(self) -> None:
        self._work.cancel()
        self._work.forget_picture()
        self._auto = AutoInfo()
        self._settle()

    def _take(self, client: int, message: messages.Message) -> None:
        match message:
            case messages.Do():
                self._decide(client, message)
            case messages.Preview():
                by = session_work.meant(self._placed(), message)
                self._repair.preview(client, message, self._state.document, by)
            case messages.Move(view_index=view):
                self._by_hand(Nudge(view, session_work.meant(self._placed(), message)))
            case messages.TakePart(view_index=view, component=component):
                pending = repair.meant(self._state.document, view)
                place = repair.place_of_part(pending, self._overlay, component)
                self._by_hand(TakePart(view, component, place))
            case messages.LeaveOut(view_index=view, part_view=part_view, component=component):
                self._by_hand(LeaveOut(view, part_view, component))
            case messages.PlacePiece():
                sheet = None if self.picture is None else self.picture.sheet
                laid = self.other.laid(self._state.document)
                self._placing = session_work.placing_piece(
                    self.integration, self._state.document, sheet, message, self.garments.last, laid
                )
                for command in self._placing.commands:
                    self._by_hand(command)
                keep_ghosts(self.place, self._placing.ghosts)
            case messages.Refine(view_index=view):
                self._refine(client, view)
            case messages.Pairs():
                nudge, fit = repair.fitted(self._state.document, self._placed(), message)
                if nudge is not None:
                    self._by_hand(nudge)
                self.tabs.tell(client, fit)
            case messages.PickAt(u_m=u, v_m=v, sheet=sheet):
                self._pick_at(u, v, side=sheet)
            case messages.SetAxis(apply=apply):
                axis = session_work.meant_axis(self.integration.axis, message)
                if apply:
                    self._adjust_axis(axis)
                else:
                    self.scene.draw_axis(axis)
            case messages.StrokeImage() | messages.StrokeShape() | messages.CutShape():
                self._by_hand(paint(self._sides.decision(message, self.picture)))
            case messages.Brush():
                self._sides.brush = message if message.side is not None else None
            case messages.WhereToStroke(number=n):
                strokes = self._state.document.strokes
                self._sides.where_next(strokes, n, lambda answer: self.tabs.tell(client, answer))
            case messages.PreviewPoint():
                self._garment.preview(client, message, self._state.document)
            case (
                messages.SetKind() | messages.HoldPoint() | messages.ReleasePoints() | messages.DecidePiece()
            ):
                self._do(self._garment.decision(message))
            case messages.DecideJoint():
                self._do(self._joints.decision(message))
            case messages.ShowOther():
                self.other.is_wanted = True
                self._settle()
            case messages.DecideSeam(revision=revision, index=index, keep=keep):
                self._do(self.other.decision(revision, index, keep=keep))
            case messages.PickPoint(name=name):
                u, v, side = self._garment.seen_point(name, self.other.made)
                self._pick_at(u, v, name, side)
            case messages.SetAuto(running=running):
                self._auto = AutoInfo(running=running)
                self._settle()
            case _:
                raise FlatclothError(NO_CAMERA)

    def _decide(self, client: int, do: messages.Do) -> None:
        if do.action == "step" and self._trouble:
            raise FlatclothError(self._trouble)
        given = {
            "view_index": do.view_index,
            "reason": do.reason,
            "score": session_work.score_shown(self.picture, self._state.document),
        }
        before = self._state
        command = command_of(do.action, before, {k: v for k, v in given.items() if v is not None})
        self._going_on = self.settings.now.advance and isinstance(command, Accept | Reject | Skip)
        self._by_hand(command)
        if do.action == "undo":
            self.tell(client, "info", f"Undone: {before.undo[-1].name}.")
        elif do.action == "redo":
            self.tell(client, "info", f"Redone: {before.redo[-1].name}.")

    @property
    def _overlay(self) -> Overlay | None:
        return None if self.picture is None else self.picture.overlay

    def _placed(self) -> tuple[Pending, Overlay] | None:
        return session_work.placed(self._state.document, self._overlay)

    def _refine(self, client: int, view: int) -> None:
        document = self._state.document
        repair.meant(document, view)
        self._repair.refine(
            document, lambda found: self._guarded(client, lambda: self._refined(client, document, found))
        )

    def _refined(self, client: int, document: Document, found: RefinedScore | str) -> None:
        if isinstance(found, str):
            return self.tell(client, "error", found)
        pending = document.pending
        if pending is None or self._state.document is not document:
            raise FlatclothError("The proposal was changed while it was refined; refine it again.")
        placed = self._placed()
        own = (0.0, 0.0) if placed is None else placed[1].own_center_uv_m
        by, text = repair.refined_motion(pending, found, pending.current_from_new.apply(np.array(own)))
        if by is not None:
            self._by_hand(Nudge(pending.view_index, by, "refine"))
        self.tell(client, "info", text)

    def _pick_on_ray(self, origin_m: Floats, direction: Floats) -> None:
        if self._sides.brush is None:
            return super()._pick_on_ray(origin_m, direction)
        dab = self._sides.dab(self.picture, self.scene.visible_points(), origin_m, direction)
        if dab is not None:
            self._by_hand(paint(dab))

    def _adjust_axis(self, axis: RotationAxis) -> None:
        session_work.keep_axis(axis, self.folder)
        self._auto = AutoInfo()

        # Later jobs of the lane use the new axis.
        self.executor.compute(
            "work",
            lambda: session_work.turned_about(self.integration, axis),
            lambda text: self._turned_about(axis, text),
            "turning the axis",
        )

    def _turned_about(self, axis: RotationAxis, text: str) -> None:
        self.scene.set_axis(axis)
        self.draw_again()
        self.tell(None, "info", text)

    def draw_again(self) -> None:
        """Draw the shown document again: it is shown otherwise by what is known now."""
        self._work.forget_picture()
        self._settle()

    def _by_hand(self, command: Command) -> None:
        # A decision by hand stops Auto, unless Auto waits for it.
        self._auto = auto.after(self._auto, command)
        self._do(command)

    def _do(self, command: Command | Event) -> None:
        before = self._state
        # A decision takes effect only after it is on disk.
        self.folder.record(command)
        if self._state is not before:  # otherwise it is the answer to an outdated request
            if self._state.document is not before.document:
                self._trouble = ""
            self._settle()

    def _settle(self) -> None:
        """Update the work, the picture, Auto and the tabs to the state."""
        self._go_on()
        document = self._state.document
        self._sides.follow(document)
        self._work.follow(self._state)
        self._follow_garment()
        # After Auto, both sides are known as after an unattended run.
        self.other.is_wanted |= self._state.phase is Phase.FINISHED and self._auto.running
        self.other.follow(self.picture, busy=self._auto.is_busy)
        if document.start_view is None and self.picture is not None:
            self.picture = None
            self._show_in_scene()
        self.publish()
        if self._auto.running:
            self._put(None, self._auto_step)
        else:
            self._look_ahead()

    def _go_on(self) -> None:
        """Propose the next view after a verdict and its consequences, unless a request is open."""
        if self._going_on and self._state.phase is Phase.READY and not self._auto.running:
            self._going_on = False
            self.folder.record(Propose())

    def _look_ahead(self) -> None:
        """Compute what follows if the proposal is accepted, while the operator looks at it."""
        pending, picture = self._state.document.pending, self.picture
        is_shown = picture is not None and picture.document is self._state.document
        is_asked = self._state.phase is Phase.DECIDING and self.settings.now.advance
        if pending is not None and is_shown and is_asked:
            score = session_work.score_shown(picture, self._state.document)
            accepted = apply(self._state, Accept(pending.view_index, score))
            if accepted.phase is Phase.READY:
                self._work.foresee(apply(accepted, Propose()))

    def _auto_step(self) -> None:
        running, settings = self._auto, self.settings.now
        step = auto.next_step(self._state, running, settings, self.picture, self._expected)
        match step:
            case None:
                return
            case auto.Foresee():
                self._review.foresee(self._state.document, self._foreseen)
            case auto.Wait(text):
                self._auto = AutoInfo(running=True, waits_for=text)
                self._follow_garment()
                self.tell(None, "warning", text)
            case auto.End():
                self.other.is_wanted = True
                self._end_auto(step.level, step.text, step.by_choice)
            case Accept(view_index=view):
                self._do(Accept(view, session_work.score_shown(self.picture, self._state.document)))
            case _:
                self._do(step)

    def _foreseen(self, document: Document, expected_m2: float | None) -> None:
        self._expected = document, expected_m2
        self._put(None, self._auto_step)

    def _follow_garment(self) -> None:
        shown = None if self.picture is None else self.picture.document
        self._garment.follow(shown, busy=self._auto.is_busy)

    def _other_made(self) -> None:
        """Show the other side with the shape that it was joined to."""
        made, picture = self.other.made, self.picture
        if picture is not None and picture.sheet is not None:
            if made is not None and made.this is not picture.sheet:
                self._work.forget_picture()  # both sides lay out this one, and its pieces
            self.picture = replace(picture, other=made)
            self._show_in_scene()
        self._garment.forget()  # one outline fits the edges of both sides
        self._settle()

    def _end_auto(self, level: NoteLevel, text: str, ended: str = "") -> None:
        self._auto = AutoInfo(ended=ended)
        self._follow_garment()
        self.other.follow(self.picture, busy=False)
        self.tell(None, level, text)

    def _fields(self) -> dict[str, Any]:
        angles_deg, document = self.integration.recording.angles_deg, self._state.document
        views = self._review.of_views(document)
        own = of_session(self._state, self.picture, angles_deg, views, self._work.progress, self._trouble)
        pending = self._placing.shown(own["pending"], self._overlay)
        if pending is not None and self._joins is not None and self._joins[0] is document:
            pending = structs.replace(pending, joins=self._joins[1])
        return {
            **super()._fields(),
            **own,
            "pending": pending,
            "review": self._review.info(document),
            "auto": structs.replace(self._auto, until=auto.until_text(self.settings.now)),
            "axis": session_work.axis_info(self.integration.axis),
            "sides": self._sides.info(),
            "garment": self._garment.info(),
            "other": self.other.info(),
        }

    # --- results of the worker ---------------------------------------------------------------

    def _answered(self, answer: Answer) -> None:
        before, event = self._state, answer.event
        if event is None:
            self._auto = AutoInfo()
            self._do(Failed(answer.state.request.token if answer.state.request else 0))
            self.tell(None, "error", answer.trouble)
            return
        self.folder.record(event)
        # After a stroke in the meantime, this picture is outdated; a new one follows.
        picture = self._work.answers(answer, self._state) if before is answer.state else None
        try:
            if picture is not None:
                self._take_picture(picture)
        finally:
            self._settle()
        if isinstance(event, Followed) and not event.holds:
            self.tell(None, "warning", f"View {event.view_index} is asked again. {event.why}")

    def _drawn(self, picture: Picture | str) -> None:
        if isinstance(picture, str):
            self._undrawn(picture)
        else:
            self._take_picture(picture)
            self._settle()

    def _undrawn(self, trouble: str) -> None:
        """Go on although the shape cannot be drawn, as when strokes leave its start view too little cloth."""
        document = self._state.document
        decided = document.accepted or document.later or document.pending
        # After an undo the user goes back past it.
        if document.strokes and not decided and not self._state.redo:
            self._end_auto("warning", f"{trouble} Another start view is chosen; Undo takes it back.")
            self._do(Restart())
            return
        self._trouble = f"{trouble} {UNDRAWN}"
        self._end_auto("error", self._trouble)
        self.publish()

    def _take_picture(self, picture: Picture) -> None:
        # Until it is joined to this shape, the other side is shown as it was.
        picture = replace(picture, other=self.other.made)
        self.picture = picture
        self._show_in_scene()
        self._review.follow(picture)
        document = picture.document
        if document is not None and document.pending is not None and document.pending.moved:
            self.executor.compute(
                "work",
                lambda: session_work.joins(self.integration, document),
                lambda found: self._found_out(document, found),
                "trying the placement",
                lambda: self._state.document is document,  # otherwise it was moved on, or decided
            )

    def _found_out(self, document: Document, joins: bool | str) -> None:
        """Show whether a proposal that was moved by hand joins the shape."""
        if isinstance(joins, bool):
            self._joins = document, joins
            self.publish()
