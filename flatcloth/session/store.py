"""A session on disk: every decision is appended to its journal before it takes effect.

A session folder contains ``session.json`` (the subject of the session), ``journal.jsonl`` (see
``session.journal``) and ``session.lock`` (held by the process that writes).
"""

from __future__ import annotations

import contextlib
import itertools
import logging
import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from flatcloth.core.config import Config
from flatcloth.core.errors import JournalError, os_errors_as
from flatcloth.core.plain_files import read_plain, replace_file, sync_folder
from flatcloth.core.types import Floats
from flatcloth.recordings.base import Recording
from flatcloth.session.header import HEADER, Header, grown, settle_header
from flatcloth.session.journal import (
    JOURNAL,
    Coordinate,
    Entry,
    Pick,
    PickAdded,
    Replay,
    SheetSide,
    encode,
    read_journal,
)
from flatcloth.session.journal_file import JournalFile, LockedError, open_locked
from flatcloth.session.kept import write_kept
from flatcloth.session.machine import Cancel, MemorySession, SessionState

_log = logging.getLogger(__name__)


class SessionFolder:
    """A session on disk, open for writing by this process only; open it with :meth:`open`.

    Not thread-safe: only the thread that owns the session may write.
    """

    def __init__(self, folder: Path, header: Header, held: contextlib.ExitStack) -> None:
        self._folder = folder
        self._header = header
        self._held = held  # what is open: the lock, and the journal
        self._journal = _opened_journal(folder, held)
        self._replay = Replay.of(header)
        self._notices: list[str] = []

    @classmethod
    def open(
        cls,
        folder: Path,
        recording: Recording,
        config: Config,
        method: str,
    ) -> SessionFolder:
        """Create a session folder, or resume the session in it.

        A computation that ran when the process was killed is lost. An incomplete last line is
        dropped, which gives a notice.

        Raises
        ------
        JournalError
            If the folder cannot be written, is in use by another process, belongs to another
            recording, method or configuration, or its journal is damaged before its last line.
        """
        try:
            folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            held = contextlib.ExitStack()
            with contextlib.ExitStack() as failed:
                failed.push(held)
                _lock(folder, held)
                opened = cls(folder, settle_header(folder, recording, config, method), held)
                sync_folder(folder)
                opened._check_owner()
                opened._resume()
                failed.pop_all()
            return opened
        except LockedError as error:
            raise JournalError(
                f"{folder}: the session is open in another flatcloth (process {error.owner or 'unknown'}). "
                "Use that one, end it, or choose another session folder."
            ) from error
        except OSError as error:
            name = "" if error.filename is None else f"{Path(os.fsdecode(error.filename)).name}: "
            raise JournalError(
                f"{folder}: cannot be used as session folder ({name}{error.strerror})."
                " Choose a writable folder, by --session or --out, or set XDG_STATE_HOME to one."
            ) from error

    @property
    def folder(self) -> Path:
        """The folder; exports go there too."""
        return self._folder

    @property
    def state(self) -> SessionState:
        """The session as recorded in the journal."""
        return self._replay.state

    @property
    def picks(self) -> tuple[Pick, ...]:
        """The picks in the order in which they were added."""
        return tuple(self._replay.picks.values())

    def grow(self, recording: Recording) -> None:
        """Take views that were added to the session's recording; ``session.json`` names them from then on.

        Raises
        ------
        JournalError
            If it cannot be written; the session then stays unchanged.
        """
        header = grown(self._header, recording)
        write_kept(self._folder / HEADER, header)
        self._header = header
        state = replace(self.state, n_views=len(recording))
        self._replay = replace(self._replay, state=state)

    def record(self, entry: Entry) -> None:
        """Append an entry and wait until it is on disk; a stale answer is dropped.

        Raises
        ------
        IllegalDecisionError
            If the session does not allow it; nothing is written.
        JournalError
            If it cannot be written; the journal and the session then stay unchanged.
        """
        after = self._replay.after(entry)
        if after is not self._replay:
            self._replay = after.with_line(self._append(entry))

    def add_pick(
        self,
        name: str,
        position_held_m: Floats,
        normal_held: Floats,
        view_index: int,
        source_rc: tuple[float, float],
        side: SheetSide = "this",
    ) -> Pick:
        """Add a pick and return it with its number, which is never reused.

        Raises
        ------
        JournalError
            If it cannot be written.
        """
        change = PickAdded(
            self._replay.next_pick,
            name,
            _coordinates(position_held_m),
            _coordinates(normal_held),
            view_index,
            (float(source_rc[0]), float(source_rc[1])),
            side,
        )
        self.record(change)
        return self._replay.picks[change.id]

    def take_notices(self) -> tuple[str, ...]:
        """Return the notices for the user, once: sentences on where the session is stored."""
        notices, self._notices = tuple(self._notices), []
        return notices

    def close(self) -> None:
        """Release the folder for other processes; may be called repeatedly."""
        self._held.close()

    def _notice(self, text: str) -> None:
        _log.warning("%s", text)
        self._notices.append(text)

    def _check_owner(self) -> None:
        owner = self._folder.stat().st_uid
        if owner != os.geteuid():
            self._notice(
                f"{self._folder}: the session folder belongs to another user (number {owner}), who can"
                " change what is decided here. Use a folder of your own unless that is meant."
            )

    def _resume(self) -> None:
        path, data = self._folder / JOURNAL, self._journal.data
        for _, after in read_journal(path, data, self._replay):
            self._replay = after
        complete = data.rfind(b"\n") + 1
        if complete < len(data):
            self._notice(f"{path}: the last line is incomplete after a crash and is dropped.")
            self._journal.cut(complete)
        if self.state.request is not None:
            # The computation is lost. Recording its end in the journal keeps the later lines legal.
            self.record(Cancel())

    def _append(self, entry: Entry) -> int:
        """Write an entry as the next line, and return its checksum."""
        if not self._journal.is_open:
            raise JournalError(f"{self._folder}: the session is closed. Open it again.")
        try:
            line, link = encode(self._replay.lines + 1, entry, self._replay.link)
        except ValueError as error:
            raise JournalError(
                f"The decision has numbers that are not finite, or text that is not Unicode ({entry!r:.200})."
            ) from error
        with os_errors_as(
            JournalError,
            f"{self._folder / JOURNAL}: cannot be written",
            "The decision was not made. Free disk space and repeat it.",
        ):
            if not self._journal.is_in_place():
                self._move()
            self._journal.append(line)
        return link

    def _move(self) -> None:
        """Continue in a new folder, because another program removed, replaced or changed the journal."""
        was, fresh = self._folder, _unused(self._folder.with_name(f"{self._folder.name}-continued"))
        fresh.mkdir(parents=True, mode=0o700)
        with contextlib.ExitStack() as held:
            _lock(fresh, held)
            write_kept(fresh / HEADER, self._header)
            for name in _BESIDE:
                with contextlib.suppress(OSError):
                    replace_file(fresh / name, read_plain(was / name))
            journal = _opened_journal(fresh, held)
            journal.append(self._journal.data)
            self.close()
            self._folder, self._journal, self._held = fresh, journal, held.pop_all()
        self._notice(
            f"{was / JOURNAL}: was removed, replaced or changed by another program. All decisions are kept"
            f" and the session continues in {fresh}; give --session {fresh} next time."
        )


Keeper = MemorySession | SessionFolder
"""The owner of a session's state."""
_BESIDE = ("grips.json", "settings.json")
"""Other files of a session."""


def _unused(path: Path) -> Path:
    """Return the path if it is free, otherwise the first free one with a number appended."""
    return next(
        free
        for n in itertools.count(1)
        if not os.path.lexists(free := path if n == 1 else path.with_name(f"{path.name}-{n}"))
    )


def _lock(folder: Path, held: contextlib.ExitStack) -> None:
    fd = open_locked(folder / "session.lock")
    held.callback(os.close, fd)
    os.ftruncate(fd, 0)
    os.pwrite(fd, f"{os.getpid()}\n".encode(), 0)


def _opened_journal(folder: Path, held: contextlib.ExitStack) -> JournalFile:
    return held.enter_context(contextlib.closing(JournalFile(folder / JOURNAL)))


def _coordinates(values: Floats) -> tuple[Coordinate, Coordinate, Coordinate]:
    x, y, z = np.asarray(values, dtype=np.float64).tolist()
    return x, y, z
