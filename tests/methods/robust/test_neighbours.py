"""Sums over the neighbours of nodes, against their formulas."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from flatcloth.methods.robust.next_best_view import neighbourhoods_of


def test_sums_are_over_pairs_of_placed_nodes_weighted_by_their_views() -> None:
    random = np.random.default_rng(0)
    uv, xyz = random.normal(size=(6, 2)), random.normal(size=(6, 3))
    pairs = np.array([[0, 1], [0, 2], [1, 2], [2, 3], [3, 4], [4, 5]], dtype=np.int32)
    views = np.array([1, 2, 3, 4, 5, 6])
    has_place = np.arange(6) != 5
    graph, holds = SimpleNamespace(pairs=pairs, views=views), np.arange(6) != 2
    shape: Any = SimpleNamespace(
        graph=graph, holds=holds, has_place=has_place, all_uv_m=uv, nodes=SimpleNamespace(xyz_m=xyz)
    )
    views, found = views * holds, neighbourhoods_of(shape)
    for node in range(6):
        seen, other = [], []
        for (i, j), count in zip(pairs.tolist(), views.tolist(), strict=True):
            if node in (i, j) and has_place[[i, j]].all():
                seen.append(count)
                other.append(j if i == node else i)
        to, step, weight = uv[other] - uv[node], xyz[other] - xyz[node], np.array(seen, dtype=float)
        share = weight / np.linalg.norm(to, axis=1)
        assert found.views[node] == weight.sum()
        np.testing.assert_allclose(found.lean[node], share @ to, atol=1e-12)
        np.testing.assert_allclose(found.inwards[node], share @ step, atol=1e-12)
