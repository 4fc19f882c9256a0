"""The synthetic depth sensor: noise, dropouts and edges as a D435 has them."""

import numpy as np

from flatcloth.synthesis.sensor import measure_depth


def noisy(depth_m: np.ndarray, seed: int = 0) -> np.ndarray:
    return measure_depth(depth_m.astype(np.float32), 425.0, np.random.default_rng(seed))


def test_the_noise_is_a_d435s() -> None:
    depth = np.zeros((220, 220))
    depth[20:200, 20:200] = 0.85
    measured = noisy(depth)
    inner = np.s_[40:180, 40:180]
    seen = measured[inner] > 0
    assert 0.98 < seen.mean() < 1.0  # a few dropouts
    error = np.where(seen, measured[inner] - 0.85, np.nan)
    assert 1.0e-3 < np.nanstd(error) < 3.0e-3

    def correlation(step: int) -> float:
        a, b = error[:, :-step].ravel(), error[:, step:].ravel()
        both = np.isfinite(a) & np.isfinite(b)
        return float(np.corrcoef(a[both], b[both])[0, 1])

    assert correlation(1) > 0.7
    assert 0.4 < correlation(2) < correlation(1)
    assert abs(correlation(10)) < 0.15
    outside = (depth == 0) & (measured > 0)
    assert outside[:, :16].sum() + outside[20:200, 200:204].sum() > 0
    assert not outside[:, 206:].any()
    assert (noisy(depth) == measured).all()
    assert (noisy(depth, seed=1) != measured).any()


def test_ramps_join_layers_that_are_near_and_not_those_far_apart() -> None:
    def between(step_m: float) -> float:
        depth = np.full((120, 120), 0.80)
        depth[:, 60:] += step_m
        row = noisy(depth)[10:110, 52:72]
        inside = (row > 0.80 + 0.2 * step_m) & (row < 0.80 + 0.8 * step_m)
        return float(inside.sum(axis=1).mean())

    assert 2 < between(0.04) < 9
    assert between(0.4) < 0.5


def test_near_layers_reach_over_far_ones() -> None:
    depth = np.full((120, 120), 0.80)
    depth[:, 60:] = 0.90
    reach = [np.flatnonzero((row > 0) & (row < 0.82)).max() for row in noisy(depth)[10:110]]
    assert 59.5 < np.mean(reach) < 62


def test_nothing_measured_where_nothing_is() -> None:
    assert not noisy(np.zeros((40, 40))).any()
