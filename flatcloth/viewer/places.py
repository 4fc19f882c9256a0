"""What the start screen offers: bundled examples, the user's sessions, and what lies below a folder."""

from __future__ import annotations

import contextlib
import hashlib
import os
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

from flatcloth.core.errors import FlatclothError
from flatcloth.core.resources import sample_recordings
from flatcloth.recordings.folder import HEADER as MANIFEST
from flatcloth.recordings.options import SourceOptions
from flatcloth.session.header import HEADER, Header, read_header, state_folder
from flatcloth.session.journal import JOURNAL
from flatcloth.session.kept import read_summary

MOST_SESSIONS = 12
"""Sessions that are listed. Chosen: what a page shows without scrolling."""
MOST_ENTRIES = 500
"""Entries of a folder that are looked at. Chosen: it bounds the time of a listing."""
NO_CELL = "Needs Open3D: pip install 'flatcloth[synthesis]'"
"""What the card of the simulated robot cell says where it cannot be opened."""
FILES = (".bag", ".db3", ".mcap")
"""Recordings that are one file."""

Kind = Literal["example", "session", "folder", "camera", "cell"]


class PlaceError(FlatclothError):
    """A place that is not offered; the message gives the remedy."""


@dataclass(frozen=True)
class Chosen:
    """What is to be opened: a camera, or a recording and perhaps a session on it.

    ``header`` is that of the session; None for a new one. ``options`` are those of the source, by
    default those that the program was started with.
    """

    kind: Kind
    source: str = ""
    session: Path | None = None
    header: Header | None = None
    options: SourceOptions | None = None


class Places:
    """The places that a page may open.

    Parameters
    ----------
    root : Path, optional
        Folder below which folders may be opened; without it, none.
    own : bool
        Offer the sessions in the user's state folder; not where others can reach the page.
    """

    def __init__(self, root: Path | None = None, *, own: bool = True) -> None:
        self._own = own
        self._root: Path | None = None
        if root is not None:
            try:
                self._root = root.resolve(strict=True)
            except OSError as error:
                raise PlaceError(f"--root {root}: {error.strerror}. Name an existing folder.") from error
            if not self._root.is_dir():
                raise PlaceError(f"--root {root}: not a folder. Name an existing folder.")

    def plain(self) -> dict[str, Any]:
        """Return the offer for the page."""
        return {
            "examples": [{"name": name} for name in sample_recordings()],
            "sessions": [_plain_session(*session) for session in self._sessions()],
            "cell": "" if find_spec("open3d") else NO_CELL,
            "root": None if self._root is None else shown(self._root.name or str(self._root)),
        }

    def remember(self, folder: Path | None) -> None:
        """List a session whose folder is elsewhere among the user's own, by a link to it."""
        if folder is None or not self._own:
            return
        target = folder.resolve()
        if self._root is not None and target.is_relative_to(self._root):
            return
        if target in (own.resolve() for own, _, _ in self._sessions()):
            return
        name = f"{target.name}-{hashlib.sha256(os.fsencode(target)).hexdigest()[:8]}"
        with contextlib.suppress(OSError):
            _sessions_folder().mkdir(parents=True, exist_ok=True)
            (_sessions_folder() / name).symlink_to(target, target_is_directory=True)

    def listing(self, path: str) -> dict[str, Any]:
        """Return what can be opened in a folder below the root, and its folders.

        Raises
        ------
        PlaceError
            If the folder is not offered.
        """
        folder = self._below(path)
        if not folder.is_dir():
            raise PlaceError(f"{path or '.':.200}: not a folder. Choose a folder.")
        try:
            entries = [found for found in self._entries(folder)]
        except OSError as error:
            raise PlaceError(f"{path or '.':.200}: cannot be read ({error.strerror}).") from error
        assert self._root is not None
        here = folder.relative_to(self._root).as_posix()
        return {"path": "" if here == "." else shown(here), "kind": _kind_of(folder), "entries": entries}

    def chosen(self, kind: Kind, name: str) -> Chosen:
        """Return what a page has chosen.

        Raises
        ------
        PlaceError
            If it is not offered.
        """
        if kind == "camera":
            # A serial number; anything else is a file that is played in place of a camera.
            is_serial = name == "" or (name.isascii() and name.isalnum())
            return Chosen("camera", name if is_serial else str(self._below(name)))
        if kind == "cell":
            return Chosen("cell")
        if kind == "example":
            source = sample_recordings().get(name)
            if source is None:
                raise PlaceError(f"There is no example {name!r:.60}.")
            return Chosen("example", str(source))
        if kind == "session":
            for folder, header, _ in self._sessions():
                if shown(folder.name) == name:
                    return Chosen("session", header.recording.location, folder, header)
            raise PlaceError(f"There is no session {name!r:.60} any more.")
        place = self._below(name)
        if not (place / HEADER).is_file():
            return Chosen("folder", str(place))
        header = read_header(place)
        return Chosen("session", str(self._allowed(header, name)), place, header)

    def _allowed(self, header: Header, name: str) -> Path:
        """Return the recording of a session below the root, which its file names: it must be offered too."""
        location = Path(header.recording.location)
        try:
            found = location.resolve(strict=True)
        except (OSError, RuntimeError, ValueError) as error:  # a loop of links, a zero character
            raise PlaceError(
                f"{name:.200}: its recording {str(location)!r} is not there any more."
            ) from error
        offered = {path.resolve() for path in sample_recordings().values()}
        if found not in offered and not (self._root is not None and found.is_relative_to(self._root)):
            raise PlaceError(f"{name:.200}: its recording lies outside the folder given with --root.")
        for file in SourceOptions.from_dict(header.recording.options, f"{name:.200}").files():
            if self._root is None or not file.expanduser().resolve().is_relative_to(self._root):
                raise PlaceError(f"{name:.200}: its file {file} lies outside the folder given with --root.")
        return found

    def _below(self, path: str) -> Path:
        if self._root is None:
            raise PlaceError("No folder is offered; start the program with --root DIR.")
        if "\0" in path:
            raise PlaceError("A path with a zero character cannot exist.")
        try:
            # What lies outside is refused before anything tells whether it exists.
            found = (self._root / path).resolve()
            if not found.is_relative_to(self._root):
                raise PlaceError(f"{path:.200}: lies outside the folder given with --root.")
            return found.resolve(strict=True)
        except (OSError, RuntimeError, ValueError) as error:
            raise PlaceError(f"{path:.200}: there is no such folder below {self._root.name}.") from error

    def _entries(self, folder: Path) -> Iterator[dict[str, Any]]:
        assert self._root is not None
        for n, entry in enumerate(sorted(folder.iterdir(), key=lambda e: e.name.lower())):
            if n >= MOST_ENTRIES:
                return
            if entry.name.startswith("."):
                continue
            with contextlib.suppress(OSError, RuntimeError):
                found = entry.resolve(strict=True)
                kind = _kind_of(found)
                if kind and found.is_relative_to(self._root):
                    about = {"name": shown(entry.name), "kind": kind}
                    yield about if kind == "folder" else {**about, **_about(found, kind)}

    def _sessions(self) -> list[tuple[Path, Header, float]]:
        """Return the user's sessions whose recordings are there, and when each was used, the latest first."""
        if not self._own:
            return []
        found = []
        with contextlib.suppress(OSError):
            for folder in _sessions_folder().iterdir():
                with contextlib.suppress(OSError, FlatclothError):
                    header = read_header(folder)
                    if Path(header.recording.location).exists():
                        found.append((folder, header, _used_at(folder)))
        found.sort(key=lambda session: session[2], reverse=True)
        return found[:MOST_SESSIONS]


def _sessions_folder() -> Path:
    return state_folder() / "sessions"


def _kind_of(path: Path) -> str:
    """Return ``recording``, ``session``, ``file`` or ``folder``; "" for what cannot be opened."""
    if path.is_dir():
        if (path / HEADER).is_file():
            return "session"
        return "recording" if (path / MANIFEST).is_file() else "folder"
    return "file" if path.is_file() and path.suffix in FILES else ""


def shown(name: str) -> str:
    """Return the name of a file as text; bytes that are not UTF-8 are escaped, such as xe9."""
    return os.fsencode(name).decode("utf-8", "backslashreplace")


def _used_at(folder: Path) -> float:
    journal = folder / JOURNAL
    return (journal if journal.exists() else folder / HEADER).stat().st_mtime


def _plain_session(folder: Path, header: Header, used_at: float) -> dict[str, Any]:
    about = header.recording
    return {
        "name": shown(folder.name),
        "recording": about.name,
        "views": about.views,
        "method": header.method,
        "used": _dated(used_at),
        "summary": read_summary(folder),
    }


def _about(place: Path, kind: str) -> dict[str, Any]:
    """Return when a place was used last; of a session also how far it is."""
    if kind != "session":
        file = place / MANIFEST if kind == "recording" else place
        return {"used": _dated(file.stat().st_mtime)}
    return {"used": _dated(_used_at(place)), "summary": read_summary(place)}


def _dated(time_s: float) -> str:
    return datetime.fromtimestamp(time_s, UTC).isoformat(timespec="seconds")
