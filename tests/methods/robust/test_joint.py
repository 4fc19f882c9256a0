"""The joint flattening of made-up sheets, whose flat places are known."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from made_up_sheets import STEP_M, STILL, grid, nodes_at, observed, shape_of

from flatcloth.core.geometry import Rigid3, fit_rigid2, rotation_about
from flatcloth.core.types import Float64
from flatcloth.methods.robust import joint
from flatcloth.methods.robust.compositing import floating_pieces
from flatcloth.methods.robust.joint import flatten_jointly, settled, taken_apart
from flatcloth.methods.robust.joint_shape import (
    JointShape,
    anchored,
    largest_piece,
    with_largest_piece,
    with_observation,
    with_poses,
)
from flatcloth.methods.robust.layout import _robust_weight, lay_pieces, relax_around
from flatcloth.methods.robust.observations import Observation, averaged

UV = grid(10, 24)
COLUMN = np.rint(UV[:, 0] / STEP_M).astype(int)


def off_m(found: Float64, true: Float64) -> float:
    """Largest distance from the true places, after the best rigid motion."""
    return float(np.linalg.norm(fit_rigid2(found, true).apply(found) - true, axis=1).max())


def test_a_new_view_is_laid_out_from_what_it_shares_and_the_plane_stays() -> None:
    first, second = COLUMN < 14, COLUMN >= 8
    shape = flatten_jointly(shape_of(UV, [observed(UV, first, 0), observed(UV, second, 1)], first))
    assert shape.placed.all()
    assert np.abs(shape.uv_m - UV).max() < 1e-4  # not only up to a motion: the anchor holds the plane
    assert shape.weight.min() > 0.9


def test_new_nodes_are_relaxed_and_all_far_from_them_keep_their_places_exactly() -> None:
    everything, new = np.ones(len(UV), dtype=bool), COLUMN >= 22
    shape = shape_of(UV, [observed(UV, everything, 0)], everything)
    bent = UV + 0.004 * np.sin(70.0 * UV)  # as far as the known nodes are concerned, it stays so
    bent[new] = UV[new] + np.random.default_rng(0).normal(0.0, 0.003, (new.sum(), 2))
    inside = np.arange(len(shape.links.edges))
    uv, _ = relax_around(bent @ np.array([1.0, 1j]), shape.links, inside, np.ones(len(inside)), new)
    np.testing.assert_array_equal(uv[COLUMN < 16], bent[COLUMN < 16])
    for at in (COLUMN == 22, COLUMN == 23):  # noise is gone: neighbours are where pairs put them
        apart_m = np.linalg.norm(np.diff(uv[at], axis=0), axis=1)
        assert np.abs(apart_m - STEP_M).max() < 0.001


def test_lengths_with_noise_average_out() -> None:
    random = np.random.default_rng(0)
    everything = np.ones(len(UV), dtype=bool)
    noisy = []
    for view in range(3):
        seen = observed(UV, everything, view)
        noise = 0.0003 * random.standard_normal(len(seen.edges))
        noisy.append(replace(seen, edge_length_m=seen.edge_length_m + noise))
    shape = flatten_jointly(shape_of(UV, noisy, everything))
    assert off_m(shape.uv_m, UV) < 0.0012


def test_pairs_that_contradict_the_others_lose_their_weight() -> None:
    everything = np.ones(len(UV), dtype=bool)
    good, bad = observed(UV, everything, 0), observed(UV, everything, 1)
    wrong = np.arange(len(bad.edges)) % 25 == 0
    bad = replace(bad, edge_length_m=np.where(wrong, bad.edge_length_m + 0.012, bad.edge_length_m))
    shape = flatten_jointly(shape_of(UV, [good, bad], everything))
    own = shape.weight[len(good.edges) :]
    assert own[wrong].max() < 0.05
    assert np.median(own[~wrong]) > 0.9
    assert off_m(shape.uv_m, UV) < 0.001


def test_the_robust_weight_is_a_quarter_at_its_scale() -> None:
    """Geman-McClure: w(x) = 1 / (1 + (x / c)^2)^2, with c = 3 where most residuals are small."""
    weight = _robust_weight(np.array([0.0, 0.0, 0.0, 3.0, 30.0]))
    np.testing.assert_allclose(weight, [1.0, 1.0, 1.0, 0.25, 1.0 / 101.0**2])
    # Where all residuals are large, the scale grows with them: 1.4826 times their median.
    assert _robust_weight(np.full(9, 10.0))[0] == pytest.approx(1.0 / (1.0 + (1.0 / 4.4478) ** 2) ** 2)


def test_a_piece_that_nothing_joins_floats_and_a_bridge_brings_it_down() -> None:
    left, right = COLUMN < 9, COLUMN >= 13
    views = [observed(UV, left, 0), observed(UV, right, 1)]
    apart = flatten_jointly(shape_of(UV, views, left))
    assert set(apart.piece[left]) == {0}
    assert set(apart.piece[right]) == {1}
    assert np.isnan(apart.uv_m[right]).all()
    (floating,) = floating_pieces(apart)
    assert off_m(floating[right], UV[right]) < 1e-4
    bridge = observed(UV, (COLUMN >= 5) & (COLUMN < 17), 2)
    joined = flatten_jointly(with_view(apart, bridge))
    assert set(joined.piece) == {0}
    assert np.abs(joined.uv_m - UV).max() < 2e-4


def test_a_floating_piece_of_which_one_place_is_known_is_laid_out_whole() -> None:
    left, right = COLUMN < 9, COLUMN >= 13
    views = [observed(UV, left, 0), observed(UV, right, 1)]
    shape = shape_of(UV, views, left)
    shape.all_uv_m[np.flatnonzero(right)[0]] = UV[right][0]
    found = flatten_jointly(shape)
    assert set(found.piece[right]) == {1}
    assert off_m(found.all_uv_m[right], UV[right]) < 1e-4


def test_cloth_to_which_only_single_nodes_lead_floats_as_a_piece_of_its_own() -> None:
    """Views that share one node each join two halves, but leave the angle between them open."""
    left, right = COLUMN < 9, COLUMN >= 11
    rows = np.rint(UV[:, 1] / STEP_M).astype(int)
    views = [observed(UV, left, 0), observed(UV, right, 1)]
    for n in range(3):  # from one node at the rim of the left half over the gap, in three views
        chain = (COLUMN >= 8) & (COLUMN <= 11) & (rows == 3 * n)
        views.append(observed(UV, chain, 2 + n, evidence=5.0))
    shape = flatten_jointly(shape_of(UV, views, left))
    assert set(shape.piece[left]) == {0}
    assert set(shape.piece[right]) == {1}
    assert off_m(shape.uv_m[left], UV[left]) < 1e-4
    assert off_m(shape.all_uv_m[right], UV[right]) < 1e-4


def test_a_floating_piece_takes_over_when_it_is_clearly_larger() -> None:
    small, large = COLUMN < 6, COLUMN >= 9
    views = [observed(UV, small, 0), observed(UV, large, 1)]
    shape = flatten_jointly(shape_of(UV, views, small))
    assert set(shape.piece[large]) == {0}
    assert set(shape.piece[small]) == {1}
    similar = (COLUMN >= 9) & (COLUMN < 16)  # 70 nodes beside 60
    shape = flatten_jointly(shape_of(UV, [views[0], observed(UV, similar, 1)], small))
    assert set(shape.piece[small]) == {0}
    # At the end the larger one is the shape, in the middle of the plane, and stays it from there on.
    assert largest_piece(shape) == 1
    ended = with_largest_piece(shape)
    assert set(ended.piece[similar]) == {0}
    assert set(ended.piece[small]) == {1}
    assert off_m(ended.uv_m[similar], UV[similar]) < 1e-4
    assert off_m(ended.all_uv_m[small], UV[small]) < 1e-4
    np.testing.assert_allclose(ended.uv_m[similar].mean(axis=0), 0.0, atol=1e-12)
    apart = np.linalg.norm(ended.all_uv_m[small].mean(axis=0) - ended.uv_m[similar].mean(axis=0))
    assert apart > 5.0
    on = flatten_jointly(ended)
    np.testing.assert_allclose(on.uv_m[similar], ended.uv_m[similar], atol=1e-6)
    assert with_largest_piece(on) is on


def test_unreliable_parts_of_the_main_piece_float_as_connected_pieces() -> None:
    everything = np.ones(len(UV), dtype=bool)
    shape = flatten_jointly(shape_of(UV, [observed(UV, everything, 0)], everything))
    pieces = floating_pieces(shape, (COLUMN < 4) | (COLUMN > 16))
    assert [int(np.isfinite(p[:, 0]).sum()) for p in pieces] == [70, 40]


def test_a_part_that_is_taken_off_floats_as_it_is_and_what_little_joins_belongs_to_neither() -> None:
    """A false view draws both parts together at one of their ends; its nodes between them are on no side."""
    left, right = COLUMN < 12, COLUMN >= 13
    false = observed(UV, (COLUMN >= 11) & (COLUMN < 14), 2, evidence=0.1)
    on = COLUMN[false.node[false.edges]]
    row = np.rint(UV[false.node[false.edges[:, 0]], 1] / STEP_M)
    shorter = 1.0 - 0.05 * row * (on.min(axis=1) == 12) * (on.max(axis=1) == 13)
    false = replace(false, edge_length_m=false.edge_length_m * shorter)
    shape = flatten_jointly(shape_of(UV, [observed(UV, left, 0), observed(UV, right, 1), false], left))
    assert set(shape.piece) == {0}
    apart = taken_apart(shape, [right])
    assert set(apart.piece[left]) == {0}
    assert set(apart.piece[right]) == {1}
    assert set(apart.piece[COLUMN == 12]) == {-1}
    assert np.isnan(apart.all_uv_m[COLUMN == 12]).all()
    for own in (left, right):
        assert off_m(apart.all_uv_m[own], UV[own]) < 1e-4
    assert off_m(shape.all_uv_m, UV) > 1e-3


def test_without_a_part_the_rest_is_laid_out_anew_but_for_what_the_operator_placed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What a false link has bent would stay so: the right pairs have lost their weight to it."""
    left, right = COLUMN < 18, COLUMN >= 18
    shape = flatten_jointly(shape_of(UV, [observed(UV, np.ones(len(UV), dtype=bool), 0)], left))
    bent = replace(shape, weight=np.full(len(shape.links.edges), 0.1))
    begun: list[JointShape] = []

    def watched(shape: JointShape, **options: Any) -> JointShape:
        begun.append(shape)
        return flatten_jointly(shape, **options)

    monkeypatch.setattr("flatcloth.methods.robust.joint.flatten_jointly", watched)
    for by_hand in (False, True):
        begun.clear()
        apart = taken_apart(replace(bent, by_hand=right & by_hand), [right])
        assert set(apart.piece[left]) == {0}
        assert set(apart.piece[right]) == {1}
        first, used = begun[0], ~begun[0].is_cut
        assert used.any()
        assert not first.weight[~used].any()
        assert (first.weight[used] == (0.1 if by_hand else 1.0)).all()
        assert first.has_place.all() if by_hand else not first.has_place.any()


@pytest.mark.parametrize(
    ("sensor", "evidence", "shown"), [(1.0, 0.02, False), (1.0, 0.2, True), (0.1, 0.02, True)]
)
def test_a_node_that_hardly_anything_joins_has_no_place_when_the_shape_settles(
    sensor: float, evidence: float, shown: bool
) -> None:
    """What is little depends on the sensor: a worse one gives less everywhere. No piece floats empty."""
    known, rim, beyond = COLUMN < 18, (COLUMN >= 17) & (COLUMN < 19), COLUMN >= 20
    views = [
        observed(UV, known, 0, evidence=sensor),
        observed(UV, rim, 1, evidence=evidence),
        observed(UV, beyond, 2, evidence=evidence),
    ]
    shape = settled(flatten_jointly(shape_of(UV, views, known)))
    assert shape.placed[known].all()
    assert (shape.placed[COLUMN == 18] == shown).all()
    assert len(floating_pieces(shape)) == shown


def with_view(shape: JointShape, seen: Observation) -> JointShape:
    """The shape with one more observation of its nodes, not relaxed yet."""
    none = np.zeros(len(seen.edges), dtype=bool)
    by_hand = np.zeros(len(seen.node), dtype=bool)
    return with_observation(shape, shape.nodes, seen, STILL, is_cut=none, by_hand=by_hand)


def test_a_view_that_adds_little_moves_what_is_near_and_the_rest_when_it_settles() -> None:
    known = COLUMN < 21
    whole = flatten_jointly(shape_of(UV, [observed(UV, known, n) for n in range(3)], known))
    assert whole.settled_pairs == len(whole.links.edges)
    # What is far from the new nodes is not where its pairs want it: left so now, mended when it settles.
    off = np.where((COLUMN == 3)[:, None], (0.0, 0.0008), 0.0)
    added = flatten_jointly(
        with_view(replace(whole, all_uv_m=whole.all_uv_m + off), observed(UV, COLUMN >= 18, 3))
    )
    assert added.settled_pairs == whole.settled_pairs
    assert added.placed.all()
    far = COLUMN < 12
    motion = fit_rigid2(added.all_uv_m[far], (whole.all_uv_m + off)[far])
    np.testing.assert_allclose(motion.apply(added.all_uv_m[far]), (whole.all_uv_m + off)[far], atol=1e-9)
    near = COLUMN >= 18
    assert off_m(added.uv_m[near], UV[near]) < 1e-4
    assert off_m(added.uv_m, UV) > 5e-4
    assert off_m(settled(added).uv_m, UV) < 1e-4


def test_a_view_that_contradicts_the_places_moves_everything() -> None:
    known = COLUMN < 21
    torn = UV + np.where((COLUMN >= 14)[:, None], (0.003, 0.0), 0.0)
    shape = shape_of(UV, [observed(UV, known, n) for n in range(3)], known)
    wrong = replace(
        shape, all_uv_m=np.where(known[:, None], torn, np.nan), settled_pairs=len(shape.links.edges)
    )
    assert off_m(flatten_jointly(with_view(wrong, observed(UV, COLUMN >= 10, 3))).uv_m, UV) < 1e-4


def test_nodes_follow_their_views_in_space_but_not_on_the_plane() -> None:
    everything = np.ones(len(UV), dtype=bool)
    seen = replace(observed(UV, everything, 0), is_new=everything)
    shape = replace(shape_of(UV, [seen], everything), nodes=nodes_at(UV))
    turned = Rigid3(rotation_about(np.array([0.0, 1.0, 0.0]), 0.2), np.array([0.0, 0.0, 0.01]))
    moved = with_poses(shape, (turned,))
    np.testing.assert_allclose(moved.nodes.xyz_m, turned.apply(seen.points_m), atol=1e-12)
    np.testing.assert_array_equal(moved.all_uv_m, shape.all_uv_m)
    assert with_poses(shape, shape.object_from_camera) is shape


def test_frontal_views_count_most_in_the_mean_of_a_node() -> None:
    """Weights are the squared cosine of the incidence: at 60 degrees a quarter of a frontal view's."""
    everything = np.ones(len(UV), dtype=bool)
    nodes = averaged(nodes_at(UV), observed(UV, ~everything, 0), STILL)
    shifted = Rigid3(np.eye(3), np.array([0.0, 0.0, 0.005]))
    steep = observed(UV, everything, 1, incidence_deg=60.0)
    after = averaged(nodes, steep, shifted)
    np.testing.assert_allclose(
        after.xyz_m - nodes.xyz_m, np.tile([0.0, 0.0, 0.001], (len(UV), 1)), atol=1e-12
    )
    np.testing.assert_allclose(after.weight, 1.25)


def test_a_piece_that_outgrows_the_main_one_comes_to_the_middle_of_the_plane() -> None:
    uv = grid(6, 10)
    former = np.arange(len(uv)) < 18
    laid = uv + np.where(former, 0.0, 10.0)[:, None]
    shape = shape_of(uv, [observed(uv, former, 0), observed(uv, ~former, 1)], former)
    outgrown = replace(shape, piece=former.astype(np.int32), all_uv_m=laid)
    moved = anchored(outgrown)
    np.testing.assert_allclose(moved.uv_m[~former].mean(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.diff(moved.uv_m[~former], axis=0), np.diff(uv[~former], axis=0), atol=1e-12)
    np.testing.assert_allclose(moved.all_uv_m[former], uv[former])
    # It is fixed there: anchored again, it stays.
    assert moved.placed[moved.anchor].all()
    np.testing.assert_allclose(anchored(moved).uv_m[~former], moved.uv_m[~former], atol=1e-12)


def test_a_piece_that_is_joined_keeps_its_layout() -> None:
    seen = observed(UV, np.ones(len(UV), dtype=bool), 0)
    shape = shape_of(UV, [seen], COLUMN < 12)
    true = UV @ np.array([1.0, 1j])
    waved = true + 0.002 * np.sin(40.0 * true.real)  # what a piece knows, and new pairs do not say
    laid = np.where(COLUMN < 12, np.nan, waved * np.exp(0.7j) + (10.0 - 3.0j))
    z = np.where(COLUMN < 12, true, np.nan + 0.0j)
    piece = np.where(COLUMN < 12, -1, 1).astype(np.int32)
    found = lay_pieces(z, shape.links, np.arange(len(seen.edges)), laid, piece)
    own = COLUMN >= 12
    np.testing.assert_allclose(
        np.abs(found[own][:, None] - found[own]), np.abs(laid[own][:, None] - laid[own]), atol=1e-12
    )
    assert np.abs(found - true).max() < 0.006
    np.testing.assert_array_equal(found[~own], z[~own])


def test_a_piece_that_no_pair_leads_to_stays_without_a_place() -> None:
    left, right = COLUMN < 12, COLUMN >= 12
    shape = shape_of(UV, [observed(UV, left, 0), observed(UV, right, 1)], left)
    true = UV @ np.array([1.0, 1j])
    z, laid = np.where(left, true, np.nan), np.where(right, true, np.nan)
    inside = np.arange(len(shape.links.edges))
    found = lay_pieces(z, shape.links, inside, laid, np.where(right, 1, -1).astype(np.int32))
    assert np.isnan(found[right]).all()


def test_cloth_that_finds_no_place_on_the_piece_it_is_joined_to_floats_as_it_lay(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    left, right = COLUMN < 14, COLUMN >= 16
    apart = flatten_jointly(shape_of(UV, [observed(UV, left, 0), observed(UV, right, 1)], left))
    assert set(apart.piece[right]) == {1}
    # A bridge joins both; laying out stops at it, as it does where joined cloth fits nowhere.
    monkeypatch.setattr(joint, "_with_joined_pieces", lambda z, *_: z)
    monkeypatch.setattr(joint, "lay_out", lambda z, *_: z)
    both = flatten_jointly(with_view(apart, observed(UV, (COLUMN > 10) & (COLUMN < 20), 2)))
    assert (both.piece[left] == 0).all()
    assert set(both.piece[right]) == {1}
    assert off_m(both.all_uv_m[right], UV[right]) < 1e-4
