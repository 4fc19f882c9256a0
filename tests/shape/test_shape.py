"""The shape of views, from nothing: exact and noisy, and how it may be turned and taken apart."""

from dataclasses import replace

import numpy as np
import pytest
from made_up_sheets import off_m
from scenes import Cylinder, box, frame, placed_view, plane, rays

from flatcloth.core.config import FlatteningConfig
from flatcloth.core.errors import FlatclothError
from flatcloth.core.geometry import Rigid3, fit_rigid2, rotation_about
from flatcloth.shape.algorithm import as_decided, shape
from flatcloth.shape.joints import DecidedParts
from flatcloth.shape.observations import PlacedView
from flatcloth.shape.shape import Shape

INTERVAL_PX = FlatteningConfig().sampling_intervals_px[-1]
ANGLES = (-40.0, 0.0, 40.0)
CYLINDER = Cylinder(angles_deg=ANGLES, span_deg=(-90.0, 90.0))


def views_of(noise_m: float = 0.0) -> list[PlacedView]:
    random, made = np.random.default_rng(0), []
    for n in range(len(ANGLES)):
        seen = CYLINDER[n]
        noise = noise_m * random.standard_normal(seen.depth_m.shape)
        depth = np.where(seen.depth_m > 0, seen.depth_m + noise, 0.0).astype(np.float32)
        made.append(placed_view(replace(seen, depth_m=depth)))
    return made


@pytest.fixture(scope="module")
def exact() -> Shape:
    return shape(views_of(), INTERVAL_PX, 1)


@pytest.fixture(scope="module")
def noisy() -> Shape:
    return shape(views_of(noise_m=0.001), INTERVAL_PX, 1)


def test_exact_views_give_the_cloth_as_it_was_cut_and_upright(exact: Shape) -> None:
    assert exact.scale == 1.0
    assert exact.placed.mean() > 0.99
    true = CYLINDER.flat_uv_m(exact.nodes.xyz_m[exact.placed])
    assert off_m(exact.uv_m[exact.placed], true) < 0.002
    shift = exact.uv_m[exact.placed] - true
    assert np.ptp(shift, axis=0).max() < 0.004  # not turned


def test_noisy_views_give_it_to_a_few_millimetres_and_say_how_sure_that_is(
    exact: Shape, noisy: Shape
) -> None:
    found = noisy
    assert all(seen.is_noisy for seen in found.observations)
    own = found.placed
    assert own.mean() > 0.9
    true = CYLINDER.flat_uv_m(found.nodes.xyz_m[own])
    assert off_m(found.uv_m[own], true) < 0.010
    off = fit_rigid2(found.uv_m[own], true).apply(found.uv_m[own]) - true
    assert np.median(np.linalg.norm(off, axis=1)) < 0.003
    assert np.isfinite(found.std_m[own]).all()
    assert np.isnan(found.std_m[~own]).all()
    assert np.nanmedian(found.std_m) > np.nanmedian(exact.std_m)


def test_a_camera_that_stands_elsewhere_sees_the_same_cloth(exact: Shape) -> None:
    moved = Rigid3(rotation_about(np.array([0.48, 0.6, 0.64]), 0.9), np.array([0.3, -0.1, 0.2]))
    views = [replace(view, object_from_camera=moved @ view.object_from_camera) for view in views_of()]
    found = shape(views, INTERVAL_PX, 1)
    np.testing.assert_array_equal(found.piece, exact.piece)
    assert np.nanmax(np.abs(found.uv_m - exact.uv_m)) < 2e-4


def test_lengths_that_noise_took_of_ripples_are_given_back_to_places_and_pairs_alike() -> None:
    x, _ = rays()
    depth = plane() + 0.012 * np.sin(x * 0.85 / 0.008)  # 50 mm from crest to crest
    view = placed_view(frame(depth, box(0.09, depth)))
    plain, smoothed = (
        replace(view, surface=replace(view.surface, noisy=noisy, noise_m=0.0005)) for noisy in (False, True)
    )
    assert shape([plain], INTERVAL_PX, 0).scale == 1.0
    rippled = shape([smoothed], INTERVAL_PX, 0)
    assert 1.002 < rippled.scale < 1.1
    seen_m = rippled.observations[0].edge_length_m
    np.testing.assert_allclose(rippled.links.length_m, rippled.scale * seen_m)
    ends = rippled.uv_m[rippled.links.edges]
    lengths_m = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    assert np.nanmedian(lengths_m / rippled.links.length_m) == pytest.approx(1.0, abs=0.001)


def test_parts_are_taken_off_at_the_scale_of_the_whole(exact: Shape) -> None:
    around = CYLINDER.flat_uv_m(exact.nodes.xyz_m)[:, 0]
    off = around > 0.05
    found = as_decided(replace(exact, scale=1.02), DecidedParts([off]), 1)
    assert found.scale == 1.02
    assert set(found.piece[off & found.has_place]) == {1}
    assert set(found.piece[~off & found.has_place]) == {0}
    np.testing.assert_array_equal(found.links.length_m, exact.links.length_m)
    own = found.placed
    assert off_m(found.uv_m[own] / 1.02, exact.uv_m[own]) < 0.002


def test_views_without_cloth_make_no_shape() -> None:
    (view, *_) = views_of()
    usable = np.zeros_like(view.surface.usable)
    row, col = (size // 2 // INTERVAL_PX * INTERVAL_PX + INTERVAL_PX // 2 for size in usable.shape)
    usable[row, col] = True
    nothing = replace(view, surface=replace(view.surface, usable=usable))
    with pytest.raises(FlatclothError, match="No view shows two places of cloth side by side"):
        shape([nothing], INTERVAL_PX, 0)
    found = shape([nothing, *views_of()[1:]], INTERVAL_PX, 1)
    assert found.views == (1, 2)


def test_what_hangs_on_a_weak_joint_is_unsure_until_the_operator_keeps_it(noisy: Shape) -> None:
    found = noisy
    part = CYLINDER.flat_uv_m(found.nodes.xyz_m)[:, 0] > 0.03
    first, second = found.graph.pairs.T
    evidence = np.where(part[first] != part[second], 0.05, found.graph.evidence)
    weak = replace(found, graph=replace(found.graph, evidence=evidence))
    own = part & found.placed
    std_m = [np.median(as_decided(weak, DecidedParts(kept=kept), 1).std_m[own]) for kept in ([], [part])]
    assert std_m[0] > 10.0 * std_m[1]
    assert std_m[1] < 2.0 * np.median(found.std_m[own])
