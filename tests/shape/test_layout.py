"""The layout of graphs of frames: exact sheets come back from nothing, false links do not."""

from dataclasses import replace

import numpy as np
import pytest
from made_up_sheets import (
    STEP_M,
    STILL,
    Bent,
    exact_graph,
    grid,
    neighbours,
    nodes_at,
    observed,
    off_m,
    on_cone,
    on_cylinder,
    on_plane,
    places_of,
)

from flatcloth.core.geometry import Rigid3, rotation_about
from flatcloth.core.types import Bool, Complex128, Float64
from flatcloth.shape.algorithm import LaidOut, laid_out
from flatcloth.shape.graph import Graph, graph_of

UV = grid(10, 24)
COLUMN = np.rint(UV[:, 0] / STEP_M).astype(int)
AXIS = np.array([0.48, 0.6, 0.64])


def laid(graph: Graph) -> LaidOut:
    return laid_out(graph, np.ones(len(graph.pairs), dtype=bool))


def any_frames(n: int, seed: int = 0) -> Complex128:
    turned: Complex128 = np.exp(1j * np.random.default_rng(seed).uniform(-np.pi, np.pi, n))
    return turned


def plates(neck: int, gap: int) -> tuple[Float64, np.ndarray]:
    """Two plates of 12 x 12 nodes, joined by a strip of ``neck`` by ``gap``; which part each node is of."""
    right = grid(12, 12, ((12 + gap) * STEP_M, 0.0))
    parts = grid(12, 12), right, grid(neck, gap, (12 * STEP_M, 5 * STEP_M))
    return np.concatenate(parts), np.repeat([0, 1, 2], [len(part) for part in parts])


def with_links(graph: Graph, ends: np.ndarray, way: Complex128) -> tuple[Graph, Bool]:
    """Return a graph with more pairs (K, 2), the second end at ``way`` (K, 2) of each; which these are."""
    fresh = np.sort(ends, axis=1)
    pairs = np.concatenate([graph.pairs, fresh])
    order = np.lexsort((pairs[:, 1], pairs[:, 0]))
    count = len(ends)
    more = replace(
        graph,
        pairs=pairs[order].astype(np.int32),
        length_m=np.append(graph.length_m, np.abs(way).mean(axis=1))[order],
        offset_m=np.concatenate([graph.offset_m, way])[order],
        variance_m2=np.append(graph.variance_m2, np.full(count, graph.variance_m2[0]))[order],
        evidence=np.append(graph.evidence, np.full(count, graph.evidence[0]))[order],
        views=np.append(graph.views, np.ones(count, dtype=np.int64))[order],
    )
    return more, order >= len(graph.pairs)


def false_links(
    count: int, one: np.ndarray, other: np.ndarray, uv: Float64, seed: int
) -> tuple[np.ndarray, Complex128]:
    """Pairs of places far apart on the sheet, each seen as neighbours in any direction."""
    random = np.random.default_rng(seed)
    ends = np.stack([random.choice(one, 5 * count), random.choice(other, 5 * count)], axis=1)
    far = np.linalg.norm(uv[ends[:, 0]] - uv[ends[:, 1]], axis=1) > 0.04
    ends = np.unique(np.sort(ends[far], axis=1), axis=0)
    ends = random.permutation(ends)[:count]
    assert len(ends) == count
    return ends, STEP_M * np.exp(1j * random.uniform(-np.pi, np.pi, (count, 2)))


@pytest.mark.parametrize("bent", [on_plane, on_cylinder, on_cone])
def test_bent_sheets_that_views_saw_from_anywhere_come_back_as_they_were_cut(bent: Bent) -> None:
    turned = Rigid3(rotation_about(AXIS, 0.8), np.array([0.1, -0.2, 0.3]))
    poses = STILL, turned
    views = [
        observed(UV, COLUMN < 15, 0, bent=bent),
        observed(UV, COLUMN >= 9, 1, bent=bent, pose=turned),
    ]
    graph, _ = graph_of(nodes_at(UV, bent), views, poses)
    found = laid(graph)
    assert found.holds.all()
    assert (found.piece == 0).all()
    assert off_m(places_of(found.z), UV) < 1e-6


def test_a_ring_that_has_no_seam_lies_flat_where_it_is_cut() -> None:
    """A sheet that is a closed tube cannot hold together on the plane: it opens, undistorted."""
    rows, cols = 6, 40
    uv = grid(rows, cols)
    ends = np.stack([np.arange(rows), (cols - 1) * rows + np.arange(rows)], axis=1)
    closed, is_closing = with_links(exact_graph(uv), ends, np.full((rows, 2), -STEP_M + 0j))
    found = laid(closed)
    opened = ~found.holds
    assert opened.any()
    z = found.z[closed.pairs]
    apart = np.abs(z[:, 1] - z[:, 0])[found.holds & ~is_closing]
    assert np.abs(apart / closed.length_m[found.holds & ~is_closing] - 1.0).max() < 0.02


@pytest.mark.parametrize("count", [12, 40])
def test_links_that_join_distant_parts_of_a_sheet_are_found_and_nothing_else_is(count: int) -> None:
    everywhere = np.arange(len(UV))
    ends, way = false_links(count, everywhere, everywhere, UV, seed=count)
    graph, is_false = with_links(exact_graph(UV, frames=any_frames(len(UV))), ends, way)
    found = laid(graph)
    np.testing.assert_array_equal(~found.holds, is_false)
    assert off_m(places_of(found.z), UV) < 1e-6


def test_false_links_between_two_sheets_do_not_move_them_where_a_seam_of_true_ones_joins_them() -> None:
    ends, way = false_links(40, np.flatnonzero(COLUMN < 10), np.flatnonzero(COLUMN > 14), UV, seed=3)
    row = np.rint(UV[:, 1] / STEP_M).astype(int)
    pairs = neighbours(UV)
    across = (COLUMN[pairs] <= 11).any(axis=1) & (COLUMN[pairs] > 11).any(axis=1)
    kept = ~across | (row[pairs] < 4).all(axis=1)
    graph, is_false = with_links(exact_graph(UV, pairs[kept]), ends, way)
    found = laid(graph)
    np.testing.assert_array_equal(~found.holds, is_false)
    assert off_m(places_of(found.z), UV) < 1e-6


def test_sheets_that_only_false_links_join_stay_apart() -> None:
    left, right = COLUMN < 11, COLUMN > 12
    pairs = neighbours(UV)
    own = left[pairs].all(axis=1) | right[pairs].all(axis=1)
    ends, way = false_links(30, np.flatnonzero(left), np.flatnonzero(right), UV, seed=1)
    graph, is_false = with_links(exact_graph(UV, pairs[own]), ends, way)
    found = laid(graph)
    np.testing.assert_array_equal(~found.holds, is_false)
    assert set(found.piece[left]).isdisjoint(found.piece[right])
    for part in (left, right):
        assert off_m(places_of(found.z)[part], UV[part]) < 1e-6


def test_pairs_that_the_operator_vouches_for_hold_against_more_that_say_otherwise() -> None:
    """The right sheet is laid 40 mm lower than twice as many pairs have it."""
    left = COLUMN < 12
    laid_down = UV + np.where(left[:, None], 0.0, (0.0, 5 * STEP_M))
    below = neighbours(laid_down)
    ends = np.sort(below[left[below].sum(axis=1) == 1], axis=1)
    z = laid_down @ np.array([1.0, 1j])
    way = np.diff(z[ends], axis=1)
    graph, is_laid = with_links(exact_graph(UV), ends, np.repeat(way, 2, axis=1))
    otherwise = (left[graph.pairs].sum(axis=1) == 1) & ~is_laid
    assert otherwise.sum() > 1.5 * is_laid.sum() > 10
    used = np.ones(len(graph.pairs), dtype=bool)
    assert not laid(graph).holds[is_laid].any()
    assert laid_out(graph, used, is_laid).holds[is_laid].all()


@pytest.mark.parametrize("neck", [2, 3])
@pytest.mark.parametrize("bend_deg", [0.0, 35.0])
def test_two_sheets_on_a_narrow_neck_keep_their_angle(neck: int, bend_deg: float) -> None:
    """The second sheet is cut at an angle to the first; only a strip, two or three nodes wide, tells it."""
    uv, part = plates(neck, gap=6)
    pairs = neighbours(uv)
    hinge = uv[part == 1].min(axis=0)
    a = np.radians(bend_deg)
    turn = np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
    cut = np.where((part == 1)[:, None], hinge + (uv - hinge) @ turn.T, uv)
    graph = exact_graph(cut, pairs, frames=any_frames(len(uv)))
    found = laid(graph)
    assert found.holds.all()
    assert off_m(places_of(found.z), cut) < 1e-6


def test_noise_of_lengths_turns_a_hinge_by_less_than_a_degree() -> None:
    uv, part = plates(neck=2, gap=6)
    graph = exact_graph(uv, frames=any_frames(len(uv)))
    noise_m = 0.0001 * np.random.default_rng(1).standard_normal(len(graph.pairs))
    z = laid(replace(graph, length_m=graph.length_m + noise_m)).z
    middle = [z[part == n].mean() for n in (0, 1)]
    edge = z[(part == 0) & (uv[:, 0] < 0.5 * STEP_M)]
    along, down = middle[1] - middle[0], edge[-1] - edge[0]
    assert abs(np.degrees(np.angle(down / along)) - 90.0) < 1.0


def test_the_layout_is_the_same_for_turned_frames_a_turned_item_and_renumbered_nodes() -> None:
    random = np.random.default_rng(2)
    uv, _ = plates(neck=3, gap=4)
    graph = exact_graph(uv, frames=any_frames(len(uv)))
    graph = replace(graph, length_m=graph.length_m + 0.0002 * random.standard_normal(len(graph.pairs)))
    place = places_of(laid(graph).z)
    turned = replace(
        graph, offset_m=graph.offset_m * np.exp(0.7j), xyz_m=graph.xyz_m @ rotation_about(AXIS, 1.1)
    )
    assert off_m(places_of(laid(turned).z), place) < 1e-5
    name = random.permutation(len(uv)).astype(np.int32)
    renamed = name[graph.pairs]
    is_turned = renamed[:, 0] > renamed[:, 1]
    renamed = np.sort(renamed, axis=1)
    order = np.lexsort((renamed[:, 1], renamed[:, 0]))
    offset = np.where(is_turned[:, None], -graph.offset_m[:, ::-1], graph.offset_m)
    xyz = np.empty_like(graph.xyz_m)
    xyz[name] = graph.xyz_m
    again = replace(
        graph, xyz_m=xyz, pairs=renamed[order], length_m=graph.length_m[order], offset_m=offset[order]
    )
    assert off_m(places_of(laid(again).z)[name], place) < 1e-5
