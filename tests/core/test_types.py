"""The rigid motions of the plane, and the grid of a flattened view."""

import math

import numpy as np
import pytest
from garment_evidence import blank_view
from hypothesis import given
from hypothesis import strategies as st

from flatcloth.core.types import FlattenedView, Rigid2, wrap_rad

# Near the identity and far from it: both have failed in other libraries.
ANGLES = st.floats(-math.pi, math.pi) | st.floats(-1e-9, 1e-9) | st.sampled_from([math.pi, -math.pi, 0.0])
LENGTHS = st.floats(-3, 3) | st.floats(-1e-9, 1e-9)
MOTIONS = st.builds(Rigid2, ANGLES, LENGTHS, LENGTHS)
POINTS = st.tuples(LENGTHS, LENGTHS).map(np.array)


def assert_same(a: Rigid2, b: Rigid2) -> None:
    assert wrap_rad(a.theta_rad - b.theta_rad) == pytest.approx(0, abs=1e-12)
    assert (a.u_m, a.v_m) == pytest.approx((b.u_m, b.v_m), abs=1e-12)


@given(MOTIONS, MOTIONS, POINTS)
def test_composing_is_applying_one_after_the_other(a: Rigid2, b: Rigid2, p: np.ndarray) -> None:
    np.testing.assert_allclose((a @ b).apply(p), a.apply(b.apply(p)), atol=1e-12)


@given(MOTIONS)
def test_the_inverse_undoes_from_both_sides(a: Rigid2) -> None:
    assert_same(a @ a.inverse(), Rigid2())
    assert_same(a.inverse() @ a, Rigid2())
    assert_same(a.inverse().inverse(), a)


@given(ANGLES, POINTS)
def test_a_turn_about_a_center_leaves_the_center_and_then_shifts(angle: float, center: np.ndarray) -> None:
    np.testing.assert_allclose(Rigid2(angle).about(center).apply(center), center, atol=1e-12)
    shifted = Rigid2(angle, 0.1, -0.2).about(center).apply(center)
    np.testing.assert_allclose(shifted, center + np.array([0.1, -0.2]), atol=1e-12)


@given(st.floats(-1e4, 1e4))
def test_wrapping_keeps_the_direction_and_the_range(angle: float) -> None:
    wrapped = wrap_rad(angle)
    assert -math.pi < wrapped <= math.pi
    assert math.cos(wrapped) == pytest.approx(math.cos(angle), abs=1e-9)
    assert math.sin(wrapped) == pytest.approx(math.sin(angle), abs=1e-9)


def grid(rows: int = 4, cols: int = 6) -> FlattenedView:
    valid = np.zeros((rows, cols), dtype=bool)
    valid[1, 2:5] = True
    return blank_view(valid, origin_uv_m=(-0.5, 0.25))


def test_pixel_centres_lie_on_the_plane_by_origin_and_pixel_size() -> None:
    view = grid()
    assert view.shape == (4, 6)
    assert view.area_m2 == pytest.approx(3 * 4e-6)
    np.testing.assert_allclose(view.uv_from_rc(np.array([0, 0])), [-0.5, 0.25])
    np.testing.assert_allclose(view.uv_from_rc(np.array([3, 5])), [-0.49, 0.256])
