"""The search of the best placement, with the candidates that it compared: what the teaching pages show."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np

from flatcloth.core.types import Float64, Progress, Rigid2, no_progress
from flatcloth.methods.paper.matching import Matcher


@dataclass(frozen=True, kw_only=True)
class Search:
    """The candidates of the search around the initial estimate.

    ``cost`` (T, U, V) is that of the coarse search at ``turns_rad`` (T,) and ``shifts_m`` (U,), which
    are used for v as well. ``starts`` (K, 3), rotation and shifts, are the candidates of the detailed
    search; ``path`` (P, 3), with the placements ``motions``, leads from the initial estimate through the
    best of them to the end, which scores ``end_score``. ``tried`` is the number of compared placements.
    """

    turns_rad: Float64
    shifts_m: Float64
    cost: Float64
    starts: Float64
    path: Float64
    motions: tuple[Rigid2, ...]
    tried: int
    end_score: float


class WatchedMatcher(Matcher):
    """Searches exactly like its base class, and records the candidates."""

    def search(self, initial: Rigid2, progress: Progress = no_progress) -> Rigid2:
        """Search around the initial estimate, and forget the search before."""
        self._batches: list[tuple[Float64, Float64]] = []
        self._paths: list[tuple[float, list[Float64]]] = []
        self._initial = initial
        return super().search(initial, progress)

    def _cost(self, motions: list[Rigid2], offsets: Float64, *rest: Any, **named: Any) -> Float64:
        cost = super()._cost(motions, offsets, *rest, **named)
        self._batches.append((offsets, cost))
        return cost

    def _refine(
        self, initial: Rigid2, start: Float64, center: Float64, share: float
    ) -> tuple[float, Float64]:
        first = len(self._batches)
        lowest, best = super()._refine(initial, start, center, share)
        steps = [offsets[int(np.argmin(cost))] for offsets, cost in self._batches[first:]]
        self._paths.append((lowest, [np.zeros(3), start, *steps, best]))
        self._center = center
        return lowest, best

    def _polish(self, initial: Rigid2, start: Float64, center: Float64, share: float) -> Float64:
        self._paths.append((-1.0, [start, super()._polish(initial, start, center, share)]))
        return self._paths[-1][1][-1]

    def seen(self) -> Search:
        """Return the candidates of the last search."""
        (offsets, cost), (*paths, (_, polished)) = self._batches[0], self._paths
        turns, shifts = np.unique(offsets[:, 0]), np.unique(offsets[:, 1])
        steps = min(paths, key=lambda item: item[0])[1] + polished
        path = np.array(steps)[[True, *(bool((a != b).any()) for a, b in itertools.pairwise(steps))]]
        motions = [self._initial @ Rigid2(*map(float, p)).about(self._center) for p in path]
        return Search(
            turns_rad=turns,
            shifts_m=shifts,
            cost=cost.reshape(turns.size, shifts.size, shifts.size),
            starts=np.array([steps[1] for _, steps in paths]),
            path=path,
            motions=tuple(motions),
            tried=sum(len(batch) for batch, _ in self._batches),
            end_score=self.score(motions[-1]).total,
        )
