"""RealSense files and ROS recordings, read in a worker process, because their libraries are not safe.

librealsense and the readers of ROS files trust the sizes in a file: a damaged or malicious one
makes them crash, hang, or allocate gigabytes. The worker runs :func:`main`.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from flatcloth.core.errors import RecordingError
from flatcloth.core.plain_files import open_plain
from flatcloth.core.subprocess_worker import Message, Worker, WorkerLostError, reader_errors_as, serve
from flatcloth.core.types import Intrinsics, Progress, no_progress
from flatcloth.recordings.base import Format, Recording, ViewImages
from flatcloth.recordings.options import SourceOptions
from flatcloth.recordings.ros.bag import MCAP, ROS_1, ZSTD, data_files

_ROS_STARTS = (ROS_1, MCAP, b"SQLite format 3\0", ZSTD)
_ABOUT = ("name", "description", "location", "notes", "angles_deg")


def open_isolated(
    kind: str,
    path: Path,
    options: SourceOptions,
    align: str | None = None,
    progress: Progress = no_progress,
) -> Recording:
    """Open a recording in a worker process.

    Parameters
    ----------
    kind : str
        ``realsense`` or ``ros``.
    path : Path
        File or folder.
    options : SourceOptions
        What the user knows of the angles.
    align : str, optional
        The camera whose pixels are kept, of a RealSense file.
    progress : callable
        Called with the share of the work done.

    Raises
    ------
    RecordingError
        If a library is missing, the file or a table of angles is not valid, no view is found, or the
        worker fails on the file.
    """
    try:
        worker = Worker(__name__, path)
    except WorkerLostError as error:
        raise RecordingError(f"{path}: its reader {error}. Check the installation.") from error

    def ask(question: Mapping[str, Any], progress: Progress = no_progress) -> Message:
        with reader_errors_as(
            RecordingError, path, "damaged, or not a recording", "Copy or export it again."
        ):
            return worker.ask(question, progress)

    question = {"kind": kind, "path": str(path), "options": options.to_dict(), "align": align}
    about = ask(question, progress).table
    lists = {name: tuple(about[name]) for name in ("notes", "angles_deg")}
    return Recording(
        **{**about, **lists, "intrinsics": Intrinsics(**about["intrinsics"])},
        read=lambda view_index: ViewImages(**ask({"view": view_index}).arrays),
    )


def _is_realsense(path: Path) -> bool:
    from flatcloth.recordings.realsense.player import is_realsense  # opening other kinds does not load it

    return is_realsense(path)


def _is_ros(path: Path) -> bool:
    with contextlib.suppress(OSError):  # not readable: opening it reports the error
        if path.is_dir():
            with contextlib.suppress(OSError), open_plain(path / "metadata.yaml") as file:
                return b"rosbag2_bagfile_information" in file.read(65_536)
            return any(_is_ros(file) and not _is_realsense(file) for file in data_files(path))
        with open_plain(path) as file:
            start = file.read(16)
            return start.startswith(_ROS_STARTS) or (not start and path.suffix == ".mcap")
    return False


_REFUSED = ("camera_file", "fov_deg", "turning_deg", "sweep")
REALSENSE = Format(
    name="realsense",
    what="a RealSense .db3 or .bag",
    recognises=_is_realsense,
    open=functools.partial(open_isolated, "realsense"),
    refuses=_REFUSED,
)
ROS = Format(
    name="ros",
    what="a ROS .mcap or .bag",
    recognises=_is_ros,
    open=functools.partial(open_isolated, "ros"),
    refuses=_REFUSED,
)


# --- the worker ------------------------------------------------------------------------------


def main() -> None:
    """Answer the requests of :func:`open_isolated` until the input ends: open first, then read views."""
    recordings: list[Recording] = []

    def answer(question: Mapping[str, Any], progress: Progress) -> Message:
        if "view" in question:
            frame = recordings[0][question["view"]]
            return Message({}, {"color": frame.color, "depth_m": frame.depth_m})
        path, options = Path(question["path"]), SourceOptions.from_dict(question["options"], "the options")
        if question["kind"] == "ros":
            from flatcloth.recordings.ros.recording import open_ros

            recordings.append(open_ros(path, options, progress))
        else:
            from flatcloth.recordings.realsense.turned import open_realsense

            recordings.append(open_realsense(path, options, question["align"], progress))
        about = {name: getattr(recordings[0], name) for name in _ABOUT}
        return Message({**about, "intrinsics": dataclasses.asdict(recordings[0].intrinsics)})

    serve(answer, RecordingError)
