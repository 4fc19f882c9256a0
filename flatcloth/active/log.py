"""``active.jsonl``: a loop's questions, expectations, results and messages; each line is on disk at once."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from flatcloth.active.goal import Goal
from flatcloth.core.decoding import decoded
from flatcloth.core.errors import JournalError, os_errors_as
from flatcloth.core.geometry import widest_gap_deg
from flatcloth.session.journal_file import JournalFile, LockedError

LOG = "active.jsonl"
LAST_VIEWS = 3
"""Views by which it is judged what an expectation is worth. Chosen: one may be unlucky, three are not."""
ALL_ROUND_DEG = 60.0
"""Widest gap between views that stand all round: every surface is then seen within 30 degrees. Set by hand,
on a few loops of ``benchmarks active``. That something cannot be known is said at half of it: with all of it,
six loops gave up after 9 to 11 views, and knew five kinds and a pair of points after 10 to 23."""


def stand_all_round(angles_deg: Sequence[float], goal: Goal) -> bool:
    """Return whether no gap between views is too wide to say that they show all cloth, for a goal."""
    is_shape = goal.about == "shape"
    return widest_gap_deg(angles_deg) <= (ALL_ROUND_DEG if is_shape else ALL_ROUND_DEG / 2)


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
            with os_errors_as(JournalError, f"{self._path}: cannot be used", "Check it."):
                self._file = JournalFile(self._path)
                self._file.cut(self._file.data.rfind(b"\n") + 1)
        except LockedError as error:
            raise JournalError(f"{folder}: another active loop takes its views. End it first.") from error
        self.lines: list[dict[str, Any]] = []
        for number, text in enumerate(self._file.data.splitlines(), start=1):
            try:
                self.lines.append(decoded(text, dict[str, Any]))
            except ValueError as error:
                self.close()
                remedy = "Remove the file: it only tells the past."
                raise JournalError(f"{self._path}: line {number} is damaged. {remedy}") from error

    @property
    def seconds(self) -> float:
        """The time that earlier runs took."""
        return max((float(line.get("elapsed_s", 0.0)) for line in self.lines), default=0.0)

    def add(self, event: str, **values: Any) -> None:
        """Append a line, and wait until it is on disk; raises ``JournalError``."""
        line = {"event": event, **values}
        with os_errors_as(JournalError, f"{self._path}: cannot be written", "Free disk space."):
            self._file.append(json.dumps(line, allow_nan=False).encode() + b"\n")
        self.lines.append(line)

    def steps(self) -> list[dict[str, Any]]:
        """Return the lines of the views, each with the ``why`` of its question."""
        why = {line["number"]: line["why"] for line in self.lines if line["event"] == "ask"}
        views = (line for line in self.lines if line["event"] == "view")
        return [{"why": why.get(line["number"], ""), **line} for line in views]

    def kept_promise(self) -> float:
        """Return the new area that the last views brought, as a share of what was expected of them.

        Before there are three that joined the shape, the others count as 1; no more is believed than was
        promised.
        """
        views = [line for line in self.lines if line.get("joined") and line.get("expected_m2")][-LAST_VIEWS:]
        got, expected = (sum(max(0.0, line[key]) for line in views) for key in ("new_m2", "expected_m2"))
        kept = min(1.0, got / max(expected, 1e-9))
        return float(1.0 - (1.0 - kept) * len(views) / LAST_VIEWS)

    def is_exhausted(self, angles_deg: Sequence[float], least_new_m2: float, goal: Goal) -> bool:
        """Return whether views stand all round, and the last ones brought neither cloth nor other news."""
        views = [line for line in self.lines if line["event"] == "view"][-LAST_VIEWS:]
        return stand_all_round(angles_deg, goal) and all(
            line.get("new_m2", math.inf) < least_new_m2 and not line.get("news", True) for line in views
        )

    def close(self) -> None:
        """Close the file."""
        self._file.close()
