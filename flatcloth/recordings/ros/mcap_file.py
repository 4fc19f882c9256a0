"""ROS messages in an MCAP file, in the manner of the readers of ``rosbags``.

Those read what rosbag2 wrote and ended. This one also reads files of other writers, with messages of ROS 2 or
ROS 1, files without an index, and files that are cut off, up to the cut. The library ``mcap`` comes with it.
"""

from __future__ import annotations

import re
import struct
import weakref
from collections.abc import Collection, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from mcap.exceptions import EndOfFile
from mcap.records import Channel, Chunk, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk, get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC

from flatcloth.core.errors import RecordingError
from flatcloth.core.plain_files import open_plain
from flatcloth.recordings.files.text import shortened

_OF_ROS = ("cdr", "ros1")
"""Encodings of messages that are read, of ROS 2 and ROS 1."""


class McapFile:
    """An open MCAP file: ``connections`` are its channels with messages, ``is2`` whether they are of ROS 2.

    Parameters
    ----------
    path : Path
        The file.

    Raises
    ------
    RecordingError
        If it has no messages of ROS. If it is damaged, the library may raise anything.

    Notes
    -----
    The index, which a writer may leave out, is not used: the file is read once, 1 GB in 1 to 4 s.
    """

    def __init__(self, path: Path) -> None:
        self._file = open_plain(path)
        self.close = weakref.finalize(self, self._file.close)
        self.is_cut = False
        self._places: list[tuple[int, int, int]] = []
        """Of each message: its channel, its time (ns), and where it or its chunk begins."""
        names, channels = self._scanned()
        used = sorted({number for number, _, _ in self._places} & channels.keys())
        if not used:
            cut = "cut off before its first whole message" if self.is_cut else "an MCAP file without messages"
            raise RecordingError(f"{path}: {cut}. Copy it again, or record again.")
        kinds = {n: (channels[n].message_encoding, names.get(channels[n].schema_id, "")) for n in used}
        encodings, types = (sorted(set(words)) for words in zip(*kinds.values(), strict=True))
        if set(encodings).isdisjoint(_OF_ROS):
            raise RecordingError(
                f"{path}: an MCAP file, but its messages are {shortened(', '.join(types), 160)} "
                f"({shortened(', '.join(encodings))}), not of ROS. Record the topics of ROS (ros2 bag record "
                "-s mcap), or export color and depth as image files."
            )
        self.is2, self.connections = "cdr" in encodings, []
        for n in used:  # types as ROS 2 spells them, also of ROS 1 and IDL; of others, with the encoding
            encoding, name = kinds[n]
            words = re.split(r"[/:]+", name)
            kind = (
                f"{words[0]}/msg/{words[-1].rstrip('_')}" if encoding in _OF_ROS else f"{name} ({encoding})"
            )
            self.connections.append(
                SimpleNamespace(number=n, topic=channels[n].topic, msgtype=kind, msgcount=1)
            )

    def _scanned(self) -> tuple[dict[int, str], dict[int, Channel]]:
        """Find the messages, up to the end or the cut; return the schemas' names, and channels, by number."""
        names: dict[int, str] = {}
        channels: dict[int, Channel] = {}
        at = self._file.seek(len(MCAP0_MAGIC))
        try:
            for record in StreamReader(self._file, skip_magic=True, emit_chunks=True).records:
                for inner in _unpacked(record):
                    if isinstance(inner, Message):
                        self._places.append((inner.channel_id, inner.log_time, at))
                    elif isinstance(inner, Channel):
                        channels[inner.id] = inner
                    elif isinstance(inner, Schema):
                        names[inner.id] = inner.name
                at = self._file.tell()
        except (EndOfFile, struct.error):
            self.is_cut = True
        return names, channels

    def messages(
        self, connections: Collection[SimpleNamespace], start: int | None = None, stop: int | None = None
    ) -> Iterator[tuple[SimpleNamespace, int, bytes]]:
        """Yield connection, time of writing (ns) and data of messages, from ``start`` to before ``stop``."""
        wanted = {connection.number: connection for connection in connections}
        times = range(start or 0, 2**64 if stop is None else stop)
        for at in sorted({at for number, time, at in self._places if number in wanted and time in times}):
            self._file.seek(at)
            record = next(StreamReader(self._file, skip_magic=True, emit_chunks=True).records)
            for inner in _unpacked(record):
                if isinstance(inner, Message) and inner.channel_id in wanted and inner.log_time in times:
                    yield wanted[inner.channel_id], inner.log_time, inner.data


def _unpacked(record: Any) -> list[Any]:
    """Return the records in a chunk, or a record that is none."""
    if not isinstance(record, Chunk):
        return [record]
    stream, size = get_chunk_data_stream(record, validate_crc=True)
    if size != record.uncompressed_size:
        raise ValueError(f"a chunk has {size} bytes, not {record.uncompressed_size}")
    plain: list[Any] = breakup_chunk(replace(record, compression="", data=stream.read(size)))
    return plain
