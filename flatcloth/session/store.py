"""A session on disk: every decision is appended to its journal before it takes effect.

A session folder contains ``session.json`` (the subject of the session), ``journal.jsonl`` (see
``session.journal``) and ``session.lock`` (held by the process that writes).
"""

from __future__ import annotations

import contextlib
import fcntl
import logging
import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from flatcloth.core.config import Config
from flatcloth.core.errors import JournalError
from flatcloth.core.plain_files import MOST_JOURNAL_BYTES, read_plain, sync_folder
from flatcloth.core.types import Floats, RotationAxis
from flatcloth.recordings.base import Recording
from flatcloth.session.axis_file import write_axis
from flatcloth.session.header import settle_header
from flatcloth.session.journal import (
    JOURNAL,
    Coordinate,
    Entry,
    Pick,
    PickAdded,
    PickChange,
    PickDeleted,
    PickRenamed,
    Replay,
    encode,
    read_journal,
)
from flatcloth.session.machine import Cancel, Command, Event, SessionState, apply

_log = logging.getLogger(__name__)


class SessionFolder:
    """A session on disk, open for writing by this process only; open it with :meth:`open`.

    Not thread-safe: only the thread that owns the session may write.
    """

    def __init__(self, folder: Path, lock_fd: int, state: SessionState) -> None:
        self._folder = folder
        self._lock_fd: int | None = lock_fd
        self._journal_fd: int | None = None
        self._kept = Replay(state)

    @classmethod
    def open(cls, folder: Path, recording: Recording, config: Config, method: str) -> SessionFolder:
        """Create a session folder, or resume the session in it.

        A computation that was running when the process was killed is cancelled; an incomplete last
        line is dropped, with a warning in the log.

        Raises
        ------
        JournalError
            If the folder cannot be written, is in use by another process, belongs to another
            recording, method or configuration, or its journal is damaged before its last line.
        """
        opened: SessionFolder | None = None
        try:
            folder.mkdir(parents=True, exist_ok=True)
            opened = cls(folder, _lock(folder / "session.lock"), SessionState(n_views=len(recording)))
            settle_header(folder, recording, config, method)
            opened._resume()
        except OSError as error:
            if opened is not None:
                opened.close()
            raise JournalError(
                f"{folder}: cannot be used as session folder ({error.strerror}). Choose a writable folder."
            ) from error
        except BaseException:
            if opened is not None:
                opened.close()
            raise
        return opened

    @property
    def folder(self) -> Path:
        """The folder; exports go there too."""
        return self._folder

    @property
    def state(self) -> SessionState:
        """The session as recorded in the journal."""
        return self._kept.state

    @property
    def picks(self) -> tuple[Pick, ...]:
        """The picks in the order in which they were added."""
        return tuple(self._kept.picks.values())

    def record(self, command: Command | Event, score_parts: Mapping[str, float] | None = None) -> None:
        """Append a command or an answer and wait until it is on disk; a stale answer is dropped.

        ``score_parts`` are added to a proposal for readers of the journal; replaying ignores them.

        Raises
        ------
        IllegalDecisionError
            If the session does not allow the command; nothing is written.
        JournalError
            If it cannot be written; the journal then stays unchanged.
        """
        state = apply(self.state, command)
        if state is not self.state:
            self._append(command, score_parts)
            self._kept.state = state

    def add_pick(
        self,
        name: str,
        position_held_m: Floats,
        normal_held: Floats,
        view_index: int,
        source_rc: tuple[float, float],
    ) -> Pick:
        """Add a pick and return it with its number, which is never reused.

        Raises
        ------
        JournalError
            If it cannot be written.
        """
        change = PickAdded(
            self._kept.next_pick,
            name,
            _coordinates(position_held_m),
            _coordinates(normal_held),
            view_index,
            (float(source_rc[0]), float(source_rc[1])),
        )
        self._change_picks(change)
        return self._kept.picks[change.id]

    def rename_pick(self, pick_id: int, name: str) -> None:
        """Rename a pick.

        Raises
        ------
        JournalError
            If there is no such pick, or it cannot be written.
        """
        self._change_picks(PickRenamed(pick_id, name))

    def delete_pick(self, pick_id: int) -> None:
        """Remove a pick from the list; the journal keeps its record.

        Raises
        ------
        JournalError
            If there is no such pick, or it cannot be written.
        """
        self._change_picks(PickDeleted(pick_id))

    def keep_axis(self, axis: RotationAxis) -> None:
        """Save a turning axis that was set by hand with the session, in ``axis.json``.

        Raises
        ------
        JournalError
            If it cannot be written.
        """
        write_axis(self._folder, axis)

    def close(self) -> None:
        """Release the folder for other processes; may be called repeatedly."""
        for fd in (self._journal_fd, self._lock_fd):
            if fd is not None:
                os.close(fd)
        self._journal_fd = self._lock_fd = None

    def _change_picks(self, change: PickChange) -> None:
        if not isinstance(change, PickAdded) and change.id not in self._kept.picks:
            raise JournalError(f"Pick {change.id} is not in the list; it may have been deleted.")
        self._append(change)
        self._kept.take(change)

    def _resume(self) -> None:
        path = self._folder / JOURNAL
        self._journal_fd = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
        sync_folder(self._folder)
        for _ in read_journal(path, self._kept):
            pass
        self._drop_torn_line(path)
        if self.state.request is not None:
            # The computation is lost. Recording its end in the journal keeps the later lines legal.
            self.record(Cancel())

    def _drop_torn_line(self, path: Path) -> None:
        assert self._journal_fd is not None
        data = read_plain(path, MOST_JOURNAL_BYTES)
        whole = data.rfind(b"\n") + 1
        if whole < len(data):
            _log.warning("%s: the last line is incomplete after a crash and is dropped.", path)
            os.ftruncate(self._journal_fd, whole)
            os.fsync(self._journal_fd)

    def _append(self, entry: Entry, score_parts: Mapping[str, float] | None = None) -> None:
        if self._journal_fd is None:
            raise JournalError(f"{self._folder}: the session is closed. Open it again.")
        try:
            line, link = encode(self._kept.lines + 1, entry, score_parts, self._kept.link)
        except ValueError as error:
            raise JournalError(
                f"The decision has numbers that are not finite, or text that is not Unicode ({entry!r:.200})."
            ) from error
        before = os.fstat(self._journal_fd).st_size
        try:
            written = 0
            while written < len(line):
                written += os.write(self._journal_fd, line[written:])
            os.fsync(self._journal_fd)
        except OSError as error:
            with contextlib.suppress(OSError):  # half a line must not precede the next one
                os.ftruncate(self._journal_fd, before)
            raise JournalError(
                f"{self._folder / 'journal.jsonl'}: cannot be written ({error.strerror}). "
                "The decision was not made. Free disk space and repeat it."
            ) from error
        self._kept.lines += 1
        self._kept.link, self._kept.sealed = link, True


def _lock(path: Path) -> int:
    fd = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        owner = os.read(fd, 20).decode(errors="replace").strip()
        os.close(fd)
        raise JournalError(
            f"{path.parent}: the session is open in another flatcloth (process {owner}). "
            "Use that one, end it, or choose another session folder."
        ) from error
    except OSError:
        os.close(fd)
        raise
    os.ftruncate(fd, 0)
    os.pwrite(fd, f"{os.getpid()}\n".encode(), 0)
    return fd


def _coordinates(values: Floats) -> tuple[Coordinate, Coordinate, Coordinate]:
    x, y, z = np.asarray(values, dtype=np.float64).tolist()
    return x, y, z
