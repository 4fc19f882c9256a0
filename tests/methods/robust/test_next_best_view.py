"""The next best view of a cylinder, of which one view is known; sums over neighbours, by their formulas."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from made_up_sheets import shape_of_view
from scenes import AXIS, Cylinder, placed_view

from flatcloth.methods.answers import Candidate
from flatcloth.methods.robust.next_best_view import rate_candidates, seams_ahead, sums_around
from flatcloth.shape.shape import Shape

ANGLES = tuple(float(a) for a in range(0, 360, 10))
RADIUS_M, HEIGHT_M = 0.12, 0.20


def shape_of(span_deg: tuple[float, float] = (-180.0, 180.0)) -> Shape:
    cylinder = Cylinder(angles_deg=(0.0,), span_deg=span_deg)
    return shape_of_view(placed_view(cylinder[0]), cylinder.flat_uv_m)


@pytest.fixture(scope="module")
def shape() -> Shape:
    return shape_of()


def rated(shape: Shape, views: range = range(1, 36)) -> dict[int, Candidate]:
    return {c.view_index: c for c in rate_candidates(shape, AXIS, ANGLES, views, {0}, 0.03)}


def test_the_overlap_is_the_cloth_that_both_views_see_well(shape: Shape) -> None:
    """Both see within 55 degrees of incidence; seen from 0.73 m that is about 48 degrees around the axis."""
    found = rated(shape)
    for view, turn_deg in ((2, 20.0), (5, 50.0)):
        common = np.radians(2 * 48.0 + 2 * 8.0 - turn_deg) * RADIUS_M * HEIGHT_M
        assert found[view].overlap_m2 == pytest.approx(common, rel=0.2)
    assert found[18].overlap_m2 == 0.0


def test_left_and_right_are_alike_for_a_round_item(shape: Shape) -> None:
    found = rated(shape)
    for view in (1, 3, 6):
        assert found[view].overlap_m2 == pytest.approx(found[36 - view].overlap_m2, rel=0.05)
        assert found[view].new_m2 == pytest.approx(found[36 - view].new_m2, rel=0.1)


def test_the_best_view_turns_the_rim_to_the_camera_and_keeps_an_overlap(shape: Shape) -> None:
    best, *_ = rate_candidates(shape, AXIS, ANGLES, range(1, 36), {0}, 0.03)
    turn = abs((ANGLES[best.view_index] + 180.0) % 360.0 - 180.0)
    assert 30.0 <= turn <= 90.0
    assert best.beyond_m2 > rated(shape)[1].beyond_m2
    assert best.overlap_m2 > 0.003


def test_beyond_a_rim_that_two_views_saw_end_less_is_expected(shape: Shape) -> None:
    """A rim that stays where it is in several frontal views is the end of the cloth, not an occlusion."""
    narrow = shape_of(span_deg=(-30.0, 30.0))
    again = replace(
        narrow, observations=narrow.observations * 2, object_from_camera=narrow.object_from_camera * 2
    )
    before, after = rated(narrow, range(4, 5))[4], rated(again, range(4, 5))[4]
    assert after.beyond_m2 == pytest.approx(0.5 * before.beyond_m2, rel=0.05)


def test_unseen_cloth_is_allowed_for_with_the_gap_to_the_nearest_view(shape: Shape) -> None:
    found = rated(shape)
    assert found[1].unseen_m2 == 0.0
    assert found[9].unseen_m2 == pytest.approx(0.001 * (90.0 - 40.0))
    assert found[9].gap_deg == 90.0


def test_cloth_behind_a_nearer_layer_is_not_expected_to_be_seen(shape: Shape) -> None:
    """A copy of the cylinder behind itself: hidden if it lies well behind, seen if both layers touch."""
    behind = np.array([0.0, 0.0, 1.0])

    def overlap_m2(farther_m: float) -> float:
        xyz = np.concatenate([shape.nodes.xyz_m, 0.9 * (shape.nodes.xyz_m - AXIS.point_m) + AXIS.point_m])
        xyz[len(shape.nodes) :] += (farther_m - 0.012) * behind
        twice = {name: np.concatenate([getattr(shape, name)] * 2) for name in ("piece", "std_m", "all_uv_m")}
        twice["all_uv_m"][len(shape.nodes) :] += (0.0, 1.0)
        nodes = replace(
            shape.nodes, xyz_m=xyz, normal=np.tile(shape.nodes.normal, (2, 1)), weight=np.ones(len(xyz))
        )
        seen = shape.observations[0]
        copy = replace(seen, node=seen.node + np.int32(len(shape.nodes)))
        both = replace(
            shape,
            nodes=nodes,
            graph=replace(shape.graph, xyz_m=xyz),
            observations=(seen, copy),
            object_from_camera=shape.object_from_camera * 2,
            **twice,
        )
        return rated(both, range(1, 2))[1].overlap_m2

    assert overlap_m2(0.06) < 0.75 * overlap_m2(0.0)


def test_a_view_of_the_gap_to_a_floating_piece_may_join_it(shape: Shape) -> None:
    """The upper half floats next to the rest: it may be joined where both sides of the gap are seen."""
    upper = shape.nodes.xyz_m[:, 1] < np.median(shape.nodes.xyz_m[:, 1])
    apart = replace(shape, piece=np.where(upper & (shape.piece == 0), 1, shape.piece).astype(np.int32))
    whole, found = rated(shape), rated(apart)
    assert all(candidate.joining_m2 == 0.0 for candidate in whole.values())
    area_m2 = whole[3].overlap_m2 / found[3].overlap_m2
    assert area_m2 == pytest.approx(1.0, rel=0.05)
    share = upper[shape.piece == 0].mean()
    cloth_m2 = np.radians(2 * 72.0) * RADIUS_M * HEIGHT_M
    assert found[3].joining_m2 == pytest.approx(0.5**2 * 0.5 * share * cloth_m2, rel=0.25)
    assert found[1].joining_m2 == pytest.approx(found[3].joining_m2 / 9.0, rel=0.15)  # as little of it is new
    assert found[18].joining_m2 == 0.0  # from behind nothing of the gap is seen
    assert found[3].new_m2 > whole[3].new_m2
    # Where one side of the gap is turned away, a view joins nothing.
    away = np.where((apart.piece == 0)[:, None], -1.0, 1.0) * apart.nodes.normal
    hidden = rated(replace(apart, nodes=replace(apart.nodes, normal=away)))
    assert hidden[3].joining_m2 == 0.0


def test_cloth_that_floats_counts_where_it_is_seen_with_the_shape(shape: Shape) -> None:
    upper = shape.nodes.xyz_m[:, 1] < np.median(shape.nodes.xyz_m[:, 1])
    apart = replace(shape, piece=np.where(upper & (shape.piece == 0), 1, shape.piece).astype(np.int32))
    whole, found = rated(shape), rated(apart)
    assert all(candidate.floating_m2 == 0.0 for candidate in whole.values())
    # All of it within 72 degrees, well or not; the rest is seen with it, more than 0.03 m2 of overlap asks.
    cloth_m2 = upper[shape.piece == 0].mean() * np.radians(2 * 72.0) * RADIUS_M * HEIGHT_M
    assert found[1].floating_m2 == pytest.approx(cloth_m2, rel=0.1)
    assert found[6].floating_m2 < found[1].floating_m2  # less of both is seen
    assert found[18].floating_m2 == 0.0  # from behind nothing of it is seen


def test_a_seam_is_expected_where_a_view_shows_the_borders_of_both_sides() -> None:
    """One half of a cylinder is this side, the other half the other; their borders meet at 0 degrees."""
    sides = shape_of((-180.0, 0.0)), shape_of((0.0, 180.0))
    facing, oblique, behind = seams_ahead(sides, AXIS, (0.0, 70.0, 180.0), related=False)
    # A view shows 66 degrees of each half, a little more with its border; even odds to join the smaller.
    assert facing == pytest.approx(0.5 * np.radians(66.0) * RADIUS_M * HEIGHT_M, rel=0.25)
    assert behind == 0.0
    assert oblique < facing
    assert not seams_ahead(sides, AXIS, (0.0,), related=True).any(), "nothing floats"


def test_sums_are_over_pairs_of_placed_nodes_weighted_by_their_views() -> None:
    random = np.random.default_rng(0)
    uv, xyz = random.normal(size=(6, 2)), random.normal(size=(6, 3))
    pairs = np.array([[0, 1], [0, 2], [1, 2], [2, 3], [3, 4], [4, 5]], dtype=np.int32)
    views = np.array([1, 2, 3, 4, 5, 6])
    has_place = np.arange(6) != 5
    graph, holds = SimpleNamespace(pairs=pairs, views=views), np.arange(6) != 2
    shape: Any = SimpleNamespace(
        graph=graph, holds=holds, has_place=has_place, all_uv_m=uv, nodes=SimpleNamespace(xyz_m=xyz)
    )
    views, (number, lean, inwards) = views * holds, sums_around(shape)
    for node in range(6):
        seen, other = [], []
        for (i, j), count in zip(pairs.tolist(), views.tolist(), strict=True):
            if node in (i, j) and has_place[[i, j]].all():
                seen.append(count)
                other.append(j if i == node else i)
        to, step, weight = uv[other] - uv[node], xyz[other] - xyz[node], np.array(seen, dtype=float)
        share = weight / np.linalg.norm(to, axis=1)
        assert number[node] == weight.sum()
        np.testing.assert_allclose(lean[node], share @ to, atol=1e-12)
        np.testing.assert_allclose(inwards[node], share @ step, atol=1e-12)
