"""``active.jsonl``: what a loop asked for, expected, got and was told; each line is on disk at once."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from flatcloth.core.errors import JournalError
from flatcloth.core.plain_files import MOST_JOURNAL_BYTES, open_own, read_plain

LOG = "active.jsonl"


class ActiveLog:
    """Appends lines; those of earlier runs are kept, except for an incomplete last one.

    Parameters
    ----------
    folder : Path
        The session folder.

    Raises
    ------
    JournalError
        If the file cannot be read or written.
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / LOG
        try:
            self.lines = self._read()
            self._fd: int | None = open_own(self._path, os.O_WRONLY | os.O_APPEND)
        except OSError as error:
            raise JournalError(f"{self._path}: cannot be used ({error.strerror}).") from error

    @property
    def seconds(self) -> float:
        """The time that earlier runs took."""
        return max((float(line.get("elapsed_s", 0.0)) for line in self.lines), default=0.0)

    def add(self, event: str, **values: Any) -> None:
        """Append a line, and wait until it is on disk; raises ``JournalError``."""
        line = {"event": event, **values}
        assert self._fd is not None, "the log is open"
        try:
            os.write(self._fd, json.dumps(line, allow_nan=False).encode() + b"\n")
            os.fsync(self._fd)
        except OSError as error:
            raise JournalError(
                f"{self._path}: cannot be written ({error.strerror}). Free disk space."
            ) from error
        self.lines.append(line)

    def close(self) -> None:
        """Close the file."""
        if self._fd is not None:
            os.close(self._fd)
            self._fd = None

    def _read(self) -> list[dict[str, Any]]:
        try:
            data = read_plain(self._path, MOST_JOURNAL_BYTES)
        except FileNotFoundError:
            return []
        whole = data[: data.rfind(b"\n") + 1]
        if len(whole) < len(data):
            os.truncate(self._path, len(whole))
        lines = []
        for number, text in enumerate(whole.splitlines(), start=1):
            try:
                line = json.loads(text)
            except (ValueError, RecursionError):
                line = None
            if not isinstance(line, dict):
                raise JournalError(
                    f"{self._path}: line {number} is damaged. Remove the file: it only tells the past."
                )
            lines.append(line)
        return lines
