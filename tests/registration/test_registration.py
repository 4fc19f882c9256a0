import itertools
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from scenes import Cylinder

from flatcloth.engine.integration import Integration
from flatcloth.methods.robust.method import RobustMethod
from flatcloth.registration import cameras
from flatcloth.registration.adjustment import solved
from flatcloth.registration.cameras import Fits, register
from flatcloth.registration.pose_prior import COMMON, OWN, grades
from flatcloth.registration.registered import Registered
from flatcloth.registration.view_features import ViewFeatures, extract_features

ANGLES = (0.0, 20.0, 340.0)


def features_of_views(made: Integration, views: tuple[int, ...]) -> list[ViewFeatures]:
    return [extract_features(made.views.flattening(view).surface) for view in views]


def registered(made: Integration, views: tuple[int, ...] = (0, 1, 2)) -> Registered:
    return register(features_of_views(made, views), made.axis, made.views.held_point_m)


@pytest.fixture(scope="module")
def exact() -> Integration:
    return Integration(Cylinder(angles_deg=ANGLES, span_deg=(-80.0, 80.0)))


def test_views_that_are_confirmed_stand_as_recorded_to_the_last_bit(exact):
    robust, found = exact.algorithm, registered(exact)
    assert isinstance(robust, RobustMethod)
    for pose, known in zip(robust.seen.poses((0, 1, 2)), found.known, strict=True):
        np.testing.assert_array_equal(pose.translation_m, known.translation_m)


def test_views_of_the_other_side_stand_as_recorded_and_as_sure_as_this_side_confirmed(exact):
    found = registered(exact)
    features = features_of_views(exact, (0, 2))
    other = register(features, exact.axis, exact.views.held_point_m, confirmed=found)
    assert (other.error_stds, other.fattening_px, other.pairs) == (found.error_stds, found.fattening_px, ())
    for pose, known in zip(other.known, (found.known[0], found.known[2]), strict=True):
        np.testing.assert_array_equal(pose.translation_m, known.translation_m)
    assert not other.own.any()
    assert other.view_indices == (0, 2)
    assert np.isfinite(other.stds).all()


def test_two_views_are_compared_about_the_middle_between_what_they_show(exact):
    found = registered(exact)
    assert found.pairs
    for pair in found.pairs:
        middles = [found.known[n].apply(found.features[n].middle_m) for n in (pair.first, pair.second)]
        assert np.linalg.norm(middles[0] - middles[1]) > 0.01
        np.testing.assert_allclose(pair.center_m, np.mean(middles, axis=0))


def _bytes(found: Registered) -> list[bytes]:
    poses = [(pose.rotation.tobytes(), pose.translation_m.tobytes()) for pose in found.object_from_camera]
    return [*itertools.chain(*poses), found.posterior.tobytes(), found.common.tobytes(), found.stds.tobytes()]


@pytest.mark.parametrize("order", list(itertools.permutations(range(3))))
def test_views_added_in_any_order_are_registered_alike(exact, order):
    fits: Fits = {}
    features = features_of_views(exact, (0, 1, 2))
    for count in range(1, 4):
        seen = [features[view] for view in sorted(order[:count])]
        found = register(seen, exact.axis, exact.views.held_point_m, fits)
    assert _bytes(found) == _bytes(registered(exact))
    assert found.view_indices == (0, 1, 2)


def test_a_view_is_compared_with_the_nearest_on_either_side_and_one_further_away(exact, monkeypatch):
    (one,) = features_of_views(exact, (0,))
    monkeypatch.setattr(cameras, "fit_pair", lambda *_: None)

    def compared(*angles_deg: float) -> set[tuple[int, int]]:
        fits: Fits = {}
        views = [replace(one, view_index=n, angle_deg=angle) for n, angle in enumerate(angles_deg)]
        register(views, exact.axis, exact.views.held_point_m, fits)
        return {pair for pair, _ in fits}

    around = compared(*np.arange(0.0, 360.0, 10.0).tolist())
    assert {(n - m) % 36 for n, m in around} == {1, 3, 33, 35}
    assert len(around) == 72
    assert compared(0.0, 30.0, 60.0) == {(1, 0), (2, 0), (2, 1)}
    assert compared(0.0, 0.0, 120.0) == {(1, 0)}
    assert compared(0.0) == set()


def test_a_pair_is_compared_once(exact, monkeypatch):
    fits: Fits = {}
    first, second, third = features_of_views(exact, (0, 1, 2))
    register([first, second, third], exact.axis, exact.views.held_point_m, fits)
    monkeypatch.setattr(cameras, "fit_pair", lambda *_: pytest.fail("a pair is compared again"))
    register([first, third], exact.axis, exact.views.held_point_m, fits)
    register([first, second, third], exact.axis, exact.views.held_point_m, fits)


def test_many_views_need_the_memory_of_a_few_matrices_not_of_one_for_each_grade(exact):
    few = registered(exact)
    n = 200
    many = replace(
        few,
        features=few.features[:1] * n,
        known=few.known[:1] * n,
        jacobians=np.repeat(few.jacobians[:1], n, axis=0),
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
