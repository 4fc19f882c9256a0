"""One recording, unattended, from its source to the files of its session folder."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from flatcloth.core.geometry import Rigid3
from flatcloth.core.strokes import Decision
from flatcloth.core.types import Progress, Uint8, no_progress
from flatcloth.engine.garment.recognition import GarmentService, KnownGarment, place_sure_pieces
from flatcloth.engine.headless import Run
from flatcloth.engine.integration import Integration
from flatcloth.engine.outcome import earlier_scores
from flatcloth.engine.results.pixel_states import pixel_counts
from flatcloth.engine.segmenting import take_strokes
from flatcloth.export.session import frames_of
from flatcloth.export.session_data import SessionData
from flatcloth.grasping.grips import read_grips
from flatcloth.methods.base import Canonical
from flatcloth.session.axis_file import settle_axis
from flatcloth.session.store import SessionFolder

_MOST_WRITERS = 2
"""Files written at the same time. Chosen: two take nearly all of the time, the arrays and the grasp poses."""


@dataclass(frozen=True, kw_only=True)
class Integrated:
    """A finished integration: the report, the shape behind it, and the files that were written.

    ``garment`` is what the shape was recognised as, or why nothing can be said of it.
    """

    outcome: dict[str, Any]
    canonical: Canonical
    garment: KnownGarment | str
    files: list[Path]


@dataclass
class Stages:
    """Seconds of wall time by stage."""

    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add the time of a block to a stage."""
        started = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - started


def integrate(
    integration: Integration,
    out: Path,
    *,
    base_from_camera: Rigid3 | None = None,
    strokes: Sequence[Decision] = (),
    progress: Progress = no_progress,
    stages: Stages | None = None,
    cores: int = 1,
) -> Integrated:
    """Integrate a recording without an operator, and write the result to its session folder.

    A session that is there is resumed.

    Parameters
    ----------
    integration : Integration
        Of the recording.
    out : Path
        The session folder.
    base_from_camera : Rigid3, optional
        Hand-eye transform, for grasp poses in the robot's frame.
    strokes : sequence of Decision
        Strokes and cuts that say which side is of interest, for a recording without masks.
    progress : callable
        Told how far the work is.
    stages : Stages, optional
        Told how long each stage took.
    cores : int
        Cores that this integration has for itself; the result does not depend on it.

    Raises
    ------
    FlatclothError
        If nothing can be flattened, or the folder cannot be written.
    """
    stages = stages or Stages()
    integration.flattens_ahead = cores > 1
    folder = SessionFolder.open(
        out, integration.recording, integration.config, integration.method, integration.source_options
    )
    try:
        settle_axis(folder.folder, integration)
        take_strokes(integration, folder, strokes)
        with stages.stage("integrating"):
            if cores > 1:
                integration.segment(folder.state.document.strokes, progress)
                integration.begin_beside()
            unattended = Run(integration, folder)
            document = unattended.finish(progress).document
            integration.end_beside()
            integration.canonical(document)
        frames = frames_of(integration, document, read_grips(out), base_from_camera)
        scores = {**earlier_scores(out), **_scores_of(unattended)}
        service = GarmentService(integration)
        data = SessionData(integration, document, folder.picks, frames, scores, service)
        beside = integration.copied(lambda _: _made_beside(data)) if cores > 1 else None
        if beside is not None:
            beside.want([0])
        with stages.stage("garment"):
            garment = place_sure_pieces(service, folder)
        decided = folder.state.document
        is_same_shape = decided.garment.parts == document.garment.parts
        with stages.stage("writing"):
            made = beside.take(0) if beside is not None and is_same_shape else None
            pixels, files_made = made or (None, {})
            data = replace(data, document=decided, pixels=pixels, made=files_made)
            if beside is not None:
                beside.close()
        progress(1.0, "writing")
        with stages.stage("writing"):
            files = data.write(out, min(cores, _MOST_WRITERS))
    finally:
        integration.end_beside()
        folder.close()
    return Integrated(outcome=data.outcome, canonical=data.canonical, garment=garment, files=files)


def _made_beside(data: SessionData) -> tuple[dict[str, int], dict[str, Uint8]]:
    """Return the counts of pixels and the files of the shape: no decision about the garment matters."""
    return pixel_counts(data.integration, data.document), data.made_of_shape()


def _scores_of(run: Run) -> dict[int, float]:
    return {d.view_index: d.score for d in run.decisions if d.accepted and math.isfinite(d.score)}
