"""A batch: run the tasks that are not done, store each result immediately, and write the table."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from pathlib import Path
from typing import Any

from flatcloth.batch.engines import Answer, Engine, Limits
from flatcloth.batch.report import read_verdicts
from flatcloth.batch.rows import (
    CRASHED,
    DONE,
    UNFINISHED,
    next_attempt,
    read_row,
    rows_in,
    write_row,
    write_table,
)
from flatcloth.batch.tasks import Task, quick_signature
from flatcloth.core.errors import FlatclothError, os_errors_as
from flatcloth.session.journal_file import LockedError, open_locked

Row = dict[str, Any]
_TABLE_EVERY_S = 60.0
"""Interval of writing the table. Chosen: a killed batch loses at most this much of its report."""
_LOCK = ".batch.lock"


def pending(tasks: Sequence[Task], out: Path, *, again: bool) -> list[Task]:
    """Return the tasks that are not done: no row, a failure, changed content or settings."""
    if again:
        return list(tasks)
    waiting = []
    for task in tasks:
        row = read_row(out / task.name)
        if row is None or row["outcome"] != DONE or row.get("quick") != quick_signature(task):
            waiting.append(task)
    return waiting


def run_batch(
    waiting: Sequence[Task], out: Path, start: Callable[[], Engine], limits: Limits, *, again: bool = False
) -> Generator[Row, None, None]:
    """Run tasks, and yield the row of each when it is kept; the table is written each minute and at the end.

    Parameters
    ----------
    waiting : sequence of Task
        Those that are not done (:func:`pending`).
    out : Path
        Folder for the table and the folders of the tasks.
    start : callable
        Returns the engine that runs them; called only if a task is to be run.
    limits : Limits
        Of each task.
    again : bool
        Run also what a worker finds to be done.

    Raises
    ------
    FlatclothError
        If the output cannot be written.
    """
    questions = [{"task": task.to_dict(), "out": str(out.resolve()), "again": again} for task in waiting]
    next_table_s = time.monotonic() + _TABLE_EVERY_S
    try:
        with start() if questions else contextlib.nullcontext() as engine:
            for number, answer in engine.run(questions, limits) if engine else ():
                yield _row_of(waiting[number], answer, out)
                if time.monotonic() > next_table_s:
                    write_results(out)
                    next_table_s = time.monotonic() + _TABLE_EVERY_S
    finally:
        write_results(out)


def _row_of(task: Task, answer: Answer, out: Path) -> Row:
    if isinstance(answer, Exception):
        text = " ".join(str(answer).split())[:300]
        answer = {"outcome": CRASHED, "reason": f"its worker gave no result ({text})."}
    if "name" in answer:
        return answer
    folder = out / task.name
    before = read_row(folder)
    begun = before is not None and before["outcome"] == UNFINISHED
    row = {
        "name": task.name,
        "source": task.source,
        "method": task.method,
        "content": None if before is None else before.get("content"),
        **(dict(before) if before is not None and begun else next_attempt(before)),
        **answer,
    }
    write_row(row, folder)
    return row


def write_results(out: Path) -> None:
    """Write the table of all results in a folder, with the operator's verdicts."""
    decided, _ = read_verdicts(out)
    rows = [{**row, "review": decided.get(row["name"])} for row in rows_in(out)]
    write_table(rows, out)


@contextlib.contextmanager
def owned(out: Path) -> Iterator[None]:
    """Lock an output folder: two batches at once would run all tasks twice.

    Raises
    ------
    FlatclothError
        If it cannot be written, or another process has the lock.
    """
    try:
        with os_errors_as(FlatclothError, f"{out}: cannot be written", "Choose another --out."):
            out.mkdir(parents=True, exist_ok=True)
            lock = open_locked(out / _LOCK)
    except LockedError as error:
        raise FlatclothError(
            f"{out}: another batch is at it; wait for it, or choose another --out."
        ) from error
    try:
        yield
    finally:
        os.close(lock)
