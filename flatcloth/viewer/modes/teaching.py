"""Serves the stages of :mod:`flatcloth.engine.teaching`; the work is cancelled when the client leaves.

An answer is a sequence of records: the length of a JSON text and of a body (two uint32, little
endian), the text, the body. ``progress`` records come first; the last record is the lesson, whose
arrays and pictures are parts of its body, or an ``error``.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import threading
from collections.abc import AsyncIterator, Callable
from typing import Any

from starlette.requests import Request
from starlette.responses import Response, StreamingResponse

from flatcloth.checking.check import check_lesson
from flatcloth.core.errors import CancelledError
from flatcloth.core.parcel import record
from flatcloth.core.types import Progress
from flatcloth.engine.garment.lesson import garment_lesson
from flatcloth.engine.teaching import Parameters, Teaching
from flatcloth.recordings.mending import Mends
from flatcloth.rendering.evidence import mistaken
from flatcloth.viewer.http import RefusedError
from flatcloth.viewer.modes.controller import PageController
from flatcloth.viewer.modes.lessons import (
    CM2,
    alignment_parcel,
    check_parcel,
    flattening_parcel,
    garment_parcel,
    planning_parcel,
    seams_parcel,
    sides_parcel,
    start_parcel,
)
from flatcloth.viewer.protocol.picture import truth_of
from flatcloth.viewer.worker import attempt

PARTS = ("flattening", "start", "planning", "alignment", "sides", "garment", "seams", "check")
"""The parts: Fig. 2, the start view, Fig. 4a, the rest of Fig. 4, the side of interest, the garment, both
sides, the check."""
_OF_ALL_VIEWS = ("start", "sides", "garment", "seams", "check")
"""Parts without a start view of their own, and without parameters. By definition."""

SLIDERS: dict[str, dict[str, float]] = {
    "sampling_interval_px": {"low": 8, "high": 24, "step": 2},
    "z_angle_limit_deg": {"low": 20, "high": 75, "step": 5},
    "overlap_cm2": {"low": 50, "high": 800, "step": 1},
}
"""The sliders of the page; the valid range is checked by the parameters themselves."""

Tell = Callable[[bytes, bool], None]
"""Called from any thread with a record, and whether it is the last one."""


class TeachingRoutes:
    """Answers the requests of the teaching mode of a page; computes one lesson at a time."""

    def __init__(self, page: PageController) -> None:
        self._page = page
        self._teaching: Teaching | None = None

    async def serve(self, request: Request) -> Response:
        """Answer a request for a part; its parameters come from the address, or from the session."""
        part = request.path_params["part"]
        if part not in PARTS:
            raise RefusedError(f"Unknown part {part!r:.40}; choose one of {', '.join(PARTS)}.", 404)
        asked = _asked(dict(request.query_params), len(self._page.integration.recording))
        return StreamingResponse(
            self._records(part, asked),
            media_type="application/octet-stream",
            headers={"Cache-Control": "no-store"},
        )

    async def _records(self, part: str, asked: dict[str, Any]) -> AsyncIterator[bytes]:
        """Yield records as they are made, until the last one or until the client leaves."""
        loop, records = asyncio.get_running_loop(), asyncio.Queue[tuple[bytes, bool]]()
        cancelled = threading.Event()

        def tell(data: bytes, last: bool) -> None:
            if not loop.is_closed():
                loop.call_soon_threadsafe(records.put_nowait, (data, last))

        self._compute(part, asked, tell, cancelled)
        try:
            last = False
            while not last:
                data, last = await records.get()
                yield data
        finally:
            cancelled.set()

    def _compute(self, part: str, asked: dict[str, Any], tell: Tell, cancelled: threading.Event) -> None:
        def progress(share: float, text: str) -> None:
            if cancelled.is_set():
                raise CancelledError
            tell(record({"kind": "progress", "share": share, "text": text}), False)

        def make() -> bytes:
            progress(0.0, "Starting")
            return self._lesson(part, asked, progress)

        def job() -> None:
            with contextlib.suppress(CancelledError):
                made = attempt(make, "computing")
                tell(record({"kind": "error", "text": made}) if isinstance(made, str) else made, True)

        self._page.executor.put("teaching", job)

    def _lesson(self, part: str, asked: dict[str, Any], progress: Progress) -> bytes:
        if self._teaching is None or self._teaching.views != len(self._page.integration.recording):
            self._teaching = Teaching(self._page.integration)  # of an active loop, the recording grows
        teaching, defaults = self._teaching, _plain(self._teaching.defaults)
        start = asked["start_view"]
        if start is None and part not in _OF_ALL_VIEWS:
            start = teaching.start_view(progress)
        parameters = _parameters({**defaults, **{k: v for k, v in asked.items() if k in defaults}})
        axis, recording = self._page.integration.axis, self._page.integration.recording
        view = 0 if start is None else start
        match part:
            case "flattening":
                lesson = teaching.flattening(view, parameters, progress)
                parcel = flattening_parcel(lesson, axis, truth_of(recording))
            case "planning":
                parcel = planning_parcel(teaching.planning(view, parameters, progress), axis)
            case "start":
                parcel = start_parcel(teaching.start(progress), axis, start)
            case "sides":
                parcel = sides_parcel(teaching.sides(progress))
            case "garment":
                parcel = garment_parcel(garment_lesson(self._page.garments.last, progress), axis)
            case "seams":
                parcel = seams_parcel(self._page.other_sheet)
            case "check":
                checked = check_lesson(recording, self._page.integration.views.recorded, axis)
                views = checked.pair.first, checked.pair.second
                mistakes = {
                    "turned back": Mends(reverse=True),
                    "twice as far": Mends(angle_factor=2.0),
                    "longer lens": Mends(focal_factor=1.3),
                }
                parcel = check_parcel(checked, mistaken(recording, views, mistakes))
            case _:
                parcel = alignment_parcel(teaching.alignment(view, parameters, progress), axis)
        common = {
            "kind": part,
            "parameters": _plain(parameters),
            "defaults": defaults,
            # The range of a slider includes the session's own value.
            "sliders": {
                name: {**slider, "low": min(slider["low"], own), "high": max(slider["high"], own)}
                for (name, own), slider in zip(defaults.items(), SLIDERS.values(), strict=True)
            },
            "recording": recording.name,
            "start_view": view,
            "angles_deg": list(recording.angles_deg),
        }
        return parcel.pack(common)


# --- the question ----------------------------------------------------------------------------------


def _plain(parameters: Parameters) -> dict[str, float]:
    return {
        "sampling_interval_px": parameters.sampling_interval_px,
        "z_angle_limit_deg": parameters.z_angle_limit_deg,
        "overlap_cm2": round(parameters.overlap_area_m2 * CM2, 6),
    }


def _parameters(values: dict[str, float]) -> Parameters:
    return Parameters(
        sampling_interval_px=int(values["sampling_interval_px"]),
        z_angle_limit_deg=values["z_angle_limit_deg"],
        overlap_area_m2=values["overlap_cm2"] / CM2,
    )


def _asked(given: dict[str, str], n_views: int) -> dict[str, Any]:
    """Read the parameters of an address.

    Raises
    ------
    RefusedError
        If a parameter is unknown or not a valid number.
    """
    known: dict[str, Callable[[str], float]] = {
        "start_view": int,
        "sampling_interval_px": int,
        "z_angle_limit_deg": float,
        "overlap_cm2": float,
        "revision": int,  # of garment or other side: the page asks again when it has changed
    }
    asked: dict[str, Any] = {"start_view": None}
    for name, text in given.items():
        if name not in known:
            raise RefusedError(f"Unknown parameter {name!r:.40}; choose one of {', '.join(known)}.", 400)
        try:
            value = known[name](text)
            is_valid = math.isfinite(value)
        except (ValueError, OverflowError):
            is_valid = False
        if not is_valid:
            raise RefusedError(f"{name}: {text!r:.40} is not a valid number.", 400)
        asked[name] = value
    start = asked["start_view"]
    if start is not None and not 0 <= start < n_views:
        raise RefusedError(f"start_view: the recording has {n_views} views, none numbered {start}.", 400)
    return asked
