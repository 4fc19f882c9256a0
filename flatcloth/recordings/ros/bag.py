"""A ROS recording as a file: its image topics, the times of their messages, and single messages.

``rosbags`` reads ROS 1 bags, and ROS 2 recordings as MCAP or SQLite, without ROS. It is imported
only here, when such a file is opened.
"""

from __future__ import annotations

import contextlib
import struct
import threading
import weakref
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flatcloth.core.errors import RecordingError
from flatcloth.recordings.files.text import shortened

RAW, COMPRESSED, CAMERA_INFO = (
    f"sensor_msgs/msg/{name}" for name in ("Image", "CompressedImage", "CameraInfo")
)


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
        try:
            from rosbags.highlevel import AnyReader
            from rosbags.typesys import Stores, get_typestore
        except ImportError as error:
            raise RecordingError(
                f"{path}: reading ROS recordings needs the library rosbags, which is missing ({error}). "
                "Run: pip install 'flatcloth[ros]'"
            ) from error
        with self._read_errors():
            # ROS 2 recordings made before 2023 contain no definitions; those of images have not changed.
            self._reader = AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE))
            self._reader.open()
        weakref.finalize(self, self._reader.close)
        self._topics: dict[str, tuple[str, list[Any]]] = {}
        for connection in self._reader.connections:
            kind, connections = self._topics.setdefault(connection.topic, (connection.msgtype, []))
            if kind == connection.msgtype and connection.msgcount:
                connections.append(connection)

    def topics(self, *kinds: str) -> list[str]:
        """Return the topics of these message types that have messages, in alphabetical order."""
        return sorted(t for t, (kind, connections) in self._topics.items() if kind in kinds and connections)

    def first(self, topic: str) -> Any:
        """Return the first message of a topic.

        Raises
        ------
        RecordingError
            If it is damaged.
        """
        kind, connections = self._topics[topic]
        with self._read_errors(), self._lock:
            _, _, raw = next(self._reader.messages(connections=connections))
            return self._reader.deserialize(raw, kind)

    def stamps(self, topic: str) -> list[tuple[Place, float]]:
        """Return the position of each message of a topic, and its time stamp in seconds (0 if it has none).

        Raises
        ------
        RecordingError
            If the file is damaged.

        Notes
        -----
        Reads the whole topic: 0.2 s for 300 MB that are in the system's cache.
        """
        _, connections = self._topics[topic]
        found, seen = [], Counter[int]()
        with self._read_errors(), self._lock:
            for _, written_ns, raw in self._reader.messages(connections=connections):
                found.append((Place(written_ns, seen[written_ns]), self._stamp_s(raw)))
                seen[written_ns] += 1
        return found

    def message(self, topic: str, place: Place) -> Any:
        """Return one message.

        Raises
        ------
        RecordingError
            If it is damaged, or was removed since the recording was opened.
        """
        kind, connections = self._topics[topic]
        start = place.written_ns
        with self._read_errors(), self._lock:
            found = self._reader.messages(connections=connections, start=start, stop=start + 1)
            for number, (_, _, raw) in enumerate(found):
                if number == place.number:
                    return self._reader.deserialize(raw, kind)
        raise RecordingError(f"{self._path}: has changed since it was opened. Open it again.")

    def _stamp_s(self, raw: bytes | memoryview) -> float:
        """Time stamp of a message that begins with a header; only the header is read."""
        if self._reader.is2:  # CDR: the first four bytes give the byte order
            order = "<" if raw[1] & 1 else ">"
            seconds, nanoseconds = struct.unpack_from(order + "iI", raw, 4)
        else:
            seconds, nanoseconds = struct.unpack_from("<II", raw, 4)
        return float(seconds) + 1e-9 * float(nanoseconds)

    @contextlib.contextmanager
    def _read_errors(self) -> Iterator[None]:
        try:
            yield
        except (RecordingError, MemoryError):
            raise
        except Exception as error:  # on a damaged file the library may raise anything
            text = shortened(" ".join(str(error).split()), 160) or type(error).__name__
            raise RecordingError(
                f"{self._path}: cannot be read as a ROS recording ({text}). "
                "Copy it again, or repair it with ros2 bag reindex (rosbag reindex)."
            ) from error
