"""The process that a worker keeps for its tasks: a program, not to be imported.

A task that crashes, hangs or fills the memory ends this process and not the worker's.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Mapping
from typing import Any

import cv2

from flatcloth.batch import jobs
from flatcloth.core.errors import FlatclothError
from flatcloth.core.subprocess_worker import Message, serve
from flatcloth.core.types import Progress

_LOOK_EVERY_S = 0.3
"""Interval between looks at the parent process. Chosen."""


def _end_with(parent: int) -> None:
    """End when the worker ends, also if it was killed: another worker then runs its task."""
    while os.getppid() == parent:
        time.sleep(_LOOK_EVERY_S)
    # SystemExit would end this thread only, and an interrupt of the main thread would wait for compiled code,
    # which takes seconds in which both write the same folder. A killed task is continued from its journal.
    os._exit(1)


def _answer(question: Mapping[str, Any], progress: Progress) -> Message:
    def guarded_progress(share: float, text: str) -> None:
        try:
            progress(share, text)
        except OSError:  # the worker was killed, which is not a failure of the task
            raise SystemExit(1) from None

    return Message(jobs.answer(question, guarded_progress))


def main() -> None:
    """Answer the requests until the input ends."""
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    cv2.setNumThreads(1)
    serve(_answer, FlatclothError)
