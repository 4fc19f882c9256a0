"""``session.json``: the subject of a session, written once when the session begins."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import os
import re
import secrets
import zlib
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import msgspec

from flatcloth.core.config import Config
from flatcloth.core.decoding import fitted
from flatcloth.core.errors import ConfigError, JournalError
from flatcloth.recordings.base import Recording, fingerprint, source_options
from flatcloth.session.kept import read_kept, write_kept

FORMAT = "flatcloth-session/5"
HEADER = "session.json"


class RecordingAbout(msgspec.Struct, frozen=True, kw_only=True):
    """The recording of a session; ``options`` are those that it was opened with (``SourceOptions``)."""

    name: str
    location: str
    fingerprint: str
    views: int
    options: dict[str, Any] = {}


class Header(msgspec.Struct, frozen=True, kw_only=True):
    """The content of ``session.json``."""

    format: str
    created: str
    recording: RecordingAbout
    method: str
    config: dict[str, Any]
    versions: Mapping[str, str]
    id: str
    """Different for every session; the journal's checksums begin with it."""

    @property
    def seed(self) -> int:
        """The checksum before the journal's first line."""
        return zlib.crc32(self.id.encode())

    @property
    def effective_config(self) -> Config:
        """The configuration that the session began with; raises ``ConfigError``."""
        return Config.from_dict(self.config)


def state_folder() -> Path:
    """Return where the user's state is kept: below ``$XDG_STATE_HOME`` (``~/.local/state``)."""
    state_home = os.environ.get("XDG_STATE_HOME", "")
    # The XDG specification says to ignore relative paths.
    root = Path(state_home) if os.path.isabs(state_home) else Path.home() / ".local" / "state"
    return root / "flatcloth"


def default_session_folder(recording: Recording, method: str, config: Config | None = None) -> Path:
    """Return the default folder of a session.

    It lies below ``$XDG_STATE_HOME`` (``~/.local/state``). Its name contains the recording's name and
    a short hash of its location and header, the method and the settings, so that sessions that
    cannot continue each other have different folders.
    """
    settings = (config or Config()).to_dict()
    about = json.dumps([recording.location, fingerprint(recording), method, settings], sort_keys=True)
    name = re.sub(r"[^A-Za-z0-9._-]+", "-", recording.name).strip("-.")[:60] or "recording"
    return state_folder() / "sessions" / f"{name}-{hashlib.sha256(about.encode()).hexdigest()[:8]}"


def read_header(folder: Path) -> Header:
    """Read the header of a session folder.

    Raises
    ------
    JournalError
        If it is not a session folder, or its header is damaged; the message names the file.
    """
    path = folder / HEADER
    remedy = "Restore it from a copy, or use the version that wrote it. Otherwise use another folder."
    raw = read_kept(path, dict[str, Any], remedy)
    if raw is None:
        raise JournalError(
            f"{folder}: not a session folder, it has no {HEADER}. Name the folder of --out or --session."
        )
    found = raw.get("format", FORMAT)
    if found != FORMAT:
        raise JournalError(
            f"{path}: format {found!r:.60} is not {FORMAT}, which this version reads. Use another folder."
        )
    try:
        header = fitted(raw, Header)
        header.effective_config  # noqa: B018 - raises on unknown settings
    except (ValueError, ConfigError) as error:
        raise JournalError(f"{path}: not valid ({error}). {remedy}") from error
    return header


def kept_config(folder: Path, method: str) -> Config | None:
    """Return the settings of a session of this method, which it is continued with; None if there is none.

    Raises
    ------
    JournalError
        As :func:`read_header`.
    """
    if not (folder / HEADER).exists():
        return None
    header = read_header(folder)
    return header.effective_config if header.method == method else None


def settle_header(
    folder: Path,
    recording: Recording,
    config: Config,
    method: str,
) -> Header:
    """Write ``session.json``, or check that the existing one describes the same session.

    Raises
    ------
    JournalError
        If it describes another session, is damaged, cannot be written, or is missing although there is a
        journal.
    """
    path = folder / HEADER
    if path.exists():
        kept = read_header(folder)
        had = kept.recording.views
        if recording.is_growing and had < len(recording):  # it grew, and the program was killed
            if kept.recording.fingerprint == fingerprint(recording, had):
                kept = grown(kept, recording)
                write_kept(path, kept)
        _check(path, kept, recording, config, method)
        return kept
    if (folder / "journal.jsonl").exists():
        raise JournalError(f"{path}: missing, but there is a journal. Restore it, or use another folder.")
    header = Header(
        format=FORMAT,
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        recording=RecordingAbout(
            name=recording.name,
            location=recording.location,
            fingerprint=fingerprint(recording),
            views=len(recording),
            options=source_options(recording),
        ),
        method=method,
        config=config.to_dict(),
        versions={name: _version(name) for name in ("flatcloth", "numpy", "scipy", "viser")},
        id=secrets.token_hex(8),
    )
    write_kept(path, header)
    return header


def grown(header: Header, recording: Recording) -> Header:
    """Return the header of a session whose recording has grown."""
    about = msgspec.structs.replace(
        header.recording, fingerprint=fingerprint(recording), views=len(recording)
    )
    return msgspec.structs.replace(header, recording=about)


def _check(path: Path, kept: Header, recording: Recording, config: Config, method: str) -> None:
    remedy = "Use another folder, or open the session with its own recording, method and settings."
    if kept.recording.fingerprint != fingerprint(recording):
        raise JournalError(
            f"{path}: the session belongs to another recording"
            f" ({kept.recording.name!r}, not {recording.name!r}). {remedy}"
        )
    if kept.method != method:
        raise JournalError(f"{path}: the session uses method {kept.method!r}, not {method!r}. {remedy}")
    if kept.effective_config != config:
        name, now, was = differences(config, kept.effective_config)[0]
        raise JournalError(f"{path}: the session has other settings: {name} was {was}, is {now}. {remedy}")


def differences(config: Config, other: Config) -> list[tuple[str, Any, Any]]:
    """Return the settings that differ from others: name, value, the other value."""
    values, others = config.to_dict(), other.to_dict()
    return [
        (f"{section}.{name}", value, others[section][name])
        for section, settings in values.items()
        for name, value in settings.items()
        if value != others[section][name]
    ]


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:  # run from a checkout without installation
        return "unknown"
