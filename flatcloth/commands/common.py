"""The common parts of the commands: opening a session's inputs, progress."""

from __future__ import annotations

import dataclasses
import gc
import math
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Self

from flatcloth.commands.output import is_quiet, logged, progressed

if TYPE_CHECKING:
    from flatcloth.recordings import SourceOptions


def kept_mends(options: SourceOptions, session: Path) -> SourceOptions:
    """Return options with the mends of a session that is continued, if none are given."""
    from flatcloth.core.errors import JournalError
    from flatcloth.recordings import SourceOptions
    from flatcloth.session.header import HEADER, read_header

    if options.mends is not None or not (session / HEADER).exists():
        return options
    try:
        kept = SourceOptions.from_dict(read_header(session).recording.options, str(session))
    except JournalError:
        return options  # it is reported when the session is opened
    return dataclasses.replace(options, mends=kept.mends)


@contextmanager
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
        disable = True if is_quiet() else None  # None: unless stderr is a terminal
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
        logged(text)

    def show(self, share: float, text: str) -> None:
        """Draw the bar: ``share`` 0 to 1 and the current step."""
        self._bar.n = share
        self._bar.set_postfix_str(text)
        new = share >= self._next or (share >= 1.0 and text != self._text)
        if self._steps and not self.is_shown and new:
            self._text = text
            self._next = math.floor(10 * share + 1) / 10
            progressed(f"{self._title}: {share:.0%} {text}")
