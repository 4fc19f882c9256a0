"""Pieces of cloth: what enough evidence joins, and no cloth that lies on other cloth."""

from dataclasses import replace

import numpy as np
import pytest
from made_up_sheets import STEP_M, exact_graph, grid, neighbours, off_m, on_cylinder, places_of

from flatcloth.core.types import Bool, Int32
from flatcloth.shape.algorithm import laid_out
from flatcloth.shape.graph import Graph
from flatcloth.shape.joints import LEAST_PIECE
from flatcloth.shape.pieces import (
    MOST_CUT_EVIDENCE,
    overlapping_pairs,
    pieces_of,
    weakest_cut,
)

TWO = np.concatenate([grid(10, 10), grid(10, 10, (0.2, 0.0))])
RIM = [(90 + row, 100 + row) for row in range(10)]
"""Pairs from the right rim of the first grid to the left rim of the second."""


def pieces(
    uv: np.ndarray, bridge: list[tuple[int, int]], evidence: float, own: float = 1.0, *, vouched: bool = False
) -> Int32:
    """The pieces of sheets whose pairs have their ``own`` evidence, and those of the bridge another one."""
    ends = np.array(bridge, dtype=np.int32).reshape(-1, 2)
    graph = exact_graph(uv, np.concatenate([neighbours(uv), ends]))
    is_bridge = (graph.pairs[:, None] == ends).all(axis=2).any(axis=1)
    graph = replace(graph, evidence=np.where(is_bridge, evidence, own))
    return pieces_of(graph, np.ones(len(graph.pairs), dtype=bool), is_bridge & vouched)


@pytest.mark.parametrize(
    ("count", "evidence", "joined"),
    [(0, 1.0, False), (1, 0.9, False), (1, 1.1, True), (2, 0.6, True), (10, 0.05, False), (10, 0.15, True)],
)
def test_two_sheets_are_one_piece_from_enough_evidence_on(count: int, evidence: float, joined: bool) -> None:
    piece = pieces(TWO, RIM[:count], evidence)
    assert len(set(piece[:100])) == len(set(piece[100:])) == 1
    assert (piece[0] == piece[100]) == joined


def test_two_pairs_that_the_operator_vouches_for_join_two_sheets_of_noisy_cloth() -> None:
    rim = np.concatenate([TWO, [[0.2 - STEP_M, 4 * STEP_M]]])  # a node that sticks out of the second sheet
    bridge = [(93, 200), (94, 200), (95, 200)]
    found = [pieces(rim, bridge, 1.0, own=0.3, vouched=vouched) for vouched in (False, True)]
    assert [piece[0] == piece[100] for piece in found] == [False, True]


def test_a_chain_of_sheets_is_joined_link_by_link() -> None:
    three = np.concatenate([TWO, grid(10, 10, (0.4, 0.0))])
    onward = [(190 + row, 200 + row) for row in range(10)]
    assert set(pieces(three, RIM + onward, 1.0)) == {0}


def test_a_loose_node_goes_with_the_sheet_that_it_shares_most_with() -> None:
    uv = np.concatenate([TWO, [[0.14, 0.05]]])
    piece = pieces(uv, [(95, 200), (104, 200), (105, 200)], 0.9)
    assert piece[200] == piece[100] != piece[0]


def test_pieces_are_numbered_by_size_and_scraps_are_none() -> None:
    uv = np.concatenate([grid(2, 2, (0.3, 0.0)), grid(5, 8, (0.5, 0.0)), grid(10, 10), [[0.8, 0.0]]])
    size = [4, 40, 100, 1]
    np.testing.assert_array_equal(pieces(uv, [], 1.0), np.repeat([-1, 1, 0, -1], size))


def test_a_shape_of_a_few_nodes_only_is_a_piece_nevertheless() -> None:
    assert set(pieces(grid(2, 3), [], 1.0)) == {0}


ROWS, COLS = 16, 30
SHEET = grid(ROWS, COLS)
FLAP = grid(8, 9, corner=(5.0, 0.0))
EVERYTHING = np.concatenate([SHEET, FLAP])
ON_FLAP = np.arange(len(EVERYTHING)) >= len(SHEET)


def falsely_joined(pairs: int, evidence: float = 1.0) -> tuple[Graph, Bool]:
    """A flap in front of a sheet, joined amid it by pairs that agree; which pairs these are."""
    beside = SHEET[9 * ROWS + 4] - FLAP[0]
    laid = EVERYTHING + np.where(ON_FLAP[:, None], beside, 0.0)
    own = neighbours(EVERYTHING)
    false = np.stack([8 * ROWS + 4 + np.arange(pairs), len(SHEET) + np.arange(pairs)], axis=1)
    xyz = on_cylinder(laid)[0] - np.where(ON_FLAP, 0.5, 0.0)[:, None] * [0.0, 0.0, 1.0]
    graph = exact_graph(laid, np.concatenate([own, false]).astype(np.int32), xyz_m=xyz)
    is_false: Bool = np.asarray(ON_FLAP[graph.pairs].sum(axis=1) == 1)
    return replace(graph, evidence=np.where(is_false, evidence, 1.0)), is_false


def test_a_flat_sheet_does_not_lie_on_itself_and_one_folded_over_does() -> None:
    xyz, _ = on_cylinder(SHEET)
    assert overlapping_pairs(SHEET, xyz).size == 0
    folded = SHEET.copy()
    folded[:, 0] = np.minimum(folded[:, 0], 2 * 15 * STEP_M - folded[:, 0])
    pairs = overlapping_pairs(folded, xyz)
    assert len(pairs) > ROWS
    assert np.linalg.norm(xyz[pairs[:, 0]] - xyz[pairs[:, 1]], axis=1).min() > 0.045
    folded[: 4 * ROWS] = np.nan
    assert overlapping_pairs(folded, xyz).min() >= 4 * ROWS


def test_the_weakest_cut_is_the_false_link() -> None:
    graph, is_false = falsely_joined(5)
    laid = EVERYTHING + np.where(ON_FLAP[:, None], SHEET[9 * ROWS + 4] - FLAP[0], 0.0)
    lying = overlapping_pairs(laid, graph.xyz_m)
    cut, strength, smaller = weakest_cut(lying, graph.xyz_m, graph.pairs, graph.evidence)
    np.testing.assert_array_equal(cut, is_false)
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
    graph, is_false = falsely_joined(5)
    found = laid_out(graph, np.ones(len(is_false), dtype=bool))
    np.testing.assert_array_equal(~found.holds, is_false)
    np.testing.assert_array_equal(found.piece, ON_FLAP.astype(np.int32))
    for own in (~ON_FLAP, ON_FLAP):
        assert off_m(places_of(found.z)[own], EVERYTHING[own]) < 1e-6


@pytest.mark.parametrize("why", ["much evidence", "the operator laid it", "two sheets are meant"])
def test_cloth_that_lies_on_other_cloth_stays_where_there_is_a_reason(why: str) -> None:
    strong = why == "much evidence"
    graph, is_false = falsely_joined(5, evidence=1.0 + MOST_CUT_EVIDENCE / 5.0 if strong else 1.0)
    vouched: Bool = np.asarray(is_false & (why == "the operator laid it"))
    seams = is_false if why == "two sheets are meant" else None
    found = laid_out(graph, np.ones(len(is_false), dtype=bool), vouched, seams)
    assert found.holds.all()
    assert (found.piece == 0).all()


def test_a_few_nodes_on_other_cloth_are_not_cut_off() -> None:
    graph, _ = falsely_joined(5)
    few = np.flatnonzero(ON_FLAP)[: LEAST_PIECE // 3]
    kept = ~ON_FLAP | np.isin(np.arange(len(ON_FLAP)), few)
    used: Bool = np.asarray(kept[graph.pairs].all(axis=1))
    found = laid_out(graph, used)
    assert (found.piece[few] == 0).all()
