"""The active loop: a view is taken, the shape grows, and the goal decides the next angle or the end.

It asks and takes views only; whoever turns the item, a person, a robot or a simulated cell, is outside. Every
view is in the recording on disk before it is used, every decision in the session's journal, and what was
expected and got in ``active.jsonl``; so a loop that was killed goes on with the next angle.
"""

from __future__ import annotations

import contextlib
import math
import threading
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from flatcloth.active.choosing import Next, choose_next
from flatcloth.active.ending import FIRST, End, Waiting, elsewhere, end_of
from flatcloth.active.goal import Budget, Goal, Knowledge, knowledge_of
from flatcloth.active.incoming import AngleFinder, SeenView, ViewError, check_view, doubled, stroke_on_side
from flatcloth.active.log import ActiveLog, come_all_round, stand_all_round
from flatcloth.api.integrating import integration_of
from flatcloth.core.errors import FlatclothError, RecordingError
from flatcloth.core.geometry import Rigid3
from flatcloth.core.types import finite
from flatcloth.engine.both_sides import BothSides, known_by_both
from flatcloth.engine.garment.recognition import (
    GarmentService,
    KnownGarment,
    known_with_pieces,
    place_sure_pieces,
)
from flatcloth.engine.headless import Run
from flatcloth.engine.integration import Integration
from flatcloth.export.session import frames_of
from flatcloth.export.session_data import SessionData
from flatcloth.methods.registry import method_name
from flatcloth.recordings.copying import DEPTH_SCALE_M, depth_units
from flatcloth.recordings.film.angles import SAME_VIEW_DEG, apart_deg
from flatcloth.recordings.growing import GrowingRecording
from flatcloth.recordings.manifest import HEADER as MANIFEST
from flatcloth.recordings.manifest import has_views, read_manifest
from flatcloth.recordings.writer import RecordingWriter
from flatcloth.session.commands import paint
from flatcloth.session.header import HEADER, kept_config, take_growth
from flatcloth.session.machine import Document
from flatcloth.session.store import SessionFolder

RECORDING = "recording"
"""The folder of the growing recording, in that of the session."""


@dataclass(frozen=True, kw_only=True)
class Taken:
    """What became of a view: its number, what to tell about it, and what was got by it, in one line."""

    number: int
    told: tuple[str, ...]
    got: str


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
        self._lock = threading.RLock()
        self._stack = contextlib.ExitStack()
        self._recording: GrowingRecording | None = None
        self._integration: Integration | None = None
        self._session: SessionFolder | None = None
        self._run: Run | None = None
        self._garments: GarmentService | None = None
        self._angles: AngleFinder | None = None
        self._both: BothSides | None = None  # once the other side was asked
        self._known: KnownGarment | str = "No view was taken yet."
        self.knowledge, self._expected_m2 = Knowledge(), math.nan
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
        return Document() if self._session is None else self._session.state.document

    @property
    def integration(self) -> Integration | None:
        """What computes the shape; None before the first view."""
        return self._integration

    @property
    def session(self) -> SessionFolder | None:
        """The session; None before the first view."""
        return self._session

    @property
    def known(self) -> KnownGarment | str:
        """The garment of the shape so far, or the reason for none."""
        return self._known

    def held(self) -> threading.RLock:
        """Return the lock of the loop, so that several things are read of one moment."""
        return self._lock

    def take(self, view: SeenView, answers: int | None = None) -> Taken:
        """Take a view, and choose the next angle.

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
        with self._lock:
            check_view(view, self._recording)
            told: list[str] = []
            if self._integration is not None:
                again = doubled(view, self._integration.views)
                if again is not None:
                    text = f"This picture is view {again} already; it is not taken twice."
                    self._log.add("told", text=text)
                    return Taken(number=again, told=(text,), got="")
            if answers is not None and answers != self.views:
                told.append(
                    f"This view answers question {answers}, but {self.views} is asked now: it comes late, and"
                    " is taken at its own angle."
                )
            view, found = self._checked_angle(view)
            told += found
            self._expected_m2 = self.asked.new_m2 if isinstance(self.asked, Next) else math.nan
            return self._after(self._written(view), told)

    def steps(self) -> list[dict[str, Any]]:
        """Return the views taken, each as its line of the log with the ``why`` of its question."""
        why = {line["number"]: line["why"] for line in self._log.lines if line["event"] == "ask"}
        views = (line for line in self._log.lines if line["event"] == "view")
        return [{"why": why.get(line["number"], ""), **line} for line in views]

    def fail(self, text: str) -> None:
        """Note what is wrong with the source of the views; nothing is lost."""
        with self._lock:
            self._log.add("told", text=text)

    def aim(self, goal: Goal, budget: Budget) -> None:
        """Change what is to be known."""
        with self._lock:
            self.goal, self.budget = goal, budget
            self._choose()

    def write(self, base_from_camera: Rigid3 | None = None) -> list[Path]:
        """Write what ``run`` writes to the folder; returns the files, none before the first shape."""
        with self._lock:
            session, integration = self._session, self._integration
            if session is None or integration is None or self.document.start_view is None:
                return []
            garments = GarmentService(integration, self._both)
            both = None if self._both is None else self._both.of
            self._known = place_sure_pieces(garments, session)
            frames = frames_of(integration, self.document, {}, base_from_camera, self.stands_deg)
            data = SessionData(integration, self.document, session.picks, frames, {}, garments, both)
            return data.write(self.folder)

    def close(self) -> None:
        """Release the folder."""
        with self._lock:
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
        try:
            folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        except OSError as error:
            raise RecordingError(
                f"{folder}: cannot be written ({error.strerror}). Choose another folder."
            ) from error
        self._log = ActiveLog(folder)
        self._stack.callback(self._log.close)
        self._began_s, self._earlier_s = time.monotonic(), self._log.seconds
        self._log.add("begin", goal=str(self.goal), budget=str(self.budget), method=self._method)
        if (folder / RECORDING / MANIFEST).exists() and has_views(folder / RECORDING):
            manifest = read_manifest(folder / RECORDING)
            self._begin(
                RecordingWriter(
                    manifest.folder,
                    name=manifest.name,
                    intrinsics=manifest.intrinsics,
                    depth_scale_m=manifest.depth_scale_m,
                    resume=True,
                )
            )
            for number in range(self.views):
                if number not in self.document.used_views | {r.view_index for r in self.document.rejected}:
                    self._integrated(number)
            self._learnt(self.knowledge)
            self._choose()

    def _begin(self, writer: RecordingWriter) -> None:
        """Own the recording of a writer; integrate it if it has views."""
        self._recording = GrowingRecording(writer)
        self._stack.callback(self._recording.close)
        if len(writer):
            self._open_session()

    def _open_session(self) -> None:
        recording, folder = self._recording, self.folder
        assert recording is not None
        take_growth(folder, recording)
        integration = integration_of(recording, self._method, kept_config(folder, self._method))
        session = SessionFolder.open(folder, recording, integration.config, self._method)
        self._stack.callback(session.close)
        integration.views.keep_frames()
        self._integration, self._session = integration, session
        self._run, self._garments = Run(integration, session), GarmentService(integration, doubts_links=False)
        self._angles = AngleFinder(integration.views)

    # ---------------------------------------------------------------- a view

    def _checked_angle(self, view: SeenView) -> tuple[SeenView, list[str]]:
        """Return the view at the angle at which it was taken, and what to tell about it."""
        recording, told = self._recording, []
        if recording is None or self._angles is None:
            return view, []
        if len(recording) >= 2 and recording.rotation_axis is not None:  # an estimated axis is too unsure
            found = self._angles.find(view)
            if found.is_wrong(view.angle_deg):
                told.append(
                    f"The view was announced at {view.angle_deg:g} degrees, but agrees with the others at "
                    f"{found.angle_deg:g}: it is taken there. Check the turntable."
                )
                view = replace(view, angle_deg=found.angle_deg)
        if any(apart_deg(view.angle_deg, taken) < SAME_VIEW_DEG for taken in recording.angles_deg):
            told.append(f"There is a view at {view.angle_deg:g} degrees already: turn the item on.")
            raise ViewError(" ".join(told))
        return view, told

    def _written(self, view: SeenView) -> int:
        if self._recording is None:
            self._begin(
                RecordingWriter(
                    self.folder / RECORDING,
                    name=self.name,
                    description=f"taken by an active loop, by {view.source}",
                    intrinsics=view.intrinsics,
                    depth_scale_m=DEPTH_SCALE_M,
                    rotation_axis=view.axis,
                    held_point_m=view.held_point_m,
                    resume=True,
                )
            )
        assert self._recording is not None
        number = self._recording.add(
            view.angle_deg, view.color, depth_units(view.depth_m), view.mask, view.truth_bgr
        )
        if self._integration is None:
            self._open_session()
            return number
        self._integration.views.grow()
        self._grow_session()
        return number

    def _grow_session(self) -> None:
        assert self._session is not None
        assert self._recording is not None
        self._session.grow(self._recording)

    def _after(self, number: int, told: list[str]) -> Taken:
        """Integrate a view that was written, and choose the next angle."""
        refused = self._integrated(number)
        if refused:
            told.append(f"View {number} is not part of the shape yet: {refused}")
        return Taken(number=number, told=tuple(told), got=self._learn(number, told, joined=not refused))

    def _learn(self, number: int, told: list[str], *, joined: bool) -> str:
        """Learn from a view that was decided, choose the next angle, and return what was got."""
        before = self.knowledge
        got = self._learnt(before)
        self._log.add(
            "view",
            number=number,
            angle_deg=round(self.stands_deg, 3),
            told=told,
            got=got,
            joined=joined,
            new_m2=self.knowledge.area_m2 - before.area_m2,
            surer=self.knowledge.is_surer(before, self.goal),
            expected_m2=finite(self._expected_m2),
            knows=self.knowledge.about(self.goal),
            elapsed_s=round(self.elapsed_s, 2),
        )
        self._choose()
        return got

    def _integrated(self, number: int) -> str:
        """Add a view to the shape, and return the reason if it is not part of it."""
        assert self._run is not None
        try:
            self._keep_side()
            return self._run.add(number)
        except FlatclothError as error:
            return str(error)

    def _keep_side(self) -> None:
        """Say by a stroke which side is of interest, if it is found from the views: further views keep it."""
        assert self._integration is not None
        assert self._session is not None
        views, document = self._integration.views, self.document
        if views.sides is None or document.strokes or document.start_view is not None:
            return
        stroke = stroke_on_side(views)
        if stroke is not None:
            self._session.record(paint(stroke))

    def _learnt(self, before: Knowledge) -> str:
        """Update what is known, and return what was got, in one line."""
        document, integration = self.document, self._integration
        if integration is None or self._run is None or self._garments is None or document.start_view is None:
            return "no shape yet"
        try:
            integration.canonical(document)
        except FlatclothError:  # other masks or another axis left the start view no cloth
            document = self._run.begin_again().document
        area_m2 = integration.canonical(document).view.area_m2
        self._known, self._both = known_with_pieces(self._garments, document), None
        self.knowledge = knowledge_of(self.views, area_m2, self._known)
        parts = []
        for name in self.goal.points:
            was, now = before.point(name), self.knowledge.point(name)
            if math.isfinite(now.std_m):
                since = f"from +-{1e3 * was.std_m:.0f} " if math.isfinite(was.std_m) else ""
                parts.append(f"{name} {since}to +-{1e3 * now.std_m:.0f} mm{'' if now.seen else ', not seen'}")
        parts.append(f"{1e4 * (area_m2 - before.area_m2):.0f} cm2 new")
        return "; ".join(parts)

    # ---------------------------------------------------------------- the next angle, or the end

    def _choose(self) -> None:
        asked = self.asked = self._ended(self._decided())
        if isinstance(asked, End):
            self._log.add("end", reached=asked.reached, reason=asked.reason)
            return
        self._log.add(
            "ask",
            number=self.views,
            angle_deg=asked.angle_deg,
            why=asked.why,
            expected={
                "new_cm2": finite(1e4 * asked.new_m2),
                "std_mm": {name: round(1e3 * std, 1) for name, std in asked.points_m.items()},
            },
        )

    def _ended(self, asked: Next | End) -> Next | End:
        """Ask the other side, too: when views come all round, and before a loop ends without its goal."""
        integration = self._integration
        if integration is None or self.document.start_view is None or self.goal.about == "shape":
            return asked
        if asked.reached if isinstance(asked, End) else not come_all_round(integration.views.angles_deg):
            return asked
        both, known = known_by_both(integration, self.document)
        knowledge = knowledge_of(self.views, self.knowledge.area_m2, known)
        if not knowledge.is_reached(self.goal):
            return asked
        self._both, self._known, self.knowledge = both, known, knowledge
        reason = f"Known by both sides after {self.views} views: {knowledge.about(self.goal)}."
        return End(reached=True, reason=reason)

    def _decided(self) -> Next | End:
        goal, knowledge, document = self.goal, self.knowledge, self.document
        if knowledge.is_reached(goal):
            return End(reached=True, reason=f"Known after {self.views} views: {knowledge.about(goal)}.")
        if self.views >= self.budget.views or self.elapsed_s >= self.budget.seconds:
            spent = f"The budget of {self.budget} is spent: {knowledge.about(goal)}."
            return End(reached=False, reason=spent)
        if document.start_view is None or self._integration is None:
            return elsewhere(self._recording.angles_deg if self._recording else (), self.stands_deg)
        taken, least_m2 = self._integration.views.angles_deg, self._integration.config.robust.least_new_m2
        following = choose_next(
            self._integration,
            document,
            self._known,
            knowledge,
            goal,
            self.stands_deg,
            # Where nobody has looked yet, there may be more than the last views brought.
            scale=self._log.kept_promise() if stand_all_round(taken) else 1.0,
        )
        exhausted = self._log.is_exhausted(taken, least_m2)
        end = end_of(following, self._known, knowledge, goal, least_m2, is_exhausted=exhausted)
        return end or following or FIRST
