"""Which pieces of cloth are connected: grids that share many pairs, few, or none."""

from __future__ import annotations

import numpy as np
import pytest
from made_up_sheets import STEP_M, grid
from scipy.spatial import cKDTree

from flatcloth.core.types import Float64, Int32
from flatcloth.methods.robust.connectivity import (
    _neighbours_in_common,
    connected_pieces,
    pairs_once,
)

LEAST_CORE_NODES, LEAST_EVIDENCE = 40, 2.0


def pairs(uv: Float64) -> Int32:
    found: Int32 = cKDTree(uv).query_pairs(1.5 * STEP_M, output_type="ndarray").astype(np.int32)
    return found


def pieces(uv: Float64, bridge: list[tuple[int, int]], evidence: float) -> Int32:
    """The pieces of a sheet whose own pairs are certain, and those of the bridge have some evidence."""
    own = pairs(uv)
    edges = np.concatenate([own, np.array(bridge, dtype=np.int32).reshape(-1, 2)])
    each = np.concatenate([np.ones(len(own)), np.full(len(bridge), evidence)])
    first, pair = pairs_once(len(uv), edges)
    return connected_pieces(
        len(uv), np.sort(edges[first], axis=1), np.bincount(pair, each), LEAST_CORE_NODES, LEAST_EVIDENCE
    )


TWO = np.concatenate([grid(10, 10), grid(10, 10, (0.2, 0.0))])
RIM = [(90 + row, 100 + row) for row in range(10)]
"""Pairs from the right rim of the first grid to the left rim of the second."""


@pytest.mark.parametrize(
    ("count", "evidence", "joined"),
    [(0, 1.0, False), (1, 1.0, False), (2, 1.0, True), (10, 0.15, False), (10, 0.25, True)],
)
def test_two_sheets_are_one_piece_from_enough_evidence_on(count: int, evidence: float, joined: bool) -> None:
    piece = pieces(TWO, RIM[:count], evidence)
    assert len(set(piece[:100])) == len(set(piece[100:])) == 1
    assert (piece[0] == piece[100]) == joined


def test_several_views_of_the_same_pair_add_their_evidence() -> None:
    piece = pieces(TWO, [RIM[4], RIM[4][::-1]], 1.0)
    assert piece[0] == piece[100]


def test_a_chain_of_sheets_is_joined_link_by_link() -> None:
    three = np.concatenate([TWO, grid(10, 10, (0.4, 0.0))])
    onward = [(190 + row, 200 + row) for row in range(10)]
    assert len(set(pieces(three, RIM + onward, 1.0))) == 1


def test_a_loose_node_goes_with_the_sheet_that_it_shares_most_with() -> None:
    uv = np.concatenate([TWO, [[0.14, 0.05]]])
    piece = pieces(uv, [(200, 95), (200, 104), (200, 105)], 0.9)
    assert piece[200] == piece[100] != piece[0]


def test_scraps_are_pieces_of_their_own() -> None:
    uv = np.concatenate([grid(10, 10), grid(2, 2, (0.3, 0.0)), [[0.5, 0.0]]])
    piece = pieces(uv, [], 1.0)
    assert len(set(piece[100:104])) == 1
    assert len({piece[0], piece[100], piece[104]}) == 3


def test_neighbours_in_common_are_those_of_both_ends() -> None:
    edges = pairs(grid(6, 7))
    low, high = np.sort(edges[pairs_once(42, edges)[0]], axis=1).T.copy()
    near = [set(high[low == n]) | set(low[high == n]) for n in range(42)]
    found = _neighbours_in_common(42, low, high)
    np.testing.assert_array_equal(found, [len(near[a] & near[b]) for a, b in zip(low, high, strict=True)])


def test_pairs_that_several_views_contribute_are_found_once_in_either_order() -> None:
    edges = np.array([[3, 1], [0, 2], [1, 3], [2, 0], [0, 1], [2, 0]], dtype=np.int32)
    first, pair = pairs_once(5, edges)
    np.testing.assert_array_equal(np.sort(edges[first], axis=1), [[0, 1], [0, 2], [1, 3]])
    np.testing.assert_array_equal(first, [4, 1, 0])
    np.testing.assert_array_equal(pair, [2, 1, 2, 1, 0, 1])
    assert [len(found) for found in pairs_once(3, edges[:0])] == [0, 0]
