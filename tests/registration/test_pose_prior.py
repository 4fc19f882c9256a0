"""The prior of a recording's errors, and derivatives against differences."""

import numpy as np
import pytest
from scenes import AXIS

from flatcloth.core.geometry import Rigid3, object_from_camera
from flatcloth.flattening.surface import EXTENT_M
from flatcloth.registration.pairwise import _weighed
from flatcloth.registration.pose_prior import (
    PosePrior,
    across,
    at_center,
    chances,
    grades,
    jacobians_of,
    motion,
    moved_axis,
    pair_covariance,
    poses,
    twists_between,
    variances,
)
from flatcloth.registration.view_features import TERMS, Agreement

HELD_M = np.array([0.02, -0.3, 0.85])
ANGLE_DEG = 40.0
STILL = Rigid3(np.eye(3), np.zeros(3))


def arrays(moved: list[Rigid3]) -> tuple[np.ndarray, np.ndarray]:
    return np.stack([m.rotation for m in moved]), np.stack([m.translation_m for m in moved])


def twist_by(common: np.ndarray, own: np.ndarray, center_m: np.ndarray) -> np.ndarray:
    """The change of a view's pose by the unknowns, as a twist."""
    (changed,) = poses(AXIS, HELD_M, [ANGLE_DEG], common, own[None])
    known = object_from_camera(AXIS, ANGLE_DEG)
    (twist,) = twists_between(arrays([changed @ known.inverse()]), arrays([STILL]), center_m[None])
    return twist


@pytest.mark.parametrize("column", range(7))
def test_the_jacobian_is_the_derivative_of_the_poses(column: int) -> None:
    step, center = 1e-6, np.array([0.05, -0.1, 0.8])
    common, own = np.zeros(5), np.zeros(3)
    (own if column < 3 else common)[column if column < 3 else column - 3] = step
    found = at_center(jacobians_of(AXIS, HELD_M, [ANGLE_DEG]), center)[0, :, column]
    np.testing.assert_allclose(twist_by(common, own, center) / step, found, atol=1e-5)


def test_twists_of_many_pairs_are_those_of_each() -> None:
    random = np.random.default_rng(0)
    centers = random.normal(size=(4, 3))
    ones, others = ([motion(t, np.zeros(3)) for t in 0.2 * random.normal(size=(4, 6))] for _ in range(2))

    found = twists_between(arrays(ones), arrays(others), centers)
    for one, other, center, twist in zip(ones, others, centers, found, strict=True):
        apart, by = other.inverse() @ one, motion(twist, center)
        np.testing.assert_allclose(by.rotation, apart.rotation, atol=1e-12)
        np.testing.assert_allclose(by.translation_m, apart.translation_m, atol=1e-12)


def test_the_axis_moves_sideways_and_tilts_as_the_unknowns_say() -> None:
    side, front = across(AXIS)
    moved = moved_axis(AXIS, np.array([0.01, -0.02, 0.1, 0.2, 0.0]))
    np.testing.assert_allclose(moved.point_m - AXIS.point_m, 0.01 * side - 0.02 * front)
    assert moved.direction @ side / (moved.direction @ AXIS.direction) == pytest.approx(0.1)
    assert moved.direction @ front / (moved.direction @ AXIS.direction) == pytest.approx(0.2)
    np.testing.assert_allclose(np.cross(AXIS.direction, side), front, atol=1e-12)


def test_exact_recordings_are_as_probable_as_all_others_together() -> None:
    prior = PosePrior()
    chance, grid = chances(prior), grades(prior)
    assert chance.sum() == pytest.approx(1.0)
    assert chance[0] == 0.5
    assert (grid[0] <= grid).all()
    assert (grid[-1] >= grid).all()
    one = PosePrior(turn_stds_deg=(1.0,), axis_stds_m=(0.001,), swing_stds_deg=(0.1,))
    assert chances(one).tolist() == [1.0]


def test_variances_are_the_squares_of_a_grade_for_each_view() -> None:
    prior = PosePrior()
    found = variances(2, np.array([0.1, 0.02, 0.3]), prior)
    tilt = (0.02 / EXTENT_M) ** 2
    np.testing.assert_allclose(found, [4e-4, 4e-4, tilt, tilt, 1.0, *(0.01, 0.09, 0.09) * 2])


def test_a_pair_moves_as_far_as_its_own_errors_and_those_of_the_axis_allow() -> None:
    prior = PosePrior()
    one, other = at_center(jacobians_of(AXIS, HELD_M, (0.0, 40.0)), HELD_M)
    covariance = pair_covariance(one, other, prior)
    np.testing.assert_allclose(covariance, covariance.T, atol=1e-15)
    assert np.linalg.eigvalsh(covariance)[0] > 0
    # About the axis both views turn by their own errors.
    turn = np.radians(prior.turn_stds_deg[-1]) ** 2 * 2 + np.radians(prior.swing_stds_deg[0]) ** 2
    assert AXIS.direction @ covariance[:3, :3] @ AXIS.direction == pytest.approx(turn, rel=0.01)


def test_texture_that_agrees_by_half_has_a_quarter_of_the_curvature() -> None:
    def weighed(likeness: float) -> np.ndarray:
        curvature = np.zeros((TERMS, 7, 7))
        curvature[1] = np.eye(7)
        agreement = Agreement(
            matrix=curvature,
            gradient=np.zeros((TERMS, 7)),
            scores=np.zeros((TERMS, 40, 7)),
            spread=np.zeros(TERMS),
            likeness=np.full(TERMS - 1, likeness),
            count=40,
            parts=np.ones(40),
            inner=40,
            inertia=1e20 * np.eye(6),  # the motion of systematic errors is none
            tally=np.zeros(3),
        )
        return np.asarray(_weighed(agreement, np.array([0.0, 0.1, 0.0, 0.0]), 1e-3)[0])

    np.testing.assert_allclose(weighed(0.5), 0.25 * weighed(1.0), atol=1e-9)
    assert weighed(1.0)[6, 6] > 10.0
