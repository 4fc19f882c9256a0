"""The kinds of sources, told apart by what is in them; each is opened by a module of its own.

A reader is imported when its kind is opened: nobody needs the library of another's files.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from flatcloth.core.plain_files import open_plain
from flatcloth.recordings.base import Recording
from flatcloth.recordings.film.angles import GivenAngles
from flatcloth.recordings.manifest import HEADER

_BAG = b"#ROSBAG V2.0\n"
_MCAP = b"\x89MCAP0\r\n"
_SQLITE = b"SQLite format 3\0"


@dataclass(frozen=True)
class Kind:
    """A kind of source: how messages call it, whether a path is one, and how it is opened."""

    what: str
    recognises: Callable[[Path], bool]
    open: Callable[[Path, GivenAngles], Recording]


def _is_native(path: Path) -> bool:
    return (path / HEADER).exists()


def _open_native(path: Path, angles: GivenAngles) -> Recording:
    from flatcloth.recordings.folder import FolderRecording

    angles.refuse(str(path))
    return FolderRecording(path)


def _is_tum(path: Path) -> bool:
    from flatcloth.recordings.formats.foreign import is_tum

    return is_tum(path)


def _open_tum(path: Path, angles: GivenAngles) -> Recording:
    from flatcloth.recordings.formats.foreign import open_tum

    return open_tum(path, angles)


def _is_color_and_depth(path: Path) -> bool:
    from flatcloth.recordings.formats.foreign import is_color_and_depth

    return is_color_and_depth(path)


def _open_color_and_depth(path: Path, angles: GivenAngles) -> Recording:
    from flatcloth.recordings.formats.foreign import open_color_and_depth

    return open_color_and_depth(path, angles)


def _is_realsense(path: Path) -> bool:
    from flatcloth.recordings.realsense.player import is_realsense

    return path.is_file() and is_realsense(path)


def _open_realsense(path: Path, angles: GivenAngles) -> Recording:
    from flatcloth.recordings.isolated import open_realsense_isolated
    from flatcloth.recordings.realsense.turned import TurnOptions

    options = TurnOptions(angles=angles.table)
    if angles.step_deg is not None:
        options = replace(options, step_deg=angles.step_deg)
    return open_realsense_isolated(path, options)


def _is_ros(path: Path) -> bool:
    if path.is_dir():
        with contextlib.suppress(OSError), open_plain(path / "metadata.yaml") as file:
            return b"rosbag2_bagfile_information" in file.read(65_536)
        return False
    return _first_bytes(path).startswith((_BAG, _MCAP, _SQLITE))


def _open_ros(path: Path, angles: GivenAngles) -> Recording:
    from flatcloth.recordings.isolated import open_ros_isolated

    return open_ros_isolated(path, angles)


KINDS = (
    Kind(f"a recording folder (one with a {HEADER} in it)", _is_native, _open_native),
    Kind("a TUM RGB-D folder", _is_tum, _open_tum),
    Kind("a folder with color/, depth/ and intrinsic.json", _is_color_and_depth, _open_color_and_depth),
    Kind("a RealSense .db3 or .bag", _is_realsense, _open_realsense),
    Kind("a ROS .mcap or .bag", _is_ros, _open_ros),
)
"""In the order in which they are tried."""


def _first_bytes(path: Path) -> bytes:
    try:
        with open_plain(path) as file:
            return file.read(16)
    except OSError:  # a folder, or not readable: whoever opens it says so
        return b""
