"""Connected components of graphs."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from flatcloth.core.graphs import components


def test_components_are_numbered_by_their_first_nodes() -> None:
    rng = np.random.default_rng(0)
    for used in (20, 60, 120):
        i, j = rng.integers(0, 100, (2, 150)).astype(np.int32)
        graph = coo_matrix((np.ones(used), (i[:used], j[:used])), shape=(100, 100))
        expected = connected_components(graph, directed=False)[1]
        _, first = np.unique(expected, return_index=True)
        found = components(100, np.stack([i, j], axis=1)[:used])
        np.testing.assert_array_equal(found, np.argsort(np.argsort(first))[expected])
