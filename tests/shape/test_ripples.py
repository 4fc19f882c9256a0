"""Where a noisy view shows the outline of its cloth next to another layer, whose depth may be mixed in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_up_sheets import STEP_M, grid, nodes_at, observed
from made_up_sheets import shape_of as sheet_shape
from scenes import AXIS, frame, plane

from flatcloth.core.config import SurfaceConfig
from flatcloth.core.types import Bool, Float64
from flatcloth.flattening.surface import observe_surface
from flatcloth.methods.robust.uncertainty import (
    _LOST,
    _STRAIN,
    _changed,
    _layer_rims,
    _spread_m2,
    lengthened,
    ripples_of,
    ripples_under_noise,
)

GRID = grid(12, 12)
EDGE = 120
"""The first column of the sheet; another layer ends where it begins."""


def rims_beside(layer_m: float) -> tuple[Bool, Bool]:
    """Return the rims (H, W) of a sheet at 0.85 m whose left outline is beside a layer, and its pixels."""
    depth, columns = plane(), np.arange(240)
    own = np.zeros(depth.shape, dtype=np.bool_)
    own[40:200, EDGE:200] = True
    beside = (columns >= 60) & (columns < EDGE)
    shown = np.where(own, depth, np.where(beside, layer_m, np.nan))
    surface = observe_surface(frame(shown, own), AXIS, SurfaceConfig())
    assert surface.usable[100, EDGE + 1]
    of_item = np.where(own | (beside & (layer_m > 0.85)), np.float32(1.0), np.float32(0.0))
    return _layer_rims(replace(surface, noisy=True, inverse_depth=of_item)), surface.usable


@pytest.mark.parametrize("layer_m", [0.82, 0.88])
def test_the_rim_is_the_outline_beside_the_layer_as_wide_as_depths_are_mixed(layer_m: float) -> None:
    rims, usable = rims_beside(layer_m)
    first = int(np.flatnonzero(usable[100])[0])
    np.testing.assert_array_equal(np.flatnonzero(rims[100]), first + np.arange(4))
    assert not rims[~usable].any()
    assert not rims[:, first + 6 :].any()  # other outlines, beside which nothing lies


def test_the_rim_around_a_single_pixel_of_another_layer_is_round() -> None:
    depth = plane()
    own = np.zeros(depth.shape, dtype=np.bool_)
    own[40:200, 40:200] = True
    surface = observe_surface(frame(depth, own), AXIS, SurfaceConfig())
    nearer, usable = surface.frame.depth_m.copy(), surface.usable.copy()
    nearer[60, 80], usable[60, 80] = 0.82, False
    rims = _layer_rims(
        replace(surface, noisy=True, usable=usable, frame=replace(surface.frame, depth_m=nearer))
    )
    row, col = np.indices(usable.shape)
    around = np.hypot(row - 60, col - 80)
    np.testing.assert_array_equal(rims, (around <= 4.0) & (around > 0))


def test_a_layer_that_is_hardly_nearer_or_farther_makes_no_rim() -> None:
    for layer_m in (0.843, 0.857):
        assert not rims_beside(layer_m)[0].any()


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


def test_lengths_that_noise_took_of_ripples_are_given_back_to_places_and_pairs_alike() -> None:
    nodes = nodes_at(GRID)
    lean = 0.2 * (-1.0) ** np.rint(GRID[:, 0] / STEP_M)
    rippled = replace(nodes, normal=np.stack([np.sin(lean), 0.0 * lean, -np.cos(lean)], axis=1))
    everything = np.ones(len(GRID), dtype=np.bool_)
    for noisy in (False, True):
        shape = replace(
            sheet_shape(GRID, [observed(GRID, everything, 0, is_noisy=noisy)], everything), nodes=rippled
        )
        longer = lengthened(shape)
        if not noisy:
            assert longer is shape
            continue
        factor = 1.0 + _LOST * ripples_under_noise(shape).mean()
        assert factor > 1.003
        np.testing.assert_allclose(longer.links.length_m, factor * shape.links.length_m)
        np.testing.assert_allclose(longer.links.offset, factor * shape.links.offset)
        np.testing.assert_allclose(np.ptp(longer.uv_m, axis=0), factor * np.ptp(GRID, axis=0))
        np.testing.assert_allclose(longer.uv_m.mean(axis=0), GRID.mean(axis=0), atol=1e-9)  # it stays there


def test_a_pair_changes_by_the_mean_strain_along_it() -> None:
    fields = np.random.default_rng(0).normal(size=(2, 3, 4))
    angle = 0.7
    unit = np.array([[np.cos(angle), np.sin(angle)]])
    (found,) = _changed(fields, np.array([[0, 1]], dtype=np.int32), unit, np.empty((1, 4)))
    uu, uv, vv = fields.mean(axis=0)
    strain = np.array([[uu, uv / np.sqrt(2.0)], [uv / np.sqrt(2.0), vv]])
    np.testing.assert_allclose(found, _STRAIN * np.einsum("i,ijk,j->k", unit[0], strain, unit[0]))


def test_relative_to_a_single_anchor_nothing_turns() -> None:
    moved = np.array([[0.001, 0.004j], [-0.002, 0.001 + 0.002j]])
    spread_m2 = _spread_m2(moved, np.array([[0.0, 0.0], [0.1, 0.0]]), np.array([0]))
    np.testing.assert_allclose(spread_m2, [0.0, (17e-6 + 13e-6) / 2])
