"""Named points where the evidence leaves several places for the outline."""

import dataclasses

import numpy as np
from garment_evidence import at_mean, blank_view, evidence_from

from flatcloth.core.types import Rigid2
from flatcloth.garments.kinds import kind_named
from flatcloth.garments.named_points import POINT_NEAR_M, points_of
from flatcloth.garments.recognition import fits_of

VIEW = blank_view(np.ones((10, 10), dtype=bool))


def test_a_second_place_as_likely_as_the_first_is_told_in_the_deviation() -> None:
    evidence = evidence_from(at_mean("skirt"))
    fit = fits_of(evidence, [kind_named("skirt")])[0]
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


def test_a_named_point_follows_the_edges_around_it() -> None:
    evidence = evidence_from(at_mean("towel"))
    fit = fits_of(evidence, [kind_named("towel")])[0]
    before = points_of(fit, VIEW, evidence)
    corner = before["corner_0"].uv_m
    moved = np.array([0.006, -0.004])
    around = np.linalg.norm(evidence.edge_uv_m - corner, axis=1) < 0.12
    edges = evidence.edge_uv_m + np.where(around[:, None], moved, 0.0)
    after = points_of(fit, VIEW, dataclasses.replace(evidence, edge_uv_m=edges))
    # The fit of the whole outline is its prior, and holds it back a little.
    assert np.linalg.norm(after["corner_0"].uv_m - corner - moved) < 0.4 * np.linalg.norm(moved)
    for name in ("corner_1", "corner_2", "corner_3"):
        np.testing.assert_allclose(after[name].uv_m, before[name].uv_m, atol=1e-9)
