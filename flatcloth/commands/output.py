"""The output of commands: results on stdout, progress and errors on stderr, all in a log file if wanted.

``--quiet`` leaves the errors, ``--json`` one JSON document, ``--verbose`` adds details.
"""

from __future__ import annotations

import contextlib
import gc
import io
import json
import logging
import math
import os
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Self

from flatcloth.commands.options import Output
from flatcloth.core.errors import FlatclothError, RecordingError, os_errors_as

_said = logging.getLogger("flatcloth.said")
_progress = logging.getLogger("flatcloth.progress")
_failed = logging.getLogger("flatcloth.failed")
_failed.addHandler(logging.NullHandler())  # printed already, also without a log file


def say(text: str) -> None:
    """Report a result on stdout."""
    _said.info("%s", text)


def detail(text: str) -> None:
    """Report a detail on stdout, with ``--verbose`` only."""
    _said.debug("%s", text)


def report(options: Output, document: Any, lines: Iterable[str]) -> None:
    """Report a result: as a document with ``--json``, else in words."""
    if options.json:
        print(json.dumps(document, indent=1), flush=True)
    for line in lines:
        say(line)


def refuse_full(folder: Path) -> None:
    """Raise RecordingError unless a folder is new or empty; before the work whose files go there."""
    with os_errors_as(RecordingError, f"{folder}: cannot be written", "Choose a writable folder."):
        if folder.exists() and any(folder.iterdir()):
            what = "contains a recording" if (folder / "recording.json").exists() else "not empty"
            raise RecordingError(f"{folder}: {what}. Choose a new or an empty folder.")


def announce(options: Output, words: str, url: str, token: str | None, **more: str | None) -> None:
    """Report that a server answers: as one line of JSON with ``--json``, else in words.

    The log file gets the words without the token, as others may read it.
    """
    if options.json:
        print(json.dumps({"url": url, "token": token, **more, "pid": os.getpid()}), flush=True)
    _said.info("%s", words, extra={"secret": token})


def escape_what_cannot_be_encoded() -> None:
    """Let stdout and stderr write escapes for characters that their encodings lack, in place of an error."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            with contextlib.suppress(OSError):  # a pipe has taken the place of its file
                stream.reconfigure(errors="backslashreplace")


def _one_line(text: str) -> str:
    """Return a text with escapes for the control characters that names of files may have."""
    return "".join(c if c.isprintable() or c in "\u00a0\u3000" else ascii(c)[1:-1] for c in text)


@contextlib.contextmanager
def speaking(options: Output) -> Iterator[None]:
    """Print the output of commands, as the options want it; ``FlatclothError`` if the log is not writable."""
    root = logging.getLogger()
    level = logging.DEBUG if options.verbose else logging.INFO
    silent = logging.CRITICAL
    has_words = not options.quiet and options.json is not True
    handlers: list[tuple[logging.Logger, logging.Handler]] = [
        (_said, _Printer(level if has_words else silent, on_stderr=False)),
        (_progress, _Printer(silent if options.quiet else level, on_stderr=True)),
    ]
    if options.log_file is not None:
        handlers.append((root, _log_file(options.log_file)))
    if options.log_file is not None or options.verbose:  # in place of logging's handler of last resort
        others = logging.StreamHandler()  # what the libraries and the server log
        others.setLevel(logging.INFO if options.verbose else logging.WARNING)
        own = (_said.name, _progress.name, _failed.name)  # are printed already
        others.addFilter(lambda record: record.name not in own)
        handlers.append((root, others))
    kept_level = root.level
    for logger, handler in handlers:
        logger.addHandler(handler)
    _said.setLevel(logging.DEBUG)
    _progress.setLevel(logging.DEBUG)
    if len(handlers) > 2:
        root.setLevel(logging.INFO)
    try:
        yield
    finally:
        for logger, handler in handlers:
            logger.removeHandler(handler)
            handler.close()
        root.setLevel(kept_level)


def error(text: str) -> None:
    """Report why a command failed: on stderr, and in the log file."""
    print(f"flatcloth: {_one_line(text)}", file=sys.stderr)
    _failed.error("%s", text)


def _log_file(path: Path) -> logging.Handler:
    with os_errors_as(FlatclothError, f"{path}: the log cannot be written", "Choose another file."):
        path.parent.mkdir(parents=True, exist_ok=True)
        handler = logging.FileHandler(path, encoding="utf-8", errors="backslashreplace")
    handler.setFormatter(_WithoutSecrets("%(asctime)s %(levelname)s %(name)s: %(message)s"))
    return handler


class _WithoutSecrets(logging.Formatter):
    """Leaves out what a line marks as secret."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the line."""
        secret = getattr(record, "secret", None)
        text = super().format(record)
        return text.replace(secret, "(token)") if secret else text


class _Printer(logging.Handler):
    """Prints lines; unlike logging's own handler it lets errors through, such as a closed pipe."""

    def __init__(self, level: int, *, on_stderr: bool) -> None:
        super().__init__(level)
        self._on_stderr = on_stderr

    def emit(self, record: logging.LogRecord) -> None:
        """Print one line, above a bar if there is one."""
        stream, tqdm = sys.stderr if self._on_stderr else sys.stdout, sys.modules.get("tqdm")
        with tqdm.tqdm.external_write_mode(stream) if tqdm else contextlib.nullcontext():
            print(_one_line(record.getMessage()), file=stream, flush=True)


@contextlib.contextmanager
def loading() -> Iterator[None]:
    """Switch the garbage collector off while modules load, and let it skip them later: 0.1 s less."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


class ProgressBar:
    """A bar on stderr if that is a terminal; otherwise, with ``steps``, a line for each tenth of the work."""

    def __init__(self, title: str, *, steps: bool = False) -> None:
        from tqdm import tqdm

        form = "{desc} [{bar:20}] {postfix}"
        is_quiet = any(handler.level > logging.INFO for handler in _progress.handlers)
        disable = True if is_quiet else None  # None: unless stderr is a terminal
        self._bar = tqdm(total=1.0, desc=title, bar_format=form, disable=disable, leave=False)
        self._title, self._steps, self._next, self._text = title, steps, 0.0, ""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.close()

    @property
    def is_shown(self) -> bool:
        """Whether stderr is a terminal."""
        return not self._bar.disable

    def line(self, text: str) -> None:
        """Print a line on stderr, above the bar if there is one."""
        self._bar.write(text, file=sys.stderr)
        _failed.warning("%s", text)

    def clear(self) -> None:
        """Clear the line of the bar, until the bar is drawn again."""
        self._bar.clear()

    def show(self, share: float, text: str) -> None:
        """Draw the bar: ``share`` 0 to 1 and the current step."""
        self._bar.n = share
        self._bar.set_postfix_str(text)
        new = share >= self._next or (share >= 1.0 and text != self._text)
        if self._steps and not self.is_shown and new:
            self._text = text
            self._next = math.floor(10 * share + 1) / 10
            _progress.info("%s: %.0f%% %s", self._title, 100 * share, text)
