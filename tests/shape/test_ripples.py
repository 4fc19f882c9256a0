"""Ripples of cloth, which a noisy sensor smooths away together with its lengths."""

import numpy as np
import pytest

from flatcloth.core.types import Float64
from flatcloth.shape.deviations import ripples_of


def rolled(lean_rad: Float64) -> tuple[Float64, Float64, Float64]:
    """Return nodes 12 mm apart on a cylinder of 0.2 m: places, points, and normals leaned along u."""
    at = 0.012 * np.stack(np.meshgrid(np.arange(24.0), np.arange(24.0)), axis=2).reshape(-1, 2)
    turn = at[:, 0] / 0.2
    xyz_m = np.stack([0.2 * np.sin(turn), at[:, 1], -0.2 * np.cos(turn)], axis=1)
    leaned = turn + lean_rad
    return at, xyz_m, np.stack([np.sin(leaned), np.zeros(len(at)), -np.cos(leaned)], axis=1)


def test_ripples_are_told_from_bending() -> None:
    column = np.arange(24 * 24) % 24
    bent = ripples_of(*rolled(np.zeros(24 * 24)))
    assert bent.max() < 0.002  # the cylinder turns by 0.06 rad, 0.0036 rad^2, from node to node
    weak, strong = (ripples_of(*rolled(lean * np.where(column % 2 == 0, 1.0, -1.0))) for lean in (0.1, 0.2))
    assert 4.0 * bent.mean() < weak.mean() < 0.5 * strong.mean()  # neighbours differ by twice the lean
    assert 0.02 < strong.mean() < 0.4**2


def test_ripples_are_those_of_the_cloth_around() -> None:
    column = np.arange(24 * 24) % 24
    ripples = ripples_of(*rolled(np.where(column < 12, 0.2 * (-1.0) ** column, 0.0)))
    assert ripples[column > 18].max() < 0.002 < 0.02 < ripples[column < 6].min()


def test_cloth_that_lies_on_other_cloth_is_no_ripple() -> None:
    at, xyz_m, normal = rolled(np.zeros(24 * 24))
    above = xyz_m + np.array([0.0, 0.0, 0.2])
    both = [np.concatenate(two) for two in ((at, at + 0.003), (xyz_m, above), (normal, -normal))]
    assert ripples_of(*both)[: len(at)] == pytest.approx(ripples_of(at, xyz_m, normal), abs=1e-3)


def test_too_few_nodes_have_no_ripples() -> None:
    at, xyz_m, normal = rolled(np.zeros(24 * 24))
    assert ripples_of(at[:1], xyz_m[:1], normal[:1]).tolist() == [0.0]
