"""What the benchmarks share: the unattended result and sides without masks."""

from __future__ import annotations

from typing import Any

from benchmarks.inputs import Remembered
from flatcloth.core.config import Config
from flatcloth.engine.garment import GarmentService, place_sure_pieces
from flatcloth.engine.headless import Run
from flatcloth.engine.integration import Integration
from flatcloth.recordings import open_recording
from flatcloth.recordings.truth import Truth
from flatcloth.segmentation.observed import gather_evidence
from flatcloth.segmentation.solver import SideSolver
from flatcloth.session.document import Document
from flatcloth.session.machine import MemorySession, SessionState


def unattended(source: str) -> tuple[Integration, Document, Remembered]:
    """Integrate a recording by ``robust`` without an operator; return also its truth."""
    integration, document = integrated(Remembered(open_recording(source)))
    return integration, document, Remembered(Truth(integration.recording.location))


def integrated(recording: Any, method: str | None = None) -> tuple[Integration, Document]:
    """Integrate one side of an open recording without an operator, by default by ``robust``."""
    integration = Integration(recording, method=method)
    service = GarmentService(integration)
    return integration, _placed(service, Run(integration, MemorySession(SessionState(len(recording)))))


def both_sides(source: str) -> tuple[GarmentService, Document, Remembered]:
    """Integrate both sides of a recording by ``robust`` without an operator; return also its truth."""
    recording = Remembered(open_recording(source))
    return *integrated_sides(recording), Remembered(Truth(recording.location))


def integrated_sides(recording: Any) -> tuple[GarmentService, Document]:
    """Integrate both sides of an open recording by ``robust`` without an operator."""
    integration = Integration(recording)
    service = GarmentService(integration)
    run = Run(integration, MemorySession(SessionState(len(recording))))
    service.joined(run.finish().document)
    return service, _placed(service, run)


def _placed(service: GarmentService, run: Run) -> Document:
    """Return the decisions of a run, with the pieces whose place is sure, as ``flatcloth run`` makes them."""
    run.finish()
    place_sure_pieces(service, run.session)
    return run.session.state.document


def side_solver(recording: Any, every: int = 1) -> SideSolver:
    """Return what finds the sides of a recording without its masks, by each view of so many."""
    integration = Integration(recording)
    frames = [recording[n] for n in range(0, len(recording), every)]
    return SideSolver(gather_evidence(frames, integration.axis, integration.views.held_point_m, Config()))
