"""A ROS recording as a file: its image topics, the times of their messages, and single messages.

``rosbags`` reads ROS 1 bags, ROS 2 recordings in SQLite and in folders, and decodes messages, without ROS; it
is imported only here, when such a file is opened. MCAP files are read by :mod:`.mcap_file`.
"""

from __future__ import annotations

import contextlib
import struct
import threading
import weakref
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flatcloth.core.errors import RecordingError
from flatcloth.core.plain_files import open_plain
from flatcloth.recordings.files.text import library_errors_as

RAW, COMPRESSED, CAMERA_INFO = (
    f"sensor_msgs/msg/{name}" for name in ("Image", "CompressedImage", "CameraInfo")
)
MCAP, ROS_1 = b"\x89MCAP0\r\n", b"#ROSBAG "
ZSTD = b"\x28\xb5\x2f\xfd"
"""How files begin; the last one those that rosbag2 has packed as a whole."""
_REPAIRS = {".mcap": "mcap recover", ".bag": "rosbag reindex", ".active": "rosbag reindex"}


@dataclass(frozen=True)
class Place:
    """Position of a message: the time it was written (ns), and its number among those of that time."""

    written_ns: int
    number: int


class Bag:
    """An open ROS recording; several threads may read from it.

    Parameters
    ----------
    path : Path
        A ``.bag`` of ROS 1, a ``.mcap`` or ``.db3`` of ROS 2, or the folder of a ROS 2 recording.

    Raises
    ------
    RecordingError
        If ``rosbags`` is missing, or the file is damaged or of another format.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lock = threading.Lock()
        with self._read_errors():
            try:
                from rosbags.typesys import Stores, get_typestore

                self._reader, is_ros2 = _opened(path)
            except ImportError as error:
                raise RecordingError(
                    f"{path}: reading ROS recordings needs the library {error.name}, which is missing "
                    f"({error}). Run: pip install 'flatcloth[ros]'"
                ) from error
        # The messages that are read here have not changed since: definitions in the file are not needed.
        store = get_typestore(Stores.ROS2_HUMBLE if is_ros2 else Stores.ROS1_NOETIC)
        self._is_ros2, self._decode = is_ros2, store.deserialize_cdr if is_ros2 else store.deserialize_ros1
        weakref.finalize(self, self._reader.close)
        is_cut = getattr(self._reader, "is_cut", False)
        self.notes = ("The file is cut off or damaged: only what comes before is read.",) if is_cut else ()
        self._topics: dict[str, tuple[str, list[Any]]] = {}
        for connection in self._reader.connections:
            kind, connections = self._topics.setdefault(connection.topic, (connection.msgtype, []))
            if kind == connection.msgtype and connection.msgcount:
                connections.append(connection)

    def kinds(self) -> dict[str, str]:
        """Return the type of the messages of each topic that has any, in alphabetical order."""
        return {topic: kind for topic, (kind, connections) in sorted(self._topics.items()) if connections}

    def stamps(self, *topics: str) -> list[list[tuple[Place, float]]]:
        """Return the position of each message of topics, and its time stamp in seconds.

        It is the time of writing if no message of the topic has a stamp.

        Notes
        -----
        Reads the topics: 0.2 s for 300 MB that are in the system's cache.
        """
        found: dict[str, list[tuple[Place, float]]] = {topic: [] for topic in topics}
        seen = Counter[tuple[str, int]]()
        connections = [connection for topic in topics for connection in self._topics[topic][1]]
        with self._read_errors(), self._lock:
            for connection, written_ns, raw in self._reader.messages(connections=connections):
                # Only the header is read; of CDR, the first four bytes give the byte order.
                kind = "<II" if not self._is_ros2 else "<iI" if raw[1] & 1 else ">iI"
                seconds, nanoseconds = struct.unpack_from(kind, raw, 4)
                message = connection.topic, written_ns
                stamp_s = float(seconds) + 1e-9 * float(nanoseconds)
                found[connection.topic].append((Place(written_ns, seen[message]), stamp_s))
                seen[message] += 1
        for topic, stamps in found.items():
            if not any(stamp_s for _, stamp_s in stamps):
                found[topic] = [(place, 1e-9 * place.written_ns) for place, _ in stamps]
        return list(found.values())

    def message(self, topic: str, place: Place | None = None) -> Any:
        """Return one message of a topic, without a place its first."""
        kind, connections = self._topics[topic]
        start, stop = (None, None) if place is None else (place.written_ns, place.written_ns + 1)
        with self._read_errors(), self._lock:
            found = self._reader.messages(connections=connections, start=start, stop=stop)
            for number, (_, _, raw) in enumerate(found):
                if place is None or number == place.number:
                    return self._decode(raw, kind)
        raise RecordingError(f"{self._path}: has changed since it was opened. Open it again.")

    def _read_errors(self) -> contextlib.AbstractContextManager[None]:
        repair = _REPAIRS.get(self._path.suffix, "ros2 bag reindex")
        remedy = f"Copy it again, or repair it with {repair}."
        return library_errors_as(f"{self._path}: cannot be read as a ROS recording", remedy)


def data_files(folder: Path) -> list[Path]:
    """Return the files in a folder that may have the messages of a ROS 2 recording."""
    return sorted(file for file in folder.iterdir() if file.suffix in (".mcap", ".db3"))


def _opened(path: Path) -> tuple[Any, bool]:
    """Return the reader of a file or folder, and whether its messages are of ROS 2; names may mislead."""
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2

    if path.is_dir() and not (path / "metadata.yaml").exists():
        file, *others = data_files(path)
        if others:
            raise RecordingError(
                f"{path}: has several files, but no metadata.yaml. Run: ros2 bag reindex {path}"
            )
        path = file
    start = b""
    if path.is_file():
        with open_plain(path) as plain:
            start = plain.read(len(MCAP))
        if not start:
            raise RecordingError(f"{path}: empty. Record it again.")
        if start.startswith(ZSTD):
            raise RecordingError(f"{path}: packed. Name the folder of its recording, or unpack it: zstd -d")
    if start == MCAP:
        from flatcloth.recordings.ros.mcap_file import McapFile

        mcap_file = McapFile(path)
        return mcap_file, mcap_file.is2
    is_ros2 = start != ROS_1
    kind = Reader2.STORAGE_PLUGINS["dir" if path.is_dir() else ".db3"] if is_ros2 else Reader1
    reader = kind(path)
    reader.open()
    return reader, is_ros2
