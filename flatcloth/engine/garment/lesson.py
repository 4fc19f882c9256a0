"""How a garment is recognised, step by step: for the teaching mode."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flatcloth.core.types import FlattenedView, Float64, Progress, no_progress
from flatcloth.engine.garment.recognition import KnownGarment
from flatcloth.garments.evidence import PieceEvidence
from flatcloth.garments.example import half_seen_tshirt
from flatcloth.garments.fit import STARTS, TEMPERATURE, Fit, refine, starts
from flatcloth.garments.recognition import NONE, THINNED, fits_of, probabilities_by

_STEPS = ((4.0, 6), (2.0, 6), (1.0, 8))
"""Factors on the standard deviations, and number of steps with each. Chosen: a few more than in the fit."""


@dataclass(frozen=True, kw_only=True)
class GarmentLesson:
    """The recognition of one shape.

    ``view`` is the shape, or None for an example, if the session has no shape of two views yet. ``evidence``
    is that of the shape; ``fits`` are the best of each kind, the most probable first, ``probabilities`` are
    those by this shape alone, at a ``temperature``. ``states`` (S, K, V, 2) are the outlines on the shape's
    plane from each of K starts with the best kind, step by step, and ``energy`` (S, K) their costs;
    ``widened`` (S,) is the factor on the standard deviations in each step.
    """

    view: FlattenedView | None
    evidence: PieceEvidence
    temperature: float
    fits: tuple[Fit, ...]
    probabilities: dict[str, float]
    states: Float64
    energy: Float64
    widened: Float64


def garment_lesson(known: KnownGarment | None, progress: Progress = no_progress) -> GarmentLesson:
    """Return the lesson about a known garment, or about an example."""
    evidence = half_seen_tshirt() if known is None else known.evidence[0]
    progress(0.1, "fitting every kind")
    fits = fits_of(evidence)
    temperature = TEMPERATURE if known is None else known.by_evidence.temperature
    probabilities = probabilities_by(fits, evidence, temperature)
    progress(0.7, "following the fits")
    states, energy, widened = _followed(fits[0], evidence)
    return GarmentLesson(
        view=None if known is None else known.canonical.view,
        evidence=evidence,
        temperature=temperature,
        fits=tuple(fits),
        probabilities={
            **{fit.kind.name: probabilities[fit.kind.name] for fit in fits},
            NONE: probabilities[NONE],
        },
        states=states,
        energy=energy,
        widened=widened,
    )


def _followed(best: Fit, evidence: PieceEvidence) -> tuple[Float64, Float64, Float64]:
    kind, coarse = best.kind, evidence.thinned(THINNED)
    now = [
        refine(kind, (coarse,), parameters, (pose,), annealed=())
        for parameters, pose in starts(kind, evidence, STARTS)
    ]
    rows, factors = [now], [_STEPS[0][0]]
    for widened, steps in _STEPS:
        for _ in range(steps):
            now = [
                refine(
                    kind, (coarse,), fit.parameters, fit.garment_from_piece, annealed=(widened,), most_steps=1
                )
                for fit in now
            ]
            rows.append(now)
            factors.append(widened)
    outlines = [[fit.garment_from_piece[0].inverse().apply(fit.outline) for fit in row] for row in rows]
    return np.array(outlines), np.array([[fit.energy for fit in row] for row in rows]), np.array(factors)
