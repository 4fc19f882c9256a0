"""Named points where the evidence leaves several places for the outline."""

from __future__ import annotations

import dataclasses

import numpy as np
from garment_evidence import at_mean, blank_view, evidence_from

from flatcloth.core.types import Rigid2
from flatcloth.garments.kinds import kind_named
from flatcloth.garments.recognition import POINT_NEAR_M, best_fits, points_of

VIEW = blank_view(np.ones((10, 10), dtype=bool))


def test_a_second_place_as_likely_as_the_first_is_told_in_the_deviation() -> None:
    evidence = evidence_from(at_mean("skirt"))
    fit = best_fits(evidence, [kind_named("skirt")])[0]
    sure = points_of(dataclasses.replace(fit, others=()), VIEW, evidence)
    assert all(point.std_m < 2 * POINT_NEAR_M for point in sure.values())
    away = Rigid2(0.0, 0.4, 0.0)
    other = dataclasses.replace(fit, garment_from_piece=(away @ fit.garment_from_piece[0],), others=())
    # Reached from two starts it is one place; the variance is half of 0.4 m squared, by halves on each axis.
    told = points_of(dataclasses.replace(fit, others=((0.0, other), (0.0, other))), VIEW, evidence)
    for name, point in told.items():
        expected = np.hypot(sure[name].std_m, 0.4 / 2)
        assert abs(point.std_m - expected) < 1e-6
        assert point.pixel is None
    # One that is hardly likely is not told: the answer is sure enough.
    rare = points_of(dataclasses.replace(fit, others=((-12.0, other),)), VIEW, evidence)
    assert {name: point.std_m for name, point in rare.items()} == {
        name: point.std_m for name, point in sure.items()
    }
