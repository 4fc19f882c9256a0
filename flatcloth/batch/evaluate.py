"""One recording with truth: integrated without an operator, and compared with its truth."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

from flatcloth.api.integrating import Sides, integrate
from flatcloth.api.shape import Shape
from flatcloth.core.types import Progress, no_progress
from flatcloth.engine.evaluation import compare
from flatcloth.engine.garment.truth import compare_garment, read_true_points
from flatcloth.engine.results.sides_truth import compare_sides
from flatcloth.export.session_data import SessionData
from flatcloth.recordings import Recording, open_recording
from flatcloth.recordings.truth import Truth


def evaluate_one(
    source: str,
    method: str,
    progress: Progress = no_progress,
    sides: Sides = "one",
) -> dict[str, Any]:
    """Return the figures of a recording, by name.

    Parameters
    ----------
    source : str
        A synthetic recording.
    method : str
        Way of integrating.
    progress : callable
        Called with the progress.
    sides : str
        ``both``: the other side, and its relation to this one, are compared too.

    Raises
    ------
    FlatclothError
        If it cannot be read or integrated, or has no truth.
    """
    recording = open_recording(source)
    truth = Truth(recording.location)
    shape = integrate(recording, method=method, progress=progress, cores=1, sides=sides)
    comparison = compare(shape.view, truth, recording)
    return {
        "recording": recording.name,
        "method": method,
        **dataclasses.asdict(comparison.evaluation),
        "views": list(shape.views),
        "seconds": round(shape.seconds["integrating"], 2),
        **_sides(shape, recording, truth),
        **_garment(shape.data, recording, truth),
    }


def _sides(shape: Shape, recording: Recording, truth: Truth) -> dict[str, Any]:
    """Return the other side and its relation to this one compared with the truth; nothing without it."""
    sides = shape.data.sides
    if sides is None:
        return {}
    if isinstance(sides, str):
        return {"sides": {"reason": sides}}
    return {"sides": dataclasses.asdict(compare_sides(shape.view, sides, truth, recording))}


def _garment(data: SessionData, recording: Recording, truth: Truth) -> dict[str, Any]:
    """Return the garment compared with ``truth/points.json``; nothing where there is none."""
    points = read_true_points(Path(recording.location))
    if points is None:
        return {}
    known = data.garment
    if isinstance(known, str):
        return {"garment": {"kind": None, "true_kind": points.kind, "reason": known}}
    canonical = known.canonical
    compared = compare_garment(known.found, canonical.view, canonical.floating, truth, points, data.sides)
    return {"garment": dataclasses.asdict(compared)}
