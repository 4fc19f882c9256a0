"""The active loop: a view is taken, the shape grows, and the goal decides the next angle or the end.

It asks and takes views only; whoever turns the item, a person, a robot or a simulated cell, is outside. Every
view is in the recording on disk before it is used, every decision in the session's journal, and what was
expected and got in ``active.jsonl``; so a loop that was killed continues with the next angle. The garment is
recognised while the item turns, which takes about as long: the next angle follows from the new shape and the
garment as it was known before.
"""

from __future__ import annotations

import contextlib
import math
import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

from flatcloth.active.choosing import (
    FIRST,
    End,
    Learnt,
    Next,
    Waiting,
    choose_next,
    elsewhere,
    end_of,
    of_other_side,
)
from flatcloth.active.goal import Budget, Goal, Knowledge, knowledge_of
from flatcloth.active.incoming import (
    AngleFinder,
    SeenView,
    Taken,
    ViewError,
    check_view,
    doubled,
    keep_side,
)
from flatcloth.active.log import ActiveLog, stand_all_round
from flatcloth.api.integrating import integration_of
from flatcloth.core.errors import FlatclothError, RecordingError, os_errors_as
from flatcloth.core.geometry import Rigid3
from flatcloth.core.types import finite
from flatcloth.engine.garment import (
    GarmentService,
    KnownGarment,
    known_by_both,
    known_with_pieces,
    place_sure_pieces,
)
from flatcloth.engine.headless import Run
from flatcloth.engine.integration import Integration
from flatcloth.export.data import SessionData
from flatcloth.methods.registry import method_name
from flatcloth.recordings.base import SAME_VIEW_DEG, apart_deg
from flatcloth.recordings.folder import HEADER as MANIFEST
from flatcloth.recordings.folder import open_folder
from flatcloth.recordings.writer import DEPTH_SCALE_M, GrowingRecording, RecordingWriter, depth_units
from flatcloth.session.document import Document
from flatcloth.session.header import HEADER, kept_config
from flatcloth.session.store import SessionFolder

RECORDING = "recording"
"""The folder of the growing recording, in that of the session."""


class ActiveLoop:
    """An active loop in a session folder, new or continued. Its methods may be called from several threads.

    Parameters
    ----------
    folder : Path
        The session folder; the recording grows in ``recording`` in it.
    goal : Goal
        What is to be known.
    budget : Budget
        When the loop ends whatever is known.
    method : str, optional
        As for an integration.
    name : str, optional
        Title of the recording, by default the name of the folder.

    Raises
    ------
    FlatclothError
        If the folder holds something else, is in use, or cannot be written.
    """

    def __init__(
        self,
        folder: Path,
        goal: Goal,
        budget: Budget,
        method: str | None = None,
        name: str | None = None,
    ) -> None:
        self.folder, self.goal, self.budget = folder, goal, budget
        self._method, self.name = method_name(method), name or folder.resolve().name
        self._taking = threading.RLock()
        self.lock = threading.RLock()  # held to read several things of one moment
        self._stack = contextlib.ExitStack()
        self._recording: GrowingRecording | None = None
        # What computes the shape, and the session; None before the first view.
        self.integration: Integration | None = None
        self.session: SessionFolder | None = None
        self._run: Run | None = None
        self.garments: GarmentService | None = None
        self._angles: AngleFinder | None = None
        self._learnt = Learnt()
        self._learning = ThreadPoolExecutor(1, "flatcloth-learning")
        self._last: Future[None] | None = None
        self.asked: Next | Waiting | End = FIRST
        try:
            self._open()
        except BaseException:
            self._stack.close()
            raise

    # ---------------------------------------------------------------- what the owner of the item asks

    @property
    def views(self) -> int:
        """The number of views taken."""
        return 0 if self._recording is None else len(self._recording)

    @property
    def stands_deg(self) -> float:
        """The angle of the last view."""
        return self._recording.angles_deg[-1] if self._recording else 0.0

    @property
    def document(self) -> Document:
        """The decisions so far."""
        return Document() if self.session is None else self.session.state.document

    @property
    def knowledge(self) -> Knowledge:
        """What is known: the cloth by all views, the garment by those from which it was learnt."""
        return self._learnt.knowledge

    @property
    def known(self) -> KnownGarment | str:
        """The garment of the shape so far, or the reason for none."""
        return self._learnt.known

    @property
    def has_learnt(self) -> bool:
        """Whether the garment is known by all views."""
        return self._learnt.views == self.views

    def take(self, view: SeenView, answers: int | None = None) -> Taken:
        """Take a view, and choose the next angle, once the garment is recognised with the view before.

        Parameters
        ----------
        view : SeenView
            The view.
        answers : int, optional
            The number that was asked for; a view that answers an earlier one is late, and taken all the same.

        Raises
        ------
        ViewError
            If it cannot be taken; nothing changes.
        FlatclothError
            If it cannot be written.
        """
        with self._taking:
            self.wait()
            with self.lock:
                return self._taken(view, answers)

    def wait(self) -> None:
        """Wait until the garment is recognised with the last view; the loop may have ended by it."""
        with self._taking:
            last, self._last = self._last, None
            if last is not None:
                last.result()  # raises what the work raised, once

    def steps(self) -> list[dict[str, Any]]:
        """Return the views taken, each as its line of the log with the ``why`` of its question."""
        return self._log.steps()

    def aim_at(self, goal: Goal) -> None:
        """Pursue another goal from now on; a loop that had ended goes on if that is not known yet."""
        with self.lock:
            self.goal = goal
            if not isinstance(self.asked, Waiting):
                self._ask(self._decided())

    def fail(self, text: str) -> None:
        """Note what is wrong with the source of the views; nothing is lost."""
        with self.lock:
            self._log.add("told", text=text)

    def write(self, base_from_camera: Rigid3 | None = None) -> list[Path]:
        """Write what ``run`` writes to the folder; returns the files, none before the first shape."""
        self.wait()
        with self.lock:
            session, integration = self.session, self.integration
            if session is None or integration is None or self.document.start_view is None:
                return []
            both = self._learnt.both
            garments = both or GarmentService(integration)
            self._learnt = replace(self._learnt, known=place_sure_pieces(garments, session))
            if both is None and integration.algorithm.joins_sides:  # this side alone told the garment
                both = GarmentService(integration)
            joined = None if both is None else both.joined
            data = SessionData(
                integration,
                self.document,
                session.picks,
                garments=garments,
                both=joined,
                rotation_deg=self.stands_deg,
                base_from_camera=base_from_camera,
            )
            return data.write(self.folder)

    def close(self) -> None:
        """Wait until the loop has learnt from the last view, then release the folder."""
        self._learning.shutdown()
        with self.lock:
            self._stack.close()

    @property
    def elapsed_s(self) -> float:
        """The time that the loop took, without those between a kill and the next start."""
        return self._earlier_s + time.monotonic() - self._began_s

    # ---------------------------------------------------------------- opening

    def _open(self) -> None:
        folder = self.folder
        if (folder / HEADER).exists() and not (folder / RECORDING / MANIFEST).exists():
            raise RecordingError(f"{folder}: holds the session of another recording. Choose another folder.")
        with os_errors_as(RecordingError, f"{folder}: cannot be written", "Choose another folder."):
            folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        self._log = ActiveLog(folder)
        self._stack.callback(self._log.close)
        self._began_s, self._earlier_s = time.monotonic(), self._log.seconds
        self._log.add("begin", goal=str(self.goal), budget=str(self.budget), method=self._method)
        begun = None
        with contextlib.suppress(RecordingError):  # without a view, or damaged, which the writer reports
            begun = open_folder(folder / RECORDING)
        if begun is not None:
            self._begin(name=begun.name, intrinsics=begun.intrinsics, depth_scale_m=begun.depth_scale_m)
            for number in range(self.views):
                if number not in self.document.used_views | {r.view_index for r in self.document.rejected}:
                    self._integrated(number)
            self._look_at_shape()
            self._learn()
            self._ask(self._decided())

    def _begin(self, **about: Any) -> None:
        """Open the recording, new with what is said ``about`` it; integrate it if it has views."""
        writer = RecordingWriter(self.folder / RECORDING, resume=True, **about)
        self._recording = GrowingRecording(writer)
        self._stack.callback(self._recording.close)
        if len(writer):
            self._open_session()

    def _open_session(self) -> None:
        recording, folder = self._recording, self.folder
        assert recording is not None
        integration = integration_of(recording, self._method, kept_config(folder, self._method))
        session = SessionFolder.open(folder, recording, integration.config, self._method)
        self._stack.callback(session.close)
        integration.views.keep_frames()
        self.integration, self.session = integration, session
        self._run, self.garments = Run(integration, session), GarmentService(integration)
        self._angles = AngleFinder(integration.views)

    # ---------------------------------------------------------------- a view

    def _taken(self, view: SeenView, answers: int | None) -> Taken:
        check_view(view, self._recording)
        told: list[str] = []
        if self.integration is not None:
            again = doubled(view, self.integration.views)
            if again is not None:
                text = f"This picture is view {again} already; it is not taken twice."
                self._log.add("told", text=text)
                return Taken(number=again, told=(text,))
        if answers is not None and answers != self.views:
            told.append(
                f"This view answers question {answers}, but {self.views} is asked now: it comes late, and"
                " is taken at its own angle."
            )
        view, found = self._checked_angle(view)
        told += found
        return self._after(self._written(view), told)

    def _checked_angle(self, view: SeenView) -> tuple[SeenView, list[str]]:
        """Return the view at the angle at which it was taken, and the messages about it."""
        recording, told = self._recording, []
        if recording is None or self._angles is None:
            return view, []
        if len(recording) >= 2 and recording.rotation_axis is not None:  # an estimated axis is too unsure
            true_deg = self._angles.corrected_deg(view)
            if true_deg is not None:
                told.append(
                    f"The view was announced at {view.angle_deg:g} degrees, but agrees with the others at "
                    f"{true_deg:g}: it is taken there. Check the turntable."
                )
                view = replace(view, angle_deg=true_deg)
        if any(apart_deg(view.angle_deg, taken) < SAME_VIEW_DEG for taken in recording.angles_deg):
            told.append(f"There is a view at {view.angle_deg:g} degrees already: turn the item on.")
            raise ViewError(" ".join(told))
        return view, told

    def _written(self, view: SeenView) -> int:
        if self._recording is None:
            self._begin(
                name=self.name,
                description=f"taken by an active loop, by {view.source}",
                intrinsics=view.intrinsics,
                depth_scale_m=DEPTH_SCALE_M,
                rotation_axis=view.axis,
                held_point_m=view.held_point_m,
            )
        assert self._recording is not None
        number = self._recording.add(view.angle_deg, view.color, depth_units(view.depth_m), view.mask)
        if self.integration is None:
            self._open_session()
            return number
        self.integration.views.grow()
        self._grow_session()
        return number

    def _grow_session(self) -> None:
        assert self.session is not None
        assert self._recording is not None
        self.session.grow(self._recording)

    def _after(self, number: int, told: list[str]) -> Taken:
        """Integrate a view that was written, and choose the next angle."""
        refused = self._integrated(number)
        if refused:
            told.append(f"View {number} is not part of the shape yet: {refused}")
        self._answer(number, told, joined=not refused)
        return Taken(number=number, told=tuple(told))

    def _answer(self, number: int, told: list[str], *, joined: bool) -> None:
        """Choose the next angle after a view that was decided, and begin to learn."""
        before, expected_m2 = self.knowledge, math.nan if isinstance(self.asked, End) else self.asked.new_m2
        self._look_at_shape()
        line = {
            "number": number,
            "angle_deg": round(self.stands_deg, 3),
            "told": told,
            "joined": joined,
            "expected_m2": finite(expected_m2),
        }
        decided = self._decided()
        if isinstance(decided, End):  # unless this view tells more
            self._learn_from(before, line, ends=True)
        else:
            self._ask(decided)
            self._last = self._learning.submit(self._learn_from, before, line)

    def _learn_from(self, before: Knowledge, line: dict[str, Any], *, ends: bool = False) -> None:
        """Learn from a view, and log its ``line``; a loop that is not over ends if enough is known."""
        self._learn()
        with self.lock:
            self._log.add(
                "view",
                **line,
                new_m2=self.knowledge.area_m2 - before.area_m2,
                got=self.knowledge.gained(before, self.goal),
                news=self.knowledge.is_news(before, self.goal),
                knows=self.knowledge.about(self.goal),
                elapsed_s=round(self.elapsed_s, 2),
            )
            decided = self._decided()
            if ends or isinstance(decided, End):
                self._ask(decided)

    def _integrated(self, number: int) -> str:
        """Add a view to the shape, and return the reason if it is not part of it."""
        assert self._run is not None
        assert self.integration is not None
        try:
            keep_side(self.integration.views, self._run.session)
            return self._run.add(number)
        except FlatclothError as error:
            return str(error)

    def _look_at_shape(self) -> None:
        """Make the shape of all views, without its picture."""
        if self.integration is not None and self._run is not None and self.document.start_view is not None:
            try:
                self.integration.algorithm.least_m2(self.document)
            except FlatclothError:  # other masks or another axis left the start view no cloth
                self._run.begin_again()

    def _learn(self) -> None:
        """Learn what is known of the present shape, by both sides if this one is not enough.

        Where fewer views told another kind, the kind is less sure.
        """
        document, views, goal, last = self.document, self.views, self.goal, self._learnt
        if self.garments is None or document.start_view is None:
            return
        before = last.before if last.views == views else last.knowledge
        integration = self.garments.integration
        area_m2 = integration.canonical(document).view.area_m2
        known = known_with_pieces(self.garments, document)
        knowledge = knowledge_of(area_m2, known).sobered(before)
        learnt = Learnt(known=known, knowledge=knowledge, views=views, before=before)
        if goal.about != "shape" and not knowledge.is_reached(goal) and len(document.used_views) > 1:
            both, by_both = known_by_both(integration, document)
            if isinstance(by_both, KnownGarment):
                knowledge = knowledge_of(area_m2, by_both).sobered(before)
                learnt = replace(learnt, known=by_both, knowledge=knowledge)
            learnt = replace(learnt, both=both, other=of_other_side(both, document, learnt, goal))
        with self.lock:
            self._learnt = learnt

    # ---------------------------------------------------------------- the next angle, or the end

    def _ask(self, asked: Next | End) -> None:
        self.asked = asked
        if isinstance(asked, End):
            self._log.add("end", reached=asked.reached, reason=asked.reason)
            return
        told = {"angle_deg": asked.angle_deg, "why": asked.why, "expected": asked.expected}
        self._log.add("ask", number=self.views, **told)

    def _decided(self) -> Next | End:
        goal, knowledge, document = self.goal, self.knowledge, self.document
        if knowledge.is_reached(goal):
            return End(reached=True, reason=f"Known after {self.views} views: {knowledge.about(goal)}.")
        if self.views >= self.budget.views or self.elapsed_s >= self.budget.seconds:
            spent = f"The budget of {self.budget} is spent: {knowledge.about(goal)}."
            return End(reached=False, reason=spent)
        if document.start_view is None or self.integration is None:
            return elsewhere(self._recording.angles_deg if self._recording else (), self.stands_deg)
        taken, least_m2 = self.integration.views.angles_deg, self.integration.config.robust.least_new_m2
        kept = self._log.kept_promise()
        following = choose_next(
            self.integration,
            document,
            self._learnt,
            goal,
            self.stands_deg,
            # Where nobody has looked yet, there may be more than the last views brought.
            scale=kept if stand_all_round(taken, goal) else 1.0,
            kept=kept,
        )
        exhausted = self._log.is_exhausted(taken, least_m2, goal)
        end = end_of(following, self._learnt, goal, least_m2, is_exhausted=exhausted)
        return end or following or FIRST
