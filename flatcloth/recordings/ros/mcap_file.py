"""ROS messages in an MCAP file, in the manner of the readers of ``rosbags``.

Those read what rosbag2 wrote and ended. This one also reads files of other writers, with messages of ROS 2 or
ROS 1, files without an index, and files that are cut off, up to the cut. The library ``mcap`` comes with it.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from mcap.reader import make_reader
from mcap.records import Channel, Chunk, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk, get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC

from flatcloth.core.errors import RecordingError
from flatcloth.core.plain_files import open_plain
from flatcloth.recordings.files.text import shortened

_OF_ROS = ("cdr", "ros1")
"""Encodings of messages that are read, of ROS 2 and ROS 1."""


class McapFile:
    """An open MCAP file: ``connections`` are its channels, ``is2`` whether they are of ROS 2.

    Parameters
    ----------
    path : Path
        The file.

    Raises
    ------
    RecordingError
        If it has no messages of ROS. If it is damaged, the library may raise anything.
    """

    def __init__(self, path: Path) -> None:
        self._file = open_plain(path)
        self.close = self._file.close
        length = self._file.seek(-len(MCAP0_MAGIC), 2)  # a whole file also ends with the magic number
        self.is_cut = self._file.read() != MCAP0_MAGIC or length == 0
        self._file.seek(0)
        summary = None if self.is_cut else make_reader(self._file).get_summary()
        chunks = [] if summary is None else summary.chunk_indexes
        used = {number for chunk in chunks for number in chunk.message_index_offsets}
        if summary is not None and used and used <= summary.channels.keys():
            schemas, channels = summary.schemas, summary.channels
            self._places = [(c.message_start_time, c.message_end_time, c.chunk_start_offset) for c in chunks]
        else:
            schemas, channels, used = self._scanned()
        if not used:
            cut = "cut off before its first whole message" if self.is_cut else "an MCAP file without messages"
            raise RecordingError(f"{path}: {cut}. Copy it again, or record again.")
        names = {n: getattr(schemas.get(channels[n].schema_id), "name", "") for n in sorted(used)}
        encodings = {n: channels[n].message_encoding for n in names}
        if set(encodings.values()).isdisjoint(_OF_ROS):
            told = [", ".join(sorted(set(words.values()))) for words in (names, encodings)]
            raise RecordingError(
                f"{path}: an MCAP file, but its messages are {shortened(told[0], 160)} "
                f"({shortened(told[1])}), not of ROS. Record the topics of ROS (ros2 bag record -s mcap), or "
                "export color and depth as image files."
            )
        self.is2 = "cdr" in encodings.values()
        kinds = {n: _kind(encodings[n], names[n]) for n in names}
        self.connections = [
            SimpleNamespace(topic=channels[n].topic, msgtype=kinds[n], msgcount=1) for n in names
        ]
        self._topics = {n: channels[n].topic for n in names if encodings[n] in _OF_ROS}

    def _scanned(self) -> tuple[dict[int, Any], dict[int, Any], set[int]]:
        """Find the chunks; return schemas and channels by number, and the channels that have messages."""
        self._places, used = [], set()
        found: dict[type[Any], dict[int, Any]] = {Schema: {}, Channel: {}}
        self._file.seek(0)
        records, at = StreamReader(self._file, emit_chunks=True).records, len(MCAP0_MAGIC)
        try:
            for record in records:
                if isinstance(record, Chunk):
                    self._places.append((record.message_start_time, record.message_end_time, at))
                elif isinstance(record, Message):
                    self._places.append((record.log_time, record.log_time, at))
                for inner in _unpacked(record):
                    if isinstance(inner, Message):
                        used.add(inner.channel_id)
                    elif isinstance(inner, Schema | Channel):
                        found[type(inner)][inner.id] = inner
                at = self._file.tell()
        except Exception:
            if not self.is_cut:
                raise
            self._places = [place for place in self._places if place[2] < at]
        return found[Schema], found[Channel], used & found[Channel].keys()

    def messages(
        self, connections: Collection[SimpleNamespace], start: int | None = None, stop: int | None = None
    ) -> Iterator[tuple[Any, int, bytes]]:
        """Yield time of writing (ns) and data of the messages, from ``start`` to before ``stop``."""
        topics = {connection.topic for connection in connections}
        first, end = -1 if start is None else start, 2**64 if stop is None else stop
        for begun, ended, at in self._places:
            if begun >= end or ended < first:
                continue
            self._file.seek(at)
            for record in _unpacked(
                next(StreamReader(self._file, skip_magic=True, emit_chunks=True).records)
            ):
                if isinstance(record, Message) and self._topics.get(record.channel_id) in topics:
                    if first <= record.log_time < end:
                        yield None, record.log_time, record.data


def _unpacked(record: Any) -> list[Any]:
    """Return the records in a chunk, or a record that is none."""
    if not isinstance(record, Chunk):
        return [record]
    stream, size = get_chunk_data_stream(record, validate_crc=True)
    if size != record.uncompressed_size:
        raise ValueError(f"a chunk has {size} bytes, not {record.uncompressed_size}")
    plain: list[Any] = breakup_chunk(replace(record, compression="", data=stream.read(size)))
    return plain


def _kind(encoding: str, name: str) -> str:
    """Return the type of messages as ROS 2 spells it, also of ROS 1 and IDL; of others, with the encoding."""
    words = re.split(r"[/:]+", name)
    return f"{words[0]}/msg/{words[-1].rstrip('_')}" if encoding in _OF_ROS else f"{name} ({encoding})"
