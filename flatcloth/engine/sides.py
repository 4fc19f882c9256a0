"""Masks for a recording that has none: the side of interest, found once and corrected by each stroke.

The engine derives everything else from masks. :class:`Sides` answers which masks belong to a
document's strokes, and which views changed since the masks that are in force.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np

from flatcloth.core.cache import Cache
from flatcloth.core.strokes import Decision
from flatcloth.core.types import Bool, Progress, no_progress
from flatcloth.segmentation.result import Segmentation
from flatcloth.segmentation.solver import SideSolver

SOLUTIONS_KEPT = 8
"""Number of cached solutions, for undo and redo of strokes. Set by hand."""


class Sides:
    """The side of interest of a recording without masks.

    Parameters
    ----------
    observe : callable
        Reads all views once (takes seconds) and returns a solver; called with a progress.
    n_views : int
        Number of views of the recording.
    """

    def __init__(self, observe: Callable[[Progress], SideSolver], n_views: int) -> None:
        self._observe, self._n_views = observe, n_views
        self._solver: SideSolver | None = None
        self._lock = threading.Lock()
        self._solutions: Cache[Masks] = Cache(SOLUTIONS_KEPT)

    def masks(self, strokes: tuple[Decision, ...], progress: Progress = no_progress) -> Masks:
        """Return the masks that follow from strokes.

        Raises
        ------
        SegmentationError
            If the item or its side of interest cannot be found.
        """
        solve = self.solver
        return self._solutions.get(strokes, lambda: Masks(solve(progress).solve(strokes), self._n_views))

    def solver(self, progress: Progress = no_progress) -> SideSolver:
        """Return the solver; the first call looks at all views.

        Raises
        ------
        SegmentationError
            If no view shows an item, or there are two.
        """
        with self._lock:
            if self._solver is None:
                self._solver = self._observe(progress)
            return self._solver


class Masks:
    """A segmentation of a recording, with a key for each view that changes with its mask."""

    def __init__(self, segmentation: Segmentation, n_views: int) -> None:
        self.segmentation = segmentation
        self.keys = tuple(segmentation.mask_key(view) for view in range(n_views))

    def of(self, view_index: int, shape: tuple[int, int]) -> Bool:
        """Return the mask (H, W) of a view."""
        mask = self.segmentation.mask(view_index)
        return np.zeros(shape, dtype=np.bool_) if mask is None else mask
