"""Sums over the neighbours of nodes, against their formulas."""

from __future__ import annotations

import numpy as np

from flatcloth.methods.neighbours import neighbourhoods


def test_sums_are_over_pairs_of_placed_nodes_weighted_by_their_views() -> None:
    random = np.random.default_rng(0)
    uv, xyz = random.normal(size=(6, 2)), random.normal(size=(6, 3))
    pairs = np.array([[0, 1], [0, 2], [1, 2], [2, 3], [3, 4], [4, 5]], dtype=np.int32)
    views = np.array([1, 2, 3, 4, 5, 6])
    has_place = np.arange(6) != 5
    found = neighbourhoods(pairs, views, has_place, uv, xyz)
    for node in range(6):
        near = [
            (seen, *((j, 1.0) if i == node else (i, -1.0)))
            for (i, j), seen in zip(pairs.tolist(), views.tolist(), strict=True)
            if node in (i, j) and has_place[[i, j]].all()
        ]
        flat = [(seen, uv[other] - uv[node], xyz[other] - xyz[node]) for seen, other, _ in near]
        lean = sum((seen * to / np.linalg.norm(to) for seen, to, _ in flat), np.zeros(2))
        inwards = sum((seen * step / np.linalg.norm(to) for seen, to, step in flat), np.zeros(3))
        turned = sum((seen * np.outer(step, to) for seen, to, step in flat), np.zeros((3, 2)))
        assert found.views[node] == sum(seen for seen, *_ in flat)
        np.testing.assert_allclose(found.lean[node], lean, atol=1e-12)
        np.testing.assert_allclose(found.inwards[node], inwards, atol=1e-12)
        np.testing.assert_allclose(found.turned[node], turned, atol=1e-12)
