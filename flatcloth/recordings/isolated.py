"""Recordings read in a worker process, because their libraries are not safe on untrusted files.

librealsense and the readers of ROS files trust the sizes in a file: a damaged or malicious one
makes them crash, hang, or allocate gigabytes.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flatcloth.core.errors import RecordingError
from flatcloth.core.subprocess_worker import Message, Worker, WorkerError, WorkerLostError
from flatcloth.core.types import Float64, Intrinsics, Progress, RgbdFrame, RotationAxis, no_progress
from flatcloth.recordings.base import check_index
from flatcloth.recordings.film.angles import GivenAngles

if TYPE_CHECKING:
    from flatcloth.recordings.realsense.turned import TurnOptions

_READER = "flatcloth.recordings.reader"


class IsolatedRecording:
    """A recording in another process; open it with one of the functions below.

    Its attributes are those of the recording there.
    """

    rotation_axis: RotationAxis | None = None
    held_point_m: Float64 | None = None
    has_masks = False

    def __init__(self, path: Path, question: Mapping[str, Any], progress: Progress) -> None:
        self._path = path
        try:
            self._worker = Worker(_READER, path)
        except WorkerLostError as error:
            raise RecordingError(f"{path}: its reader {error}. Check the installation.") from error
        found = self._asked(question, progress).table
        self.name: str = found["name"]
        self.description: str = found["description"]
        self.location: str = found["location"]
        self.notes: tuple[str, ...] = tuple(found["notes"])
        self.intrinsics = Intrinsics(**found["intrinsics"])
        self.angles_deg: tuple[float, ...] = tuple(found["angles_deg"])

    def __len__(self) -> int:
        """Return the number of views."""
        return len(self.angles_deg)

    def __getitem__(self, view_index: int) -> RgbdFrame:
        """Read one view.

        Raises
        ------
        IndexError
            If there is no such view; negative numbers do not count from the end.
        RecordingError
            If it is damaged, or the other process has ended.
        """
        check_index(self, view_index)
        arrays = self._asked({"view": view_index}, no_progress).arrays
        return RgbdFrame(
            view_index=view_index,
            angle_deg=self.angles_deg[view_index],
            color=arrays["color"],
            depth_m=arrays["depth_m"],
            mask=None,
            intrinsics=self.intrinsics,
        )

    def _asked(self, question: Mapping[str, Any], progress: Progress) -> Message:
        try:
            return self._worker.ask(question, progress)
        except WorkerError as error:
            raise RecordingError(str(error)) from error
        except WorkerLostError as error:
            raise RecordingError(
                f"{self._path}: damaged, or not a recording: its reader {error}. Copy or export it again."
            ) from error


def open_ros_isolated(path: Path, angles: GivenAngles) -> IsolatedRecording:
    """Open a ROS recording in a worker process; see ``ros.open_ros``.

    Raises
    ------
    RecordingError
        As there, and if the worker fails on the file.
    """
    table = None if angles.table is None else str(angles.table)
    question = {"kind": "ros", "path": str(path), "table": table, "step_deg": angles.step_deg}
    return IsolatedRecording(path, question, no_progress)


def open_realsense_isolated(
    path: Path, options: TurnOptions, progress: Progress = no_progress
) -> IsolatedRecording:
    """Open a RealSense file in a worker process; see ``turned.open_realsense``.

    Raises
    ------
    RecordingError
        As there, and if the worker fails on the file.
    """
    question = {
        "kind": "realsense",
        "path": str(path),
        "align": options.align,
        "step_deg": options.step_deg,
        "angles": None if options.angles is None else str(options.angles),
        "turning_speed_deg_s": options.turning_speed_deg_s,
    }
    return IsolatedRecording(path, question, progress)
