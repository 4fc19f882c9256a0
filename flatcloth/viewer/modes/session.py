"""The page of a session: decisions, their computations, and Auto."""

from __future__ import annotations

import logging
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from msgspec import structs
from starlette.routing import BaseRoute

from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import Floats, finite
from flatcloth.engine.integration import Integration
from flatcloth.engine.placing import RefinedScore
from flatcloth.engine.warmup import is_of_one_view, wait_until_compiled
from flatcloth.session.document import Document, Pending
from flatcloth.session.machine import (
    Accept,
    Command,
    Event,
    Failed,
    Nudge,
    Phase,
    Propose,
    Reject,
    Request,
    Restart,
    SessionState,
    Skip,
    Start,
    TakePart,
    apply,
)
from flatcloth.session.store import SessionFolder
from flatcloth.viewer.hub import Hub
from flatcloth.viewer.modes import proposal
from flatcloth.viewer.modes.controller import PageController
from flatcloth.viewer.modes.doubts import DoubtService
from flatcloth.viewer.modes.garment import GarmentController, OtherSideController
from flatcloth.viewer.modes.review import ReviewService, diagnostics_routes
from flatcloth.viewer.modes.sides import SideController
from flatcloth.viewer.protocol import messages
from flatcloth.viewer.protocol.actions import NO_CAMERA, command_of
from flatcloth.viewer.protocol.picture import Overlay, Picture, make_picture, of_session
from flatcloth.viewer.protocol.sent import AutoInfo, NoteLevel, PreviewAnswer, Progress
from flatcloth.viewer.worker import Background, Check, attempt

if TYPE_CHECKING:
    from flatcloth.viewer.scene.scene import Scene

_log = logging.getLogger(__name__)

UNDRAWN = "Undo (U) takes back what was done last; Restart chooses another start view."
"""What to do if the shape of a session cannot be drawn."""


Answer = tuple[Event, Picture | None]
"""The answer to the request of a state, and the picture of the session after it; None: a request follows."""


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
        self._joins: tuple[Document, bool] | None = None
        self._trying = Background(self.executor, "work", "trying the placement")
        self._answering = Background(self.executor, "work", "computing", self.report)
        self._drawing = Background(self.executor, "work", "drawing", self.report)
        self._foreseeing = Background(self.executor, "ahead", "looking ahead")
        self._ahead: Picture | None = None  # what follows if the proposal is accepted
        # The last picture, even if it was never shown: what has not changed is taken from it.
        self._made: Picture | None = None
        self.other = OtherSideController(self, self.garments, self._other_made)
        self._review = ReviewService(self)
        self._sides = SideController(self)
        self._garment = GarmentController(self)
        self._doubts = DoubtService(self, self._garment, self.other)

    picture: Picture | None

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
            *self._doubts.routes(),
            *self._sides.routes(),
        ]

    def start(self) -> None:
        """Show the session in its last state, and request the start view if there is none."""
        self._put(None, self._begin)

    def stop(self) -> None:
        """Stop the running work and all threads; the journal keeps the session."""
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
        else:
            self._settle()

    def _take(self, client: int, message: messages.Message) -> None:
        match message:
            case messages.Do():
                self._decide(client, message)
            case messages.Preview():
                document, by = self._state.document, proposal.meant(self._placed(), message)
                self.answer_newest(
                    client,
                    message,
                    lambda: proposal.preview(self.integration, document, message, by),
                    lambda why: PreviewAnswer(id=message.id, why=why),
                )
            case messages.Move(view_index=view):
                self._by_hand(Nudge(view, proposal.meant(self._placed(), message)))
            case messages.TakePart(view_index=view, component=component):
                pending = proposal.asked_about(self._state.document, view)
                place = proposal.place_of_part(pending, self._overlay, component)
                self._by_hand(TakePart(view, component, place))
            case messages.Refine(view_index=view):
                self._refine(client, view)
            case messages.Pairs():
                nudge, fit = proposal.fitted(self._state.document, self._placed(), message)
                if nudge is not None:
                    self._by_hand(nudge)
                self.tabs.tell(client, fit)
            case messages.PickAt(u_m=u, v_m=v, sheet=sheet):
                self._pick_at(u, v, side=sheet)
            case messages.StrokeImage() | messages.StrokeShape():
                self._by_hand(self._sides.decision(message, self.picture))
            case messages.Brush():
                self._sides.brush = message if message.side is not None else None
            case messages.WhereToStroke(number=n):
                strokes = self._state.document.strokes
                self._sides.where_next(strokes, n, lambda answer: self.tabs.tell(client, answer))
            case messages.PreviewPoint():
                self.answer_newest(client, message, self._garment.preview(message, self._state.document))
            case messages.SetKind() | messages.HoldPoint() | messages.ReleasePoints():
                self._do(self._garment.decision(message))
            case messages.Decide():
                for command in self._doubts.decision(message):
                    self._by_hand(command)
            case messages.ShowOther():
                self.other.is_wanted = True
                self._settle()
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
        before, score = self._state, self._score_shown()
        command = command_of(do.action, before, do.view_index, do.reason, score)
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
        """Return the proposal with its picture, None while there is none."""
        pending, overlay = self._state.document.pending, self._overlay
        if pending is None or overlay is None or overlay.view_index != pending.view_index:
            return None
        return pending, overlay

    def _score_shown(self) -> float | None:
        """Return the score of the present placement of the proposal, if that is shown."""
        is_shown = self.picture is not None and self.picture.document is self._state.document
        return finite(self._overlay.score.total) if is_shown and self._overlay is not None else None

    def _refine(self, client: int, view: int) -> None:
        document = self._state.document
        proposal.asked_about(document, view)
        self.executor.compute(
            "repair",
            lambda: self.integration.refined_score(document),
            lambda found: self._guarded(client, lambda: self._refined(client, document, found)),
            "refining",
        )

    def _refined(self, client: int, document: Document, found: RefinedScore | str) -> None:
        if isinstance(found, str):
            return self.tell(client, "error", found)
        pending = document.pending
        if pending is None or self._state.document is not document:
            raise FlatclothError("The proposal was changed while it was refined; refine it again.")
        placed = self._placed()
        own = (0.0, 0.0) if placed is None else placed[1].own_center_uv_m
        by, text = proposal.refined_motion(pending, found, pending.current_from_new.apply(np.array(own)))
        if by is not None:
            self._by_hand(Nudge(pending.view_index, by, "refine"))
        self.tell(client, "info", text)

    def _pick_on_ray(self, origin_m: Floats, direction: Floats) -> None:
        if self._sides.brush is None:
            return super()._pick_on_ray(origin_m, direction)
        dab = self._sides.dab(self.picture, self.scene.visible_points(), origin_m, direction)
        if dab is not None:
            self._by_hand(dab)

    def draw_again(self) -> None:
        """Draw the shown document again: it is shown otherwise by what is known now."""
        self._forget_picture()
        self._settle()

    def _forget_picture(self) -> None:
        self._drawing.forget()
        self._foreseeing.forget()
        self._ahead = None

    def _by_hand(self, command: Command) -> None:
        # A decision by hand stops Auto, unless Auto waits for it.
        self._auto = proposal.after(self._auto, command)
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
        self._compute(self._state)
        shown = None if self.picture is None else self.picture.document
        self._garment.follow(shown, busy=self._auto.is_busy)
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
            accepted = apply(self._state, Accept(pending.view_index, self._score_shown()))
            if accepted.phase is Phase.READY:
                self._foresee(apply(accepted, Propose()))

    def _auto_step(self) -> None:
        """Do what Auto does next; nothing while it waits, or the session is ahead of what is shown."""
        state, settings, document = self._state, self.settings.now, self._state.document
        pending, started = document.pending, document.start_view is not None
        is_shown = self.picture is not None and self.picture.document is document
        if not self._auto.running or state.phase is Phase.COMPUTING or (started and not is_shown):
            return
        enough = f"The shape has {len(document.used_views)} views, as chosen."
        is_enough = settings.auto_until == "views" and len(document.used_views) >= settings.auto_views
        if state.phase is Phase.FINISHED:
            self.other.is_wanted = True
            self._end_auto("info", f"Auto has ended. {document.finished or ''}")
        elif not started:
            self._do(Start())
        elif self._auto.waits_for:
            return
        elif pending is not None:
            unsure = proposal.what_is_unsure(pending, settings.auto_threshold)
            if not unsure:
                return self._do(Accept(pending.view_index, self._score_shown()))
            self._auto = AutoInfo(running=True, waits_for=unsure)
            self._settle()
            self.tell(None, "warning", unsure)
        elif is_enough:
            self.other.is_wanted = True
            self._end_auto("info", f"Auto has ended. {enough}", enough)
        else:
            self._do(Propose())

    def _other_made(self) -> None:
        """Show the other side with the shape that it was joined to."""
        made, picture = self.other.made, self.picture
        if picture is not None:
            if made is not None and made.sides.laid:
                self._forget_picture()  # seams lay its pieces
            self.picture = replace(picture, other=made)
            self._show_in_scene()
        self._garment.forget()  # one outline fits the edges of both sides
        self._settle()

    def _end_auto(self, level: NoteLevel, text: str, ended: str = "") -> None:
        self._auto, self._going_on = AutoInfo(ended=ended), False
        self._settle()
        self.tell(None, level, text)

    def _fields(self) -> dict[str, Any]:
        angles_deg, document = self.integration.recording.angles_deg, self._state.document
        views = self._review.of_views(document)
        own = of_session(self._state, self.picture, angles_deg, views, self._progress, self._trouble)
        pending = own["pending"]
        if pending is not None and self._joins is not None and self._joins[0] == document:
            pending = structs.replace(pending, joins=self._joins[1])
        return {
            **super()._fields(),
            **own,
            "pending": pending,
            "review": self._review.info(document),
            "sides": self._sides.info(),
            "garment": self._garment.info(),
            "other": self.other.info(),
            "doubts": self._doubts.follow(self.picture),
        }

    # --- what is computed -----------------------------------------------------------------------

    @property
    def _progress(self) -> Progress | None:
        """How far what is shown next is, None while only its picture is drawn."""
        if self._answering.is_working:
            return self._answering.progress or Progress(share=0.0, text="Waiting")
        return self._drawing.progress

    def _compute(self, state: SessionState) -> None:
        """Start the computation that a state needs, and cancel one that it no longer needs.

        An answer comes with its picture; otherwise the document is drawn.
        """
        request, document = state.request, state.document
        if request != self._answering.asked:
            self._answering.forget()
        if request is not None:
            make, take = partial(self._answer, state, request), partial(self.answered_with, state)
            self._answering.ask(request, make, take)
        elif document.start_view is None or document is not self._drawing.asked:
            self._drawing.forget()
            if document.start_view is not None:
                self._drawing.ask(document, partial(self._draw, document), self._drawn)

    def _foresee(self, after: SessionState) -> None:
        """Compute what follows in a likely state while the operator looks: then all of it is kept already."""
        request = after.request

        def take(made: Answer | str) -> None:
            self._ahead = None if isinstance(made, str) else made[1]

        if request is not None:
            self._foreseeing.ask(after, partial(self._answer_and_picture, after, request), take)

    def answered_with(self, asked: SessionState, answer: Answer | str) -> None:
        """Take the answer to what a state asks, or why there is none."""
        self._answering.forget()  # if it cannot be kept, it is asked for again
        if isinstance(answer, str):
            _log.warning("%s", answer)
            self._auto = AutoInfo()
            self._do(Failed(asked.request.token if asked.request else 0))
            self.tell(None, "error", answer)
            return
        before, (event, picture) = self._state, answer
        self.folder.record(event)
        try:
            # After a stroke in the meantime, this picture is outdated; a new one follows.
            if picture is not None and before is asked:
                self._drawing.forget()
                self._drawing.asked = self._state.document
                self._take_picture(replace(picture, document=self._state.document))
        finally:
            self._settle()

    def _drawn(self, picture: Picture | str) -> None:
        """Show the present picture, or why the shape cannot be drawn."""
        if isinstance(picture, str):
            self._undrawn(picture)
        else:
            self._take_picture(picture)
            self._settle()

    def _undrawn(self, trouble: str) -> None:
        """Go on although the shape cannot be drawn, as when strokes leave its start view too little cloth."""
        document = self._state.document
        decided = document.accepted or document.pending
        # After an undo the user goes back past it.
        if document.strokes and not decided and not self._state.redo:
            self._end_auto("warning", f"{trouble} Another start view is chosen; Undo takes it back.")
            self._do(Restart())
            return
        self._trouble = f"{trouble} {UNDRAWN}"
        self._end_auto("error", self._trouble)

    def _show_in_scene(self) -> None:
        """Show the picture in 3D, unless another follows until the scene has time for it."""
        picture = self.picture

        def shown(trouble: str | None) -> None:
            if trouble:
                self.tell(None, "error", trouble)

        show, is_present = partial(self.scene.show, picture), lambda: picture is self.picture
        self.executor.compute("scene", show, shown, "drawing the 3D scene", is_present)

    def _take_picture(self, picture: Picture) -> None:
        # Until it is joined to this shape, the other side is shown as it was.
        picture = replace(picture, other=self.other.made)
        self.picture = picture
        self._show_in_scene()
        self._review.follow(picture)
        document = picture.document
        if document.pending is not None and document.pending.moved:
            self._trying.ask(
                document,
                lambda _: proposal.joins(self.integration, document),
                lambda found: self._found_out(document, found),
            )

    def _found_out(self, document: Document, joins: bool | str) -> None:
        """Show whether a proposal that was moved by hand joins the shape."""
        if isinstance(joins, bool):
            self._joins = document, joins
            self.publish()

    # --- the threads of the computations ---------------------------------------------------------

    def _answer(self, state: SessionState, request: Request, check: Check) -> Answer:
        """Answer the request of a state, and draw the resulting session, in one job."""
        check(0.0, "Starting")
        wait_until_compiled(check, first=request.kind == "start" and self._is_first(state.document))
        made = self._answer_and_picture(state, request, check)
        self._made = made[1] or self._made
        return made

    def _answer_and_picture(self, state: SessionState, request: Request, check: Check) -> Answer:
        event = self.integration.answer(state.document, request, check)
        after = apply(state, event)
        if after.request is not None:
            return event, None
        check(1.0, "drawing")
        picture = attempt(lambda: self._picture_of(after.document), "drawing")
        return event, None if isinstance(picture, str) else picture  # why not is told when it is drawn again

    def _draw(self, document: Document, check: Check) -> Picture:
        wait_until_compiled(first=self._is_first(document))
        if self._made is None:
            self._open(document, check)
        self._made = self._picture_of(document)
        return self._made

    def _open(self, document: Document, check: Check) -> None:
        """Prepare the views of a session that was decided before, and tell how far that is."""
        integration, views = self.integration, sorted(document.used_views)
        if len(views) < 2:
            return
        integration.views.segment(document.strokes, check)
        for n, view in enumerate(reversed(views), start=1):  # another thread may have begun with the first
            check((n - 1) / (2 * len(views)), f"opening view {n} of {len(views)}")
            integration.algorithm.why_unusable(view)
        check(0.5, f"joining {len(views)} views")

    def _is_first(self, document: Document) -> bool:
        # To find the sides of a recording without masks takes more kernels.
        return is_of_one_view(document) and not self.integration.views.finds_sides

    def _picture_of(self, document: Document) -> Picture:
        laid, edge_m, ahead = self.other.laid(document), self.garments.edge_m, self._ahead
        before = ahead if ahead is not None and ahead.document == document else self._made
        return make_picture(self.integration, document, before, laid, edge_m)
