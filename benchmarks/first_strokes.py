"""From which cost on a first stroke means that the guess was wrong: learned, and leave-one-garment-out.

Each recording is asked for the side that the segmentation guesses, and for the other. After the first
stroke either a region is turned over, or all. What that leaves wrong is measured for both, and the cost
at which the one becomes the other is found by bisection.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from flatcloth.core.strokes import ImageStroke
from flatcloth.core.types import Float64
from flatcloth.segmentation.observed import Observed
from flatcloth.segmentation.result import Segmentation
from flatcloth.segmentation.solver import SideSolver

HIGHEST = 100.0
PRECISION = 0.1


@dataclass(frozen=True)
class FirstStroke:
    """What is wrong, undecided cloth included, if all or a region is turned over; the region's cost."""

    garment: str
    cost: float
    wrong_all: float
    wrong_region: float

    def wrong(self, most: float) -> float:
        """Return what is wrong if regions of at most this cost are turned over."""
        return self.wrong_all if self.cost > most else self.wrong_region


def first_stroke(
    observed: Observed, stroke: ImageStroke, garment: str, wrong: Callable[[Segmentation], float]
) -> FirstStroke:
    """Return what a first stroke leaves wrong, and the cost at which it turns all over."""

    def after(most: float) -> float:
        config = replace(observed.config, most_cost=most)
        return wrong(SideSolver(replace(observed, config=config)).solve([stroke]))

    low, high = 0.0, HIGHEST
    everything, region = after(low), after(high)
    while everything != region and high - low > PRECISION:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if after(middle) == everything else (low, middle)
    return FirstStroke(garment, 0.5 * (low + high) if everything != region else 0.0, everything, region)


def learned_cost(strokes: list[FirstStroke]) -> float:
    """Return the middle of the costs with which least is wrong."""
    costs = np.unique([stroke.cost for stroke in strokes])
    bounds = np.concatenate([[0.0], costs, [HIGHEST]])
    between = 0.5 * (bounds[1:] + bounds[:-1])
    mean: Float64 = np.array([np.mean([stroke.wrong(most) for stroke in strokes]) for most in between])
    best = np.flatnonzero(mean <= mean.min() + 1e-9)
    return float(0.5 * (bounds[best[0]] + bounds[best[-1] + 1]))


def told(strokes: list[FirstStroke], used: float) -> list[str]:
    """Return lines: the learned cost, what is wrong with it and with that in use, leave-one-garment-out."""
    best = learned_cost(strokes)
    with_best, with_used = (np.mean([s.wrong(most) for s in strokes]) for most in (best, used))
    lines = [
        f"most_cost learned {best:.1f}, used {used:.1f}: after {len(strokes)} first strokes {with_best:.1%} "
        f"and {with_used:.1%} of the cloth are wrong or undecided"
    ]
    for garment in sorted({stroke.garment for stroke in strokes}):
        rest = [s for s in strokes if s.garment != garment]
        if rest:
            cost = learned_cost(rest)
            wrong = np.mean([s.wrong(cost) for s in strokes if s.garment == garment])
            lines.append(f"  without {garment}: learned {cost:.1f}, of it {wrong:.1%} are wrong")
    return lines
