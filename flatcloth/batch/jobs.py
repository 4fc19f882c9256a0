"""The work of a task's process: one recording, from its source to its row."""

from __future__ import annotations

import contextlib
import gc
import json
import os
import socket
import time
import traceback
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial import cKDTree

from flatcloth import __version__
from flatcloth.api.integrating import integrate, timed
from flatcloth.api.shape import Shape
from flatcloth.batch.rows import DONE, FAILED, MEMORY, UNFINISHED, next_attempt, read_row, write_row
from flatcloth.batch.tasks import Task, content_signature, quick_signature
from flatcloth.checking.check import checked
from flatcloth.core.errors import FlatclothError, JournalError, os_errors_as
from flatcloth.core.geometry import back_project, object_from_camera
from flatcloth.core.memory import trim
from flatcloth.core.subprocess_worker import Message, memory_limit_bytes, serve
from flatcloth.core.types import Float64, Progress
from flatcloth.engine.integration import Integration
from flatcloth.export.garment import garment_document
from flatcloth.flattening.surface import item_mask
from flatcloth.methods.answers import Canonical
from flatcloth.recordings import Recording, open_recording
from flatcloth.rendering.pictures import picture_thumbnail, webp

ERROR_FILE = "error.txt"
SUPERSEDED = ".superseded"
_LOCK_WAIT_S = 15.0
"""Time to wait for a lock: the process of a killed worker closes its session within a second."""


def main() -> None:
    """Answer the requests until the input ends: the program that a worker keeps for its tasks.

    A task that crashes, hangs or fills the memory ends this process and not the worker's.
    """
    cv2.setNumThreads(1)
    serve(answer, FlatclothError)


def answer(question: Mapping[str, Any], progress: Progress) -> Message:
    """Integrate a recording, and answer with its row.

    ``spent`` in the answer means that the process must not be used again.
    """
    task = Task.from_dict(question["task"])
    folder = Path(question["out"]) / task.name
    started = time.perf_counter()
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")  # the peak of memory is that of this task
    seconds: dict[str, float] = {}
    row: dict[str, Any] = {
        "name": task.name,
        "source": task.source,
        "method": task.method,
        "options": json.dumps(task.options.to_dict()),
        "version": __version__,
        "worker": f"{socket.gethostname()}:{os.getpid()}",
        **next_attempt(read_row(folder)),
    }
    spent = False
    try:
        with timed(seconds, "opening"):
            row["quick"] = quick_signature(task)
            row["content"] = content_signature(task)
            kept = _kept(folder, row, again=question["again"])
            if kept is not None:
                return Message(kept)
            if not folder.exists():
                row = {**row, **next_attempt(None), "earlier": None}
            # What is begun is written, so that it is known if this process is killed.
            write_row({**row, "outcome": UNFINISHED, "reason": "it runs, or its worker was killed."}, folder)
            (folder / ERROR_FILE).unlink(missing_ok=True)
        row |= _integrated(task, folder, seconds, progress)
        row["outcome"] = DONE
    except FlatclothError as error:
        row |= {"outcome": FAILED, "reason": str(error)}
    except Exception as error:  # noqa: BLE001 - one recording must not end the others
        spent = True
        row |= _unexpected(error, folder)
    row |= {f"seconds_{name}": round(taken, 3) for name, taken in seconds.items()}
    row |= {
        "seconds": round(time.perf_counter() - started, 3),
        "peak_memory_mb": _peak_memory_mb(),
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
    }
    gc.collect()
    trim()
    write_row(row, folder)
    return Message({**row, "spent": spent})


def _integrated(task: Task, folder: Path, seconds: dict[str, float], progress: Progress) -> dict[str, Any]:
    with timed(seconds, "opening"):
        recording = open_recording(task.source, task.options)
    with timed(seconds, "checking"):
        check = checked(recording, progress=progress)
        if not task.options.as_recorded:
            check.refuse(recording.location)
    shape = _patiently(recording, task.method, folder, progress)
    for name, taken in shape.seconds.items():
        seconds[name] = seconds.get(name, 0.0) + taken
    progress(1.0, "writing")
    with timed(seconds, "writing"):
        shape.write(folder)
    progress(1.0, "measuring")
    with timed(seconds, "measuring"):
        coverage = coverage_estimate(shape.data.integration, shape.data.canonical)
        thumbnail = webp(picture_thumbnail(shape.view, (THUMBNAIL_PX, THUMBNAIL_PX)))
        (folder / THUMBNAIL_FILE).write_bytes(thumbnail)
    known = shape.data.garment
    columns = _outcome_columns(shape.report, shape.data.integration)
    columns["notes"] = " ".join([columns["notes"], *(finding.line for finding in check.findings)]).strip()
    return {
        **columns,
        "coverage_estimate": round(coverage, 4),
        **({} if isinstance(known, str) else garment_columns(garment_document(known, shape.data.sides))),
    }


def garment_columns(garment: Mapping[str, Any]) -> dict[str, Any]:
    """Return the columns of a garment, given as in ``garment.json``."""
    kind, chances = garment["kind"], garment["probabilities"]
    return {
        "garment": "none of these" if kind is None else kind,
        "garment_probability": max(chances.values()) if kind is None else chances.get(kind),
        "dimensions_mm": json.dumps(garment["dimensions_mm"]),
    }


def _patiently(recording: Recording, method: str, folder: Path, progress: Progress) -> Shape:
    """Integrate; wait for a session that another process is about to close."""
    until = time.monotonic() + _LOCK_WAIT_S
    while True:
        try:
            return integrate(recording, method=method, session=folder, progress=progress, cores=1)
        except JournalError as error:
            if "is open in another" not in str(error) or time.monotonic() > until:
                raise
            time.sleep(0.2)


def _outcome_columns(outcome: Mapping[str, Any], integration: Integration) -> dict[str, Any]:
    """Return the columns of an outcome."""
    scores = [a["score"] for a in outcome["accepted"] if a["score"] is not None]
    cameras = outcome.get("cameras", {})
    turned = [abs(view["turned_deg"]) for view in cameras.get("views", ())]
    floating = outcome["floating_cm2"]
    return {
        "views": len(integration.recording),
        "views_used": 1 + len(outcome["accepted"]),
        "views_left": len(outcome["left"]),
        "area_cm2": outcome["area_cm2"],
        "reliable_share": outcome.get("reliable_share", outcome.get("firm_share")),
        "uncertainty_mm": outcome.get("placement_std_median_mm"),
        "floating_cm2": round(sum(floating), 1),
        "floating_pieces": len(floating),
        "least_score": min(scores, default=None),
        "angles_off_deg": max(turned, default=None),
        "cameras": cameras.get("found"),
        "notes": " ".join(integration.notes),
    }


# --- earlier results -------------------------------------------------------------------------


def _kept(folder: Path, row: Mapping[str, Any], *, again: bool) -> dict[str, Any] | None:
    """Return the row of the same task if it is done; move away the result of another task."""
    kept = read_row(folder)
    if kept is not None and kept.get("content") == row["content"] and kept["outcome"] == DONE and not again:
        kept["quick"] = row["quick"]  # the files were touched, but are the same
        write_row(kept, folder)
        return kept
    begun = None if kept is None else kept.get("content")
    if folder.exists() and (again or begun != row["content"]):  # an operator's decisions are in it
        place = folder.parent / SUPERSEDED / f"{folder.name}-{datetime.now(UTC):%Y%m%d-%H%M%S-%f}"
        with os_errors_as(FlatclothError, f"{folder}: cannot be moved to {place}", "Move it by hand."):
            place.parent.mkdir(exist_ok=True)
            folder.rename(place)
    return None


# --- errors, and limits of the process -------------------------------------------------------


def _unexpected(error: Exception, folder: Path) -> dict[str, str]:
    text = " ".join(str(error).split())[:300]
    no_memory = isinstance(error, MemoryError) or (
        isinstance(error, cv2.error) and "nsufficient memory" in text
    )
    if no_memory:
        limit = memory_limit_bytes() / 1e9
        return {
            "outcome": MEMORY,
            "reason": f"needs more than {limit:.1f} GB of memory; give more by --memory.",
        }
    with contextlib.suppress(OSError):
        (folder / ERROR_FILE).write_text(traceback.format_exc())
    reason = f"an error of flatcloth itself ({type(error).__name__}: {text}); see {ERROR_FILE} there."
    return {"outcome": FAILED, "reason": reason}


def _peak_memory_mb() -> float | None:
    with contextlib.suppress(OSError, StopIteration), open("/proc/self/status") as file:
        return round(next(int(line.split()[1]) for line in file if line.startswith("VmHWM")) / 1024, 1)
    return None


# --- coverage, and a thumbnail --------------------------------------------------------------------

THUMBNAIL_FILE = "thumbnail.webp"
THUMBNAIL_PX = 96
"""Longer side of a thumbnail in the report. Chosen."""
_CELL_M = 0.005
"""Cell of the thinned cloud. Chosen: about the distance of the nodes."""
_NEAR_M = 0.012
"""Two cells, and the movement of cloth by a swing or an inexact turn."""
_EVERY_PX = 4
"""Step of the thinning. Chosen."""


def coverage_estimate(integration: Integration, canonical: Canonical) -> float:
    """Estimate which share of the cloth that any view measured is in the shape or a floating piece.

    The surface of the side of interest is collected from all views, object frame, in cells of 5 mm;
    a cell counts as covered if a point of the result lies within 12 mm. Cloth that no view saw is not
    counted, so this is an upper bound of the share of the whole side.
    """
    cells = _cells(np.concatenate([_seen(integration, n) for n in range(len(integration.recording))]))
    pieces = [view.xyz_m[view.valid] for view in (canonical.view, *canonical.floating)]
    shape = _cells(np.concatenate(pieces).astype(np.float64))
    if not len(cells) or not len(shape):
        return 0.0
    distance, _ = cKDTree(shape).query(cells, distance_upper_bound=_NEAR_M)
    return float(np.isfinite(distance).mean())


def _seen(integration: Integration, view_index: int) -> Float64:
    try:
        frame = integration.views.frame(view_index)
        item = item_mask(frame, integration.axis, integration.config.surface)
    except FlatclothError:  # a view that cannot be read, or shows nothing
        return np.zeros((0, 3))
    at = (slice(None, None, _EVERY_PX), slice(None, None, _EVERY_PX))
    usable = (item & (frame.depth_m > 0))[at]
    xyz = back_project(frame.depth_m, frame.intrinsics)[at][usable].astype(np.float64)
    points: Float64 = object_from_camera(integration.axis, frame.angle_deg).apply(xyz)
    return points


def _cells(points: Float64) -> Float64:
    finite = points[np.isfinite(points).all(axis=1)]
    keys = np.floor(finite / _CELL_M).astype(np.int64)
    return np.asarray((np.unique(keys, axis=0) + 0.5) * _CELL_M, dtype=np.float64)
