from __future__ import annotations

import tracemalloc
from dataclasses import replace
from functools import reduce

import numpy as np
import pytest
from scenes import Cylinder

from flatcloth.engine.integration import Integration
from flatcloth.methods.robust.method import RobustMethod
from flatcloth.registration.adjustment import solved
from flatcloth.registration.cameras import (
    begin_registration,
    confirmed_by,
    extend_registration,
    with_confirmed,
)
from flatcloth.registration.pose_prior import COMMON, OWN, grades
from flatcloth.registration.registered import Registered
from flatcloth.registration.view_features import ViewFeatures, extract_features

ANGLES = (0.0, 20.0, 340.0)


def features_of_views(made: Integration, views: tuple[int, ...]) -> list[ViewFeatures]:
    return [extract_features(made.views.flattening(view).surface) for view in views]


def registered(made: Integration, views: tuple[int, ...] = (0, 1, 2)) -> Registered:
    start = begin_registration(made.axis, made.views.held_point_m)
    return reduce(extend_registration, features_of_views(made, views), start)


@pytest.fixture(scope="module")
def exact() -> Integration:
    return Integration(Cylinder(angles_deg=ANGLES, span_deg=(-80.0, 80.0)))


def test_views_whose_rotation_is_right_stay_where_they_are(exact: Integration) -> None:
    found = registered(exact)
    for pose, known in zip(found.object_from_camera, found.known, strict=True):
        np.testing.assert_allclose(pose.rotation, known.rotation, atol=2e-3)
        np.testing.assert_allclose(pose.translation_m, known.translation_m, atol=2e-3)
    robust = exact.algorithm
    assert isinstance(robust, RobustMethod)
    for pose, known in zip(robust.seen.poses((0, 1, 2)), found.known, strict=True):
        np.testing.assert_array_equal(pose.translation_m, known.translation_m)


def test_each_view_says_what_was_changed_and_how_sure_that_is(exact: Integration) -> None:
    views = registered(exact).views
    assert [v.view_index for v in views] == [0, 1, 2]
    for view in views[1:]:
        assert abs(view.turned_deg) < 0.5
        assert view.moved_m < 0.002
        assert (view.std_m > 0).all()
        assert (view.std_deg > 0).all()


def test_views_of_the_other_side_stand_as_recorded_and_as_sure_as_this_side_confirmed(
    exact: Integration,
) -> None:
    found = registered(exact)
    other = reduce(with_confirmed, features_of_views(exact, (2, 0)), confirmed_by(found))
    assert (other.error_stds, other.fattening_px, other.pairs) == (found.error_stds, found.fattening_px, ())
    for pose, known in zip(other.known, (found.known[2], found.known[0]), strict=True):
        np.testing.assert_array_equal(pose.translation_m, known.translation_m)
    assert not other.own.any()
    assert [view.view_index for view in other.views] == [2, 0]  # with deviations


def test_a_view_with_nothing_in_common_stays_and_says_so(exact: Integration) -> None:
    made = Integration(Cylinder(angles_deg=(0.0, 120.0), span_deg=(-150.0, 60.0)))
    found = registered(made, (0, 1))
    assert found.pairs == ()
    assert found.views[1].moved_m < 1e-4


def test_registering_in_steps_is_registering_at_once(exact: Integration) -> None:
    robust = exact.algorithm
    assert isinstance(robust, RobustMethod)
    stepwise = robust.seen.registered((0, 1, 2))
    once = registered(exact)
    for a, b in zip(stepwise.object_from_camera, once.object_from_camera, strict=True):
        np.testing.assert_array_equal(a.rotation, b.rotation)
        np.testing.assert_array_equal(a.translation_m, b.translation_m)


def test_many_views_need_the_memory_of_a_few_matrices_not_of_one_for_each_grade(exact: Integration) -> None:
    few = registered(exact)
    n = 200
    many = replace(
        few,
        features=few.features[:1] * n,
        known=few.known[:1] * n,
        jacobians=few.jacobians[:1] * n,
        pairs=(),
        own=np.zeros((n, OWN)),
    )
    tracemalloc.start()
    try:
        found = solved(many)
        assert found.covariance.shape == (COMMON + OWN * n,) * 2
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert len(grades(many.prior)) > 20
    assert peak < 12 * found.covariance.nbytes


def test_two_views_are_compared_about_the_middle_between_what_they_show(exact: Integration) -> None:
    found = registered(exact)
    assert found.pairs
    for pair in found.pairs:
        middles = [found.known[n].apply(found.features[n].middle_m) for n in (pair.first, pair.second)]
        assert np.linalg.norm(middles[0] - middles[1]) > 0.01
        np.testing.assert_allclose(pair.center_m, np.mean(middles, axis=0))


def test_without_pairs_nothing_is_surprising(exact: Integration) -> None:
    assert registered(exact, (0,)).surprises.shape == (0,)
