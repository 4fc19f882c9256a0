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


class Segmentation(Protocol):
    """The labels of all views, and in words how much of the cloth is certain."""

    @property
    def text(self) -> str:
        """What is to be told, in a sentence."""
        ...

    @property
    def conflicts(self) -> Sequence[Conflict]:
        """Decisions that contradict each other."""
        ...

    @property
    def changed(self) -> Conflict | None:
        """What the last decision changed, in words."""
        ...

    @property
    def area_undecided_m2(self) -> float:
        """Cloth whose side nothing determines."""
        ...

    @property
    def mean_certainty(self) -> float:
        """Mean certainty of the cloth of interest, by area."""
        ...

    def view(self, view_index: int) -> ViewSides | None:
        """Return the labels of a view; None if it shows nothing of the item."""
        ...

    def mask(self, view_index: int) -> Bool | None:
        """Return where the side of interest is, (H, W), in the recorded image; None if it is nowhere."""
        ...


class ViewSides(Protocol):
    """The labels of one view, cropped: 1 of interest, -1 other, 0 undecided, 2 not the item."""

    @property
    def offset_rc(self) -> tuple[int, int]:
        """Where the crop lies in the recorded image."""
        ...

    @property
    def side(self) -> NDArray[np.int8]:
        """Labels (h, w)."""
        ...

    @property
    def certainty(self) -> Float32:
        """Probability (h, w) that the label is right; 0 off the item."""
        ...


class Conflict(Protocol):
    """Two decisions about the same cloth."""

    @property
    def text(self) -> str:
        """What is to be told, in a sentence."""
        ...


class Suggestion(Protocol):
    """Where the next stroke tells most."""

    @property
    def view_index(self) -> int:
        """The view that shows the place best."""
        ...

    @property
    def rc(self) -> tuple[int, int]:
        """The pixel of the recorded image."""
        ...

    @property
    def text(self) -> str:
        """What is to be told, in a sentence."""
        ...


class Solver(Protocol):
    """Labels the cloth of all views, given decisions; remembers what it needs for the next one."""

    def solve(self, decisions: tuple[Decision, ...]) -> Segmentation:
        """Return the labels that follow from decisions."""
        ...

    def where_next(self, decisions: tuple[Decision, ...]) -> Suggestion | None:
        """Return where the next stroke tells most; None if all cloth is determined."""
        ...


class Sides:
    """The side of interest of a recording without masks.

    Parameters
    ----------
    observe : callable
        Looks at all views once (seconds) and returns a solver; is told a progress.
    n_views : int
        Number of views of the recording.
    """

    def __init__(self, observe: Callable[[Progress], Solver], n_views: int) -> None:
        self._observe, self._n_views = observe, n_views
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
        return self._solutions.get(strokes, lambda: self._made(strokes, progress))

    def _made(self, strokes: tuple[Decision, ...], progress: Progress) -> Masks:
        return Masks(self.solver(progress).solve(strokes), self._n_views)

    def solver(self, progress: Progress = no_progress) -> Solver:
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
    """A segmentation of a recording, with a key for each view that tells whether its mask is another."""

    def __init__(self, segmentation: Segmentation, n_views: int) -> None:
        self.segmentation = segmentation
        found = [segmentation.mask(view) for view in range(n_views)]
        self.keys = tuple(0 if mask is None else zlib.crc32(np.packbits(mask).tobytes()) for mask in found)

    def of(self, view_index: int, shape: tuple[int, int]) -> Bool:
        """Return the mask (H, W) of a view."""
        mask = self.segmentation.mask(view_index)
        return np.zeros(shape, dtype=np.bool_) if mask is None else mask
