"""One recording with truth: integrated without an operator, and compared with its truth."""

from __future__ import annotations

import dataclasses
import time
from pathlib import Path
from typing import Any

from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import Progress, no_progress
from flatcloth.engine.evaluation import Comparison, compare, picture
from flatcloth.engine.garment.recognition import GarmentService, KnownGarment, place_sure_pieces
from flatcloth.engine.garment.truth import compare_garment, read_true_points
from flatcloth.engine.headless import Run
from flatcloth.engine.integration import Integration
from flatcloth.engine.segmenting import prepare
from flatcloth.recordings import open_recording
from flatcloth.recordings.truth import Truth, read_truth
from flatcloth.session.machine import MemorySession, SessionState


def evaluate_one(
    source: str, method: str, pictures: Path | None = None, progress: Progress = no_progress
) -> dict[str, Any]:
    """Return the figures of a recording, by name.

    Parameters
    ----------
    source : str
        A synthetic recording.
    method : str
        Way of integrating.
    pictures : Path, optional
        Folder for a picture of the result beside its truth.
    progress : callable
        Called with the progress.

    Raises
    ------
    FlatclothError
        If it cannot be read or integrated, has no truth, or the picture cannot be written.
    """
    integration = Integration(open_recording(source), method=method, segmenter=prepare)
    recording = integration.recording
    truth = read_truth(recording.location)
    started = time.perf_counter()
    session = MemorySession(SessionState(len(recording)))
    integration.canonical(Run(integration, session).finish(progress).document)
    seconds = time.perf_counter() - started
    known = place_sure_pieces(GarmentService(integration), session)  # as ``run`` does
    document = session.state.document
    view = integration.canonical(document).view
    comparison = compare(view, truth, recording)
    if pictures is not None:
        _write_picture(pictures, recording.name, comparison)
    return {
        "recording": recording.name,
        "method": method,
        **dataclasses.asdict(comparison.evaluation),
        "views": sorted(document.used_views),
        "seconds": round(seconds, 2),
        **_garment(integration, known, truth),
    }


def _garment(integration: Integration, known: KnownGarment | str, truth: Truth) -> dict[str, Any]:
    """Return the garment compared with ``truth/points.json``; nothing where there is none."""
    points = read_true_points(Path(integration.recording.location))
    if points is None:
        return {}
    if isinstance(known, str):
        return {"garment": {"kind": None, "true_kind": points.kind, "reason": known}}
    canonical = known.canonical
    compared = compare_garment(known.found, canonical.view, canonical.floating, truth, points)
    return {"garment": dataclasses.asdict(compared)}


def _write_picture(folder: Path, name: str, comparison: Comparison) -> None:
    import cv2

    folder.mkdir(parents=True, exist_ok=True)
    file = folder / f"{name}.png"
    if not cv2.imwrite(str(file), picture(comparison)[..., ::-1]):
        raise FlatclothError(f"{file}: cannot be written; choose another folder.")
