"""What the benchmarks of whole recordings share: the unattended result."""

from __future__ import annotations

from typing import Any

from benchmarks.inputs import Remembered
from flatcloth.engine.garment.recognition import GarmentService, place_sure_pieces
from flatcloth.engine.headless import Run
from flatcloth.engine.integration import Integration
from flatcloth.recordings import open_recording
from flatcloth.recordings.truth import read_truth
from flatcloth.session.machine import Document, MemorySession, SessionState


def unattended(source: str) -> tuple[Integration, Document, Remembered]:
    """Integrate a recording by ``robust`` without an operator; return also its truth."""
    integration, document = integrated(Remembered(open_recording(source)))
    return integration, document, Remembered(read_truth(integration.recording.location))


def integrated(recording: Any, method: str | None = None) -> tuple[Integration, Document]:
    """Integrate an open recording without an operator, by default by ``robust``."""
    integration = Integration(recording, method=method)
    session = MemorySession(SessionState(len(recording)))
    Run(integration, session).finish()
    place_sure_pieces(GarmentService(integration), session)  # as ``flatcloth run`` does
    return integration, session.state.document
