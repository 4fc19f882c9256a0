"""Masks for a recording that has none: the side of interest, found once and corrected by each stroke.

The engine derives everything else from masks. :class:`Sides` answers which masks belong to a
document's strokes, and which views changed since the masks that are in force.
"""

from __future__ import annotations

import threading
import zlib
from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.cache import Cache
from flatcloth.core.strokes import Decision
from flatcloth.core.types import Bool, Float32, Progress, no_progress

SOLUTIONS_KEPT = 8
"""Undo and redo of the last strokes need no new solution."""


class SideView(Protocol):
    """The labels of one view: ``side`` int8, 1 of interest, -1 other, 0 undecided, 2 not the item."""

    side: NDArray[np.int8]
    certainty: Float32

    def mask(self, shape: tuple[int, int]) -> Bool:
        """Return where the side of interest is, (H, W), in the recorded image."""
        ...


class Segmentation(Protocol):
    """The labels of all views, and in words how much of the cloth is certain."""

    views: Sequence[SideView]
    text: str


class Solver(Protocol):
    """Labels the cloth of all views, given decisions; remembers what it needs for the next one."""

    def solve(self, decisions: tuple[Decision, ...]) -> Segmentation:
        """Return the labels that follow from decisions."""
        ...


class Sides:
    """The side of interest of a recording without masks.

    Parameters
    ----------
    observe : callable
        Looks at all views once (seconds) and returns a solver; is told a progress.
    """

    def __init__(self, observe: Callable[[Progress], Solver]) -> None:
        self._observe = observe
        self._solver: Solver | None = None
        self._lock = threading.Lock()
        self._solutions: Cache[Masks] = Cache(SOLUTIONS_KEPT)

    def masks(self, strokes: tuple[Decision, ...], progress: Progress = no_progress) -> Masks:
        """Return the masks that follow from strokes.

        Raises
        ------
        SegmentationError
            If the item or its side of interest cannot be found.
        """
        return self._solutions.get(strokes, lambda: Masks(self._solved(progress).solve(strokes)))

    def _solved(self, progress: Progress) -> Solver:
        with self._lock:
            if self._solver is None:
                self._solver = self._observe(progress)
            return self._solver


class Masks:
    """A segmentation, with a key a view that tells whether its mask is another."""

    def __init__(self, segmentation: Segmentation) -> None:
        self.segmentation = segmentation
        self.keys = tuple(zlib.crc32((view.side == 1).tobytes()) for view in segmentation.views)

    def of(self, view_index: int, shape: tuple[int, int]) -> Bool:
        """Return the mask (H, W) of a view."""
        return self.segmentation.views[view_index].mask(shape)
