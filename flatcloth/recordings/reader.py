"""Main program of the worker process that reads a recording for ``isolated``; not to be imported."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from flatcloth.core.errors import RecordingError
from flatcloth.core.subprocess_worker import Message, serve
from flatcloth.core.types import Progress
from flatcloth.recordings.base import Recording
from flatcloth.recordings.film.angles import GivenAngles


def _opened(question: Mapping[str, Any], progress: Progress) -> Recording:
    path = Path(question["path"])
    if question["kind"] == "ros":
        from flatcloth.recordings.ros.recording import open_ros

        table = question["table"]
        given = GivenAngles(table=None if table is None else Path(table), step_deg=question["step_deg"])
        return open_ros(path, given, progress)
    from flatcloth.recordings.realsense.turned import TurnOptions, open_realsense

    angles = question["angles"]
    options = TurnOptions(
        align=question["align"],
        step_deg=question["step_deg"],
        angles=None if angles is None else Path(angles),
        turning_speed_deg_s=question["turning_speed_deg_s"],
    )
    return open_realsense(path, options, progress)


class _Reader:
    """Answers the requests of ``IsolatedRecording``: the first one opens, the others read views."""

    def __init__(self) -> None:
        self._recording: Recording | None = None

    def answer(self, question: Mapping[str, Any], progress: Progress) -> Message:
        if self._recording is None:
            self._recording = _opened(question, progress)
            return Message(_description(self._recording))
        frame = self._recording[question["view"]]
        return Message({}, {"color": frame.color, "depth_m": frame.depth_m})


def _description(recording: Recording) -> dict[str, Any]:
    return {
        "name": recording.name,
        "description": recording.description,
        "location": recording.location,
        "notes": list(getattr(recording, "notes", ())),
        "intrinsics": dataclasses.asdict(recording.intrinsics),
        "angles_deg": list(recording.angles_deg),
    }


if __name__ == "__main__":
    serve(_Reader().answer, RecordingError)
