"""Every decision to disk, append-only; replaying it restores the session.

A session folder holds ``session.json`` (what the session is about), ``journal.jsonl`` (one line a
decision, answer or pick, in order) and ``session.lock`` (held by the process that writes). A line
counts once its newline is on disk: what a crash cut short was never acknowledged, and is dropped.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import importlib.metadata
import json
import logging
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from flatcloth.core.config import Config
from flatcloth.core.errors import ConfigError, IllegalDecisionError, JournalError
from flatcloth.core.plain_files import MOST_JOURNAL_BYTES, read_plain
from flatcloth.core.types import Float64, Floats, RotationAxis
from flatcloth.recordings.base import Recording, fingerprint
from flatcloth.session import machine as session
from flatcloth.session.axis_file import write_axis
from flatcloth.session.journal_lines import (
    Entry,
    PickAdded,
    PickChange,
    PickDeleted,
    PickRenamed,
    decode,
    encode,
)
from flatcloth.session.machine import Command, Event, SessionState, apply

FORMAT = "flatcloth-session/1"
_log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True, eq=False)
class Pick:
    """A grasp point that the operator keeps: position and outward normal (3,), held frame.

    ``view_index`` and ``source_rc`` (row, col) name the image pixel it was measured in.
    """

    id: int
    name: str
    position_held_m: Float64
    normal_held: Float64
    view_index: int
    source_rc: tuple[float, float]


def default_session_folder(recording: Recording, method: str, config: Config | None = None) -> Path:
    """Return where a session is kept if the user names no place.

    Below ``$XDG_STATE_HOME`` (``~/.local/state``). The name tells the recording; a short hash of
    its location and header, the method and the settings keeps sessions apart that cannot continue
    each other.
    """
    state_home = os.environ.get("XDG_STATE_HOME", "")
    # The XDG specification tells to ignore relative paths.
    root = Path(state_home) if os.path.isabs(state_home) else Path.home() / ".local" / "state"
    settings = (config or Config()).to_dict()
    about = json.dumps([recording.location, fingerprint(recording), method, settings], sort_keys=True)
    name = re.sub(r"[^A-Za-z0-9._-]+", "-", recording.name).strip("-.")[:60] or "recording"
    return root / "flatcloth" / "sessions" / f"{name}-{hashlib.sha256(about.encode()).hexdigest()[:8]}"


class SessionFolder:
    """A session on disk, open for writing by this process only; open it with :meth:`open`.

    Not thread-safe: the thread that owns the session writes.
    """

    def __init__(self, folder: Path, lock_fd: int, state: SessionState) -> None:
        self._folder = folder
        self._lock_fd: int | None = lock_fd
        self._journal_fd: int | None = None
        self._state = state
        self._picks: dict[int, Pick] = {}
        self._next_pick = 1
        self._lines = 0

    @classmethod
    def open(cls, folder: Path, recording: Recording, config: Config, method: str) -> SessionFolder:
        """Create a session folder, or resume the session in it.

        A computation that ran when the process was killed is given up; a last line that was cut
        short is dropped, with a warning in the log.

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
            _settle_header(folder, recording, config, method)
            opened._resume()
        except OSError as error:
            if opened is not None:
                opened.close()
            raise JournalError(
                f"{folder}: cannot be used as session folder ({error.strerror}). Choose a writable place."
            ) from error
        except BaseException:
            if opened is not None:
                opened.close()
            raise
        return opened

    @property
    def folder(self) -> Path:
        """The folder itself; exports go there too."""
        return self._folder

    @property
    def state(self) -> SessionState:
        """The session as the journal has it."""
        return self._state

    @property
    def picks(self) -> tuple[Pick, ...]:
        """The picks in the order in which they were added."""
        return tuple(self._picks.values())

    def record(self, command: Command | Event, score_parts: Mapping[str, float] | None = None) -> None:
        """Append a command or an answer and wait until it is on disk; a stale answer is not kept.

        ``score_parts`` go with a proposal, for whoever reads the journal; replaying ignores them.

        Raises
        ------
        IllegalDecisionError
            If the session does not allow the command; nothing is written.
        JournalError
            If it cannot be written; the journal then is as before.
        """
        state = apply(self._state, command)
        if state is self._state:
            return
        self._append(command, score_parts)
        self._state = state

    def add_pick(
        self,
        name: str,
        position_held_m: Floats,
        normal_held: Floats,
        view_index: int,
        source_rc: tuple[float, float],
    ) -> Pick:
        """Keep a pick and return it with its number, which is never used again.

        Raises
        ------
        JournalError
            If it cannot be written.
        """
        change = PickAdded(
            self._next_pick,
            name,
            np.asarray(position_held_m, dtype=np.float64),
            np.asarray(normal_held, dtype=np.float64),
            view_index,
            np.asarray(source_rc, dtype=np.float64),
        )
        self._change_picks(change)
        return self._picks[change.id]

    def rename_pick(self, pick_id: int, name: str) -> None:
        """Give a pick another name.

        Raises
        ------
        JournalError
            If there is no such pick, or it cannot be written.
        """
        self._change_picks(PickRenamed(pick_id, name))

    def delete_pick(self, pick_id: int) -> None:
        """Take a pick off the list; the journal still tells that there was one.

        Raises
        ------
        JournalError
            If there is no such pick, or it cannot be written.
        """
        self._change_picks(PickDeleted(pick_id))

    def keep_axis(self, axis: RotationAxis) -> None:
        """Keep a turning axis that was set by hand with the session, in its ``axis.json``.

        Raises
        ------
        JournalError
            If it cannot be written.
        """
        write_axis(self._folder, axis)

    def close(self) -> None:
        """Let another process have the folder; harmless when repeated."""
        for fd in (self._journal_fd, self._lock_fd):
            if fd is not None:
                os.close(fd)
        self._journal_fd = self._lock_fd = None

    def _change_picks(self, change: PickChange) -> None:
        if not isinstance(change, PickAdded) and change.id not in self._picks:
            raise JournalError(f"Pick {change.id} is not in the list; it may have been deleted.")
        self._append(change)
        self._apply_pick(change)

    def _apply_pick(self, change: PickChange) -> None:
        match change:
            case PickAdded(id=pick_id, name=name):
                row, col = change.source_rc.tolist()
                self._picks[pick_id] = Pick(
                    id=pick_id,
                    name=name,
                    position_held_m=change.position_held_m,
                    normal_held=change.normal_held,
                    view_index=change.view_index,
                    source_rc=(row, col),
                )
                self._next_pick = max(self._next_pick, pick_id + 1)
            case PickRenamed(id=pick_id, name=name):
                self._picks[pick_id] = replace(self._picks[pick_id], name=name)
            case PickDeleted(id=pick_id):
                del self._picks[pick_id]

    def _resume(self) -> None:
        path = self._folder / "journal.jsonl"
        self._journal_fd = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
        _sync_folder(self._folder)
        data = read_plain(path, MOST_JOURNAL_BYTES)
        whole = data.rfind(b"\n") + 1
        if whole < len(data):
            _log.warning("%s: the last line was cut short by a crash and is dropped.", path)
            os.ftruncate(self._journal_fd, whole)
            os.fsync(self._journal_fd)
        for number, line in enumerate(data[:whole].split(b"\n")[:-1], start=1):
            try:
                self._replay(decode(number, line))
            except (ValueError, KeyError, IllegalDecisionError) as error:
                raise JournalError(
                    f"{path}: line {number} is damaged ({error}). "
                    "Cut the file before that line to go on from there, or begin in another folder."
                ) from error
            self._lines = number
        if self._state.request is not None:
            # Nobody is computing it any more. Saying so in the journal keeps its later lines legal.
            self.record(session.Cancel())

    def _replay(self, entry: Entry) -> None:
        if isinstance(entry, PickChange):
            self._apply_pick(entry)
        else:
            self._state = apply(self._state, entry)

    def _append(self, entry: Entry, score_parts: Mapping[str, float] | None = None) -> None:
        if self._journal_fd is None:
            raise JournalError(f"{self._folder}: the session is closed. Open it again.")
        try:
            line = encode(self._lines + 1, entry, score_parts)
        except ValueError as error:
            raise JournalError(f"The decision has numbers that are not finite ({entry}).") from error
        before = os.fstat(self._journal_fd).st_size
        try:
            written = 0
            while written < len(line):
                written += os.write(self._journal_fd, line[written:])
            os.fsync(self._journal_fd)
        except OSError as error:
            with contextlib.suppress(OSError):  # half a line must not stay before the next one
                os.ftruncate(self._journal_fd, before)
            raise JournalError(
                f"{self._folder / 'journal.jsonl'}: cannot be written ({error.strerror}). "
                "The decision was not taken; free disk space and repeat it."
            ) from error
        self._lines += 1


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


def _settle_header(folder: Path, recording: Recording, config: Config, method: str) -> None:
    """Write ``session.json``, or check that the one that is there is about the same session."""
    path = folder / "session.json"
    if path.exists():
        _check_header(path, recording, config, method)
        return
    if (folder / "journal.jsonl").exists():
        raise JournalError(f"{path}: missing beside its journal. Restore it, or begin in another folder.")
    header = {
        "format": FORMAT,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "recording": {
            "name": recording.name,
            "location": recording.location,
            "fingerprint": fingerprint(recording),
            "views": len(recording),
        },
        "method": method,
        "config": config.to_dict(),
        "versions": {name: _version(name) for name in ("flatcloth", "numpy", "scipy", "viser")},
    }
    # Renamed into place, so that a crash leaves either no header or a whole one.
    draft = folder / "session.json.new"
    with draft.open("w", encoding="utf-8") as file:
        file.write(json.dumps(header, indent=1) + "\n")
        file.flush()
        os.fsync(file.fileno())
    draft.replace(path)
    _sync_folder(folder)


def _check_header(path: Path, recording: Recording, config: Config, method: str) -> None:
    try:
        header = json.loads(read_plain(path))
        found = header["format"]
        if found != FORMAT:
            raise JournalError(f"{path}: format {found!r} is unknown, not {FORMAT}. Begin in another folder.")
        name, about = str(header["recording"]["name"]), header["recording"]["fingerprint"]
        kept_method, kept = header["method"], Config.from_dict(header["config"])
    except (KeyError, TypeError, ValueError, RecursionError, ConfigError) as error:
        raise JournalError(f"{path}: cannot be understood ({error}). Begin in another folder.") from error
    remedy = "Begin in another folder, or open the session as it was begun."
    if about != fingerprint(recording):
        raise JournalError(
            f"{path}: the session is about another recording ({name!r}, not {recording.name!r}). {remedy}"
        )
    if kept_method != method:
        raise JournalError(f"{path}: the session uses method {kept_method!r}, not {method!r}. {remedy}")
    if kept != config:
        raise JournalError(f"{path}: the session has other settings: {_difference(kept, config)}. {remedy}")


def _difference(kept: Config, config: Config) -> str:
    old, new = kept.to_dict(), config.to_dict()
    return next(
        f"{section}.{name} was {old[section][name]}, is {value}"
        for section in new
        for name, value in new[section].items()
        if value != old[section][name]
    )


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:  # run from a checkout that is not installed
        return "unknown"


def _sync_folder(folder: Path) -> None:
    fd = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)
