import numpy as np
import pytest
from scenes import AXIS, Cylinder, box, flattened, frame, plane, rays

from flatcloth.core.config import PlanningConfig, SurfaceConfig
from flatcloth.core.types import RgbdFrame, Rigid2
from flatcloth.flattening.surface import observe_surface
from flatcloth.methods.answers import ColumnCurves
from flatcloth.methods.paper.planning import (
    choose,
    column_curves,
    occluding_edge_length_m,
    overlap_column,
    plan_side,
    rotation_step_deg,
)
from flatcloth.session.document import Side

CONFIG = PlanningConfig()
ANGLES = tuple(float(a) for a in range(0, 360, 10))


def linear_curves(
    low_deg: float, high_deg: float, width_m: float = 0.3, height_px: int = 100
) -> ColumnCurves:
    """A view of constant height whose Z-angle grows evenly with u."""
    n = round(width_m / 0.002)
    return ColumnCurves(
        u_m=np.arange(n) * 0.002,
        column_count=np.full(n, height_px, dtype=np.int32),
        column_mean_z_angle_deg=np.linspace(low_deg, high_deg, n),
        pixel_size_m=0.002,
    )


def edge_m(shown: RgbdFrame, side: Side) -> float:
    return occluding_edge_length_m(observe_surface(shown, AXIS, SurfaceConfig()), side)


def test_curves_of_a_cylinder_are_linear_in_u_within_the_limit() -> None:
    cylinder = Cylinder()
    curves = column_curves(flattened(cylinder[0]).view, AXIS, 0.0, 50.0)
    angle = curves.column_mean_z_angle_deg
    assert np.abs(angle).max() < 50
    slope = np.polyfit(curves.u_m, angle, 1)[0]
    assert slope == pytest.approx(np.degrees(1 / cylinder.radius_m), rel=0.01)
    assert curves.column_count.max() * 0.002 == pytest.approx(2 * cylinder.half_height_m, rel=0.05)


def test_curves_shift_by_the_rotation_and_move_with_the_frame() -> None:
    view = flattened(Cylinder()[0]).view
    still = column_curves(view, AXIS, 0.0, 90.0)
    turned = column_curves(view, AXIS, 20.0, 90.0)
    both = np.intersect1d(still.u_m, turned.u_m)
    difference = (
        turned.column_mean_z_angle_deg[np.isin(turned.u_m, both)]
        - still.column_mean_z_angle_deg[np.isin(still.u_m, both)]
    )
    assert np.median(difference) == pytest.approx(20.0, abs=1e-6)
    moved = column_curves(view, AXIS, 0.0, 90.0, Rigid2(0.0, 0.05, 0.3))
    np.testing.assert_allclose(moved.u_m - still.u_m, 0.05, atol=1e-9)
    np.testing.assert_array_equal(moved.column_count, still.column_count)


@pytest.mark.parametrize("side", Side)
def test_overlap_column_is_where_the_area_from_the_side_exceeds_s0(side: Side) -> None:
    curves = linear_curves(-49, 49)
    u_b, a_0 = overlap_column(curves, side, 0.02)
    # Columns are 0.2 m high: 0.02 m2 are 50 columns, the 51st exceeds them.
    index = 50 if side is Side.LEFT else curves.u_m.size - 51
    assert u_b == pytest.approx(curves.u_m[index])
    assert a_0 == pytest.approx(curves.column_mean_z_angle_deg[index])


def test_overlap_column_of_a_view_smaller_than_s0_is_its_far_end() -> None:
    curves = linear_curves(-49, 49)
    assert overlap_column(curves, Side.LEFT, 10.0)[1] == pytest.approx(49)
    assert overlap_column(curves, Side.RIGHT, 10.0)[1] == pytest.approx(-49)


@pytest.mark.parametrize(
    ("low", "high", "side", "expected"),
    [
        (-49, 20, Side.LEFT, 50.0),
        (-49, -20, Side.LEFT, 50.0),
        (-49, 30, Side.RIGHT, 50.0),
        (-20, 45, Side.RIGHT, 40.0),
    ],
)
def test_rotation_is_the_limit_less_a0_held_to_10_and_50(
    low: float, high: float, side: Side, expected: float
) -> None:
    curves = linear_curves(low, high)
    _, a_0 = overlap_column(curves, side, CONFIG.overlap_area_m2)
    plan = plan_side(side, curves, 1.0, 0, ANGLES, frozenset({0}), 0.0, CONFIG)
    sign = 1 if side is Side.LEFT else -1
    assert plan.rotation_deg == pytest.approx(np.clip(50 - sign * a_0, 10, 50))
    assert plan.view_index is not None
    turn = sign * ANGLES[plan.view_index] % 360
    assert turn == pytest.approx(np.floor(plan.rotation_deg / 10 + 0.4) * 10)
    assert abs(turn - expected) <= 10


def test_unavailable_views_are_passed_over_and_in_the_end_the_side_is_done() -> None:
    curves = linear_curves(-49, -20)
    first = plan_side(Side.LEFT, curves, 1.0, 0, ANGLES, frozenset({0}), 0.0, CONFIG)
    second = plan_side(Side.LEFT, curves, 1.0, 0, ANGLES, frozenset({0, first.view_index}), 0.0, CONFIG)
    assert first.view_index == 5
    assert second.view_index == 4
    done = plan_side(Side.LEFT, curves, 1.0, 0, ANGLES, frozenset(range(6)), 0.0, CONFIG)
    assert done.view_index is None
    assert "no view remains" in done.reason


def test_a_full_turn_ends_the_side() -> None:
    curves = linear_curves(-49, -20)
    assert plan_side(Side.LEFT, curves, 1.0, 0, ANGLES, frozenset(), 320.0, CONFIG).view_index == 3
    assert plan_side(Side.LEFT, curves, 1.0, 0, ANGLES, frozenset(), 350.0, CONFIG).view_index is None


def test_a_side_without_occluding_edge_has_nothing_to_give() -> None:
    side = plan_side(Side.LEFT, linear_curves(-49, 49), 0.01, 0, ANGLES, frozenset(), 0.0, CONFIG)
    assert side.view_index is None
    assert "no occluding edge" in side.reason
    plan = choose([side], None)
    assert plan.view_index is None
    assert "No view can add anything" in plan.reason


def test_the_side_of_the_last_view_goes_on_else_the_longer_edge() -> None:
    sides = [
        plan_side(side, linear_curves(-49, 49), length, 0, ANGLES, frozenset({0}), 0.0, CONFIG)
        for side, length in ((Side.LEFT, 0.2), (Side.RIGHT, 0.5))
    ]
    assert choose(sides, None).side is Side.RIGHT
    assert choose(sides, Side.LEFT).side is Side.LEFT


def test_irregular_angles_are_taken_as_they_are() -> None:
    angles = (0.0, 8.8, 18.0, 29.6, 40.6, 51.7)
    assert rotation_step_deg(angles[:5]) == pytest.approx(10.0, abs=1.7)
    plan = plan_side(Side.LEFT, linear_curves(-49, -20), 1.0, 0, angles, frozenset({0}), 0.0, CONFIG)
    assert plan.view_index == 5


def test_a_cylinder_has_an_occluding_edge_on_both_sides_and_a_plane_none() -> None:
    shown = Cylinder()[0]
    assert edge_m(shown, Side.LEFT) == pytest.approx(0.2, rel=0.1)
    assert edge_m(shown, Side.RIGHT) == pytest.approx(0.2, rel=0.1)
    depth = plane()
    flat = frame(depth, box(0.08, depth))
    assert edge_m(flat, Side.LEFT) == edge_m(flat, Side.RIGHT) == 0.0


def test_a_hem_on_one_side_leaves_the_edge_on_the_other() -> None:
    shown = Cylinder(span_deg=(-180.0, 10.0))[0]
    assert edge_m(shown, Side.LEFT) > 0.15
    assert edge_m(shown, Side.RIGHT) == 0.0


def test_cloth_behind_a_nearer_layer_is_opened_by_the_turn_that_moves_the_layer_away() -> None:
    depth = plane()
    mask = box(0.08, depth)
    x, _ = rays()
    covering = (x * 0.85 > 0.03) & (x * 0.85 < 0.06)
    depth = np.where(covering, 0.80, depth)
    shown = frame(depth, mask & ~covering & (x < 0.04))
    # The layer lies to the right of the cloth; nearer than the axis, it goes right under a positive turn.
    assert edge_m(shown, Side.LEFT) == pytest.approx(0.16, rel=0.1)
    assert edge_m(shown, Side.RIGHT) == 0.0
