"""What the benchmarks of whole recordings share: the unattended result, and its inputs read once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from flatcloth.core.resources import sample_recordings
from flatcloth.engine.garment.recognition import GarmentService, place_sure_pieces
from flatcloth.engine.headless import Run
from flatcloth.engine.integration import Integration
from flatcloth.recordings import open_recording
from flatcloth.recordings.truth import read_truth
from flatcloth.session.machine import Document, MemorySession, SessionState


class Remembered:
    """A recording or its truth, of which each view is read once; everything else is the original's."""

    def __init__(self, original: Any) -> None:
        self._original = original
        self._views: dict[int, Any] = {}

    def __len__(self) -> int:
        return len(self._original)

    def __getitem__(self, view_index: int) -> Any:
        if view_index not in self._views:
            self._views[view_index] = self._original[view_index]
        return self._views[view_index]

    def __getattr__(self, name: str) -> Any:
        return getattr(self._original, name)


def sources(recordings: Sequence[str]) -> list[str]:
    """Return the recordings asked for, or the bundled ones."""
    return list(recordings) or sorted(str(path) for path in sample_recordings().values())


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
