"""ROS recordings, ``.mcap`` and ``.bag``, read in a worker process."""

from __future__ import annotations

import contextlib
from pathlib import Path

from flatcloth.core.plain_files import open_plain
from flatcloth.recordings.base import Recording
from flatcloth.recordings.source import Format, SourceOptions

_STARTS = (b"#ROSBAG V2.0\n", b"\x89MCAP0\r\n", b"SQLite format 3\0")


def _recognises(path: Path) -> bool:
    if path.is_dir():
        with contextlib.suppress(OSError), open_plain(path / "metadata.yaml") as file:
            return b"rosbag2_bagfile_information" in file.read(65_536)
        return False
    try:
        with open_plain(path) as file:
            return file.read(16).startswith(_STARTS)
    except OSError:  # not readable: opening it reports the error
        return False


def _open(path: Path, options: SourceOptions) -> Recording:
    from flatcloth.recordings.isolated import open_ros_isolated

    options.refuse(str(path), "camera_file", "fov_deg", "turning_deg", "sweep")
    return open_ros_isolated(path, options.given_angles)


FORMAT = Format(name="ros", what="a ROS .mcap or .bag", recognises=_recognises, open=_open)
