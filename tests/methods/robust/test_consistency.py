"""No cloth lies on other cloth: what folded in the minimisation unfolds, and false links are cut."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_up_sheets import STEP_M, bent, grid, nodes_at, observed, shape_of

from flatcloth.core.geometry import fit_rigid2
from flatcloth.core.types import Float64
from flatcloth.methods.robust.connectivity import links_of
from flatcloth.methods.robust.consistency import (
    contradicted_pairs,
    overlapping_pairs,
    overlaps,
    weakest_cut,
    without_overlap,
)
from flatcloth.methods.robust.joint import flatten_jointly, with_better_cuts
from flatcloth.methods.robust.joint_shape import LEAST_PIECE, JointShape
from flatcloth.methods.robust.layout import grown_layout

ROWS, COLS = 16, 30
SHEET = grid(ROWS, COLS)
FLAP = grid(8, 9, corner=(5.0, 0.0))
"""Far off on the plane, so that :func:`observed` joins it to nothing."""
EVERYTHING = np.concatenate([SHEET, FLAP])
ON_FLAP = np.arange(len(EVERYTHING)) >= len(SHEET)


def off_m(found: Float64, true: Float64) -> float:
    return float(np.linalg.norm(fit_rigid2(found, true).apply(found) - true, axis=1).max())


def falsely_joined(pairs: int) -> JointShape:
    """A flap in front of a sheet, its left column joined to a column amid the sheet by some pairs."""
    view = observed(EVERYTHING, np.ones(len(EVERYTHING), dtype=bool), 0)
    sheet_column = 8 * ROWS + 4 + np.arange(pairs)
    flap_column = len(SHEET) + np.arange(pairs)
    false = np.stack([sheet_column, flap_column], axis=1).astype(np.int32)
    view = replace(
        view,
        edges=np.concatenate([view.edges, false]),
        edge_length_m=np.concatenate([view.edge_length_m, np.full(pairs, STEP_M)]),
        edge_std_m=np.concatenate([view.edge_std_m, np.full(pairs, 0.0003)]),
        edge_evidence=np.concatenate([view.edge_evidence, np.ones(pairs)]),
        offset=np.concatenate([view.offset, np.full((pairs, 2), STEP_M + 0j)]),
    )
    shape = shape_of(EVERYTHING, [view], ~ON_FLAP)
    xyz = shape.nodes.xyz_m + np.where(ON_FLAP, -0.5, 0.0)[:, None] * [0.0, 0.0, 1.0]
    return replace(shape, nodes=replace(shape.nodes, xyz_m=xyz))


def test_a_flat_sheet_does_not_lie_on_itself_and_one_folded_over_does() -> None:
    xyz, _ = bent(SHEET)
    assert overlapping_pairs(SHEET, xyz).size == 0
    folded = SHEET.copy()
    folded[:, 0] = np.minimum(folded[:, 0], 2 * 15 * STEP_M - folded[:, 0])
    pairs = overlapping_pairs(folded, xyz)
    assert len(pairs) > ROWS
    assert np.linalg.norm(xyz[pairs[:, 0]] - xyz[pairs[:, 1]], axis=1).min() > 0.045
    folded[: 4 * ROWS] = np.nan
    assert overlapping_pairs(folded, xyz).min() >= 4 * ROWS


def test_the_weakest_cut_is_the_false_link() -> None:
    shape = falsely_joined(5)
    laid = EVERYTHING.copy()
    laid[ON_FLAP] += SHEET[9 * ROWS + 4] - FLAP[0]
    links = shape.links
    cut, strength, smaller = weakest_cut(
        overlapping_pairs(laid, shape.nodes.xyz_m), shape.nodes.xyz_m, links.edges, np.ones(len(links.edges))
    )
    np.testing.assert_array_equal(np.flatnonzero(cut), np.arange(len(links.edges) - 5, len(links.edges)))
    assert strength == 5.0
    np.testing.assert_array_equal(smaller, ON_FLAP)


def test_layers_that_meet_in_space_are_cut_where_they_are_joined_least() -> None:
    """Two strips that part from a fold, like a V. The second is laid on the first, a little farther on."""
    n = 12
    along = 0.01 * np.arange(n)
    sloped = 2.4 * along
    zero = np.zeros(n)
    xyz = np.stack([np.tile(along, 2), np.concatenate([sloped, -sloped]), np.tile(zero, 2)], axis=1)
    uv = np.stack([np.concatenate([along, along + 0.009]), np.tile(zero, 2)], axis=1)
    chain = np.stack([np.arange(n - 1), np.arange(1, n)], axis=1)
    edges = np.concatenate([chain, chain + n, [[0, n]]]).astype(np.int32)
    evidence = np.append(np.full(2 * (n - 1), 10.0), 4.0)
    cut, strength, smaller = weakest_cut(overlapping_pairs(uv, xyz), xyz, edges, evidence)
    np.testing.assert_array_equal(np.flatnonzero(cut), [len(edges) - 1])
    assert strength == 4.0
    assert smaller.sum() == n


def test_a_flap_that_would_lie_on_the_sheet_is_cut_off_and_floats() -> None:
    solved = flatten_jointly(falsely_joined(5))
    assert set(solved.piece[~ON_FLAP]) == {0}
    assert set(solved.piece[ON_FLAP]) == {1}
    assert solved.is_cut.sum() == 5
    assert not solved.weight[solved.is_cut].any()
    assert off_m(solved.uv_m[~ON_FLAP], SHEET) < 2e-4
    assert off_m(solved.all_uv_m[ON_FLAP], FLAP) < 2e-4


def test_what_much_evidence_joins_is_not_cut() -> None:
    shape = falsely_joined(5)
    (view,) = shape.observations
    sure = replace(view, edge_evidence=np.full(len(view.edges), 10.0))
    assert not flatten_jointly(replace(shape, observations=(sure,), links=links_of([sure]))).is_cut.any()


def wrongly_cut(pairs: int, views: int) -> JointShape:
    """A sheet whose halves were cut apart when a false link of some pairs joined them elsewhere first."""
    n = ROWS * COLS
    views_of_sheet = [observed(SHEET, np.ones(n, dtype=bool), view) for view in range(views)]
    column = np.arange(n) // ROWS
    false = np.stack([5 * ROWS + np.arange(pairs), 24 * ROWS + np.arange(pairs)], axis=1).astype(np.int32)
    liar = replace(
        views_of_sheet[0],
        view_index=views,
        edges=false,
        edge_length_m=np.full(pairs, STEP_M),
        edge_std_m=np.full(pairs, 0.0003),
        edge_evidence=np.ones(pairs),
        offset=np.full((pairs, 2), STEP_M + 0j),
    )
    shape = shape_of(SHEET, [*views_of_sheet, liar], np.ones(n, dtype=bool))
    ends = column[shape.links.edges]
    between = (ends.min(axis=1) == COLS // 2 - 1) & (ends.max(axis=1) == COLS // 2)
    xyz = shape.nodes.xyz_m * [3.0, 1.0, 3.0]  # the false ends are far from one another in space, too
    shape = replace(shape, is_cut=between, weight=np.where(between, 0.0, 1.0))
    return replace(shape, nodes=replace(shape.nodes, xyz_m=xyz), settled_pairs=0)


def test_cuts_are_chosen_anew_when_later_views_contradict_them() -> None:
    shape = flatten_jointly(wrongly_cut(pairs=10, views=2))
    assert not shape.placed.all()
    better = with_better_cuts(shape)
    assert better.placed.all()
    assert off_m(better.uv_m, SHEET) < 0.002
    false = better.links.observation == 2
    assert (better.is_cut[false] | (better.weight[false] < 0.05)).all()
    assert not better.is_cut[~false].any()
    assert with_better_cuts(better).all_uv_m is better.all_uv_m


def test_cuts_stay_while_little_evidence_contradicts_them_and_where_the_operator_placed_cloth() -> None:
    shape = flatten_jointly(wrongly_cut(pairs=10, views=2))
    assert with_better_cuts(replace(shape, cuts_tried=1e3)).is_cut is shape.is_cut
    weak = replace(shape, links=replace(shape.links, evidence=0.1 * shape.links.evidence))
    assert with_better_cuts(weak) is weak
    placed = replace(shape, by_hand=np.ones(len(SHEET), dtype=bool))
    assert with_better_cuts(placed) is placed


def test_a_sheet_that_was_folded_over_before_a_view_came_unfolds() -> None:
    everything = np.ones(len(SHEET), dtype=bool)
    shape = shape_of(SHEET, [observed(SHEET, everything, 0)], everything)
    folded = SHEET.copy()
    folded[:, 0] = np.minimum(folded[:, 0], 2 * 15 * STEP_M - folded[:, 0])
    solved = flatten_jointly(replace(shape, all_uv_m=folded))
    assert off_m(solved.uv_m, SHEET) < 2e-4


@pytest.mark.parametrize(
    ("few", "false_mm", "is_laid_out_again"), [(1, 0, True), (1, 40, False), (12, 40, True)]
)
def test_few_nodes_on_other_cloth_change_a_layout_only_where_pairs_fit_the_new_one_better(
    few: int, false_mm: int, *, is_laid_out_again: bool
) -> None:
    everything = np.ones(len(SHEET), dtype=bool)
    shape = shape_of(SHEET, [observed(SHEET, everything, 0)], everything)
    uv, within = SHEET.copy(), np.arange(len(shape.links.edges))
    uv[:few] = uv[20 * ROWS : 20 * ROWS + few]
    ends = uv[shape.links.edges]
    if false_mm:  # all pairs are as long as they lie: the layout is the one that they ask for
        length_m = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
        shape = replace(shape, links=replace(shape.links, length_m=length_m))
    uv[-1] = np.nan  # it has no place in the one layout, and one in the other
    count = np.unique(overlaps(shape, uv)).size
    assert (0 < count < LEAST_PIECE) == (few == 1)
    again, cut = without_overlap(shape, uv, within, shape.weight.astype(np.float32), 0.0)
    assert (again is not uv) == is_laid_out_again
    assert not cut.size


@pytest.mark.parametrize("doubtful", [0.1, 0.4])
def test_a_layout_grown_anew_follows_the_evidence(doubtful: float) -> None:
    """One view says that 30 mm more lie across a column; where another sees it right, that places nothing."""
    everything = np.ones(len(SHEET), dtype=bool)
    right, wrong = observed(SHEET, everything, 0), observed(SHEET, everything, 1, evidence=doubtful)
    column = np.rint(SHEET[:, 0] / STEP_M).astype(int)
    across = (column[wrong.edges] <= 12).any(axis=1) & (column[wrong.edges] > 12).any(axis=1)
    wrong = replace(wrong, offset=np.where(across[:, None], wrong.offset + 0.03, wrong.offset))
    links = links_of([right, wrong])
    evidence = np.concatenate([right.edge_evidence, wrong.edge_evidence])
    z = grown_layout(len(SHEET), links.edges, links.member, links.offset, evidence, links.n_members)
    assert off_m(np.stack([z.real, z.imag], axis=1), SHEET) < 1e-9


def test_what_no_pair_reaches_has_no_place_in_a_layout_grown_anew() -> None:
    left = SHEET[:, 0] < 10 * STEP_M
    links = links_of([observed(SHEET, left, 0)])
    z = grown_layout(
        len(SHEET), links.edges, links.member, links.offset, np.ones(len(links.edges)), links.n_members
    )
    np.testing.assert_array_equal(np.isfinite(z.real), left)
    assert len(nodes_at(SHEET)) == z.size


def test_a_pair_that_joins_what_lies_far_apart_is_contradicted() -> None:
    uv = SHEET.copy()
    new = [5 * ROWS + 3, 20 * ROWS + 3]
    uv[new] = np.nan
    uv[25 * ROWS :] += [10.0, 0.0]  # a floating piece
    edges = [[0, 1], [0, 20 * ROWS], [ROWS, 26 * ROWS]]  # neighbours, far apart, of two pieces
    edges += [[new[0], new[0] + 1], [new[0], new[0] - 1], [new[0], 20 * ROWS + 4]]  # two of three agree
    edges += [[new[1], new[1] + 1], [new[0], new[1]]]
    pairs = np.array(edges, dtype=np.int32)
    found = contradicted_pairs(uv, pairs, np.full(len(pairs), STEP_M), np.ones(len(pairs)))
    np.testing.assert_array_equal(found, [False, True, False, False, False, True, False, True])
