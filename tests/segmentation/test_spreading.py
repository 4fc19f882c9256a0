"""How strokes spread, on sheets whose sides are known; one has a flap that shows its inner face."""

from __future__ import annotations

import numpy as np

from flatcloth.segmentation.relations import SignedGraph
from flatcloth.segmentation.settings import SegmentationConfig
from flatcloth.segmentation.spreading import Spreading

ROWS, COLS = 40, 40
FLAP = 6


def sheet(offset, rows=ROWS, cols=COLS, weight=10.0):
    number = offset + np.arange(rows * cols).reshape(rows, cols)
    first = np.concatenate([number[:, :-1].ravel(), number[:-1].ravel()])
    second = np.concatenate([number[:, 1:].ravel(), number[1:].ravel()])
    return number, first, second, np.full(len(first), weight)


def garment(*parts, pairs=()):
    first, second, weight = (np.concatenate([part[n] for part in parts]) for n in (1, 2, 3))
    for a, b, w in pairs:
        first, second = np.append(first, a), np.append(second, b)
        weight = np.append(weight, np.full(np.size(a), w))
    count = 1 + max(int(part[0].max()) for part in parts)
    graph = SignedGraph(count=count, first=first, second=second, weight=weight)
    return graph, Spreading(graph, SegmentationConfig())


def test_the_inner_face_of_a_flap_is_found_although_its_back_repels_it():
    front, flap, back = sheet(0), sheet(ROWS * COLS, FLAP, 20), sheet(ROWS * COLS + FLAP * 20, ROWS + FLAP)
    # Front and back repel each other; below the hem of the front, the back shows its inner face.
    behind = (front[0].ravel(), back[0][:ROWS].ravel(), -8.0)
    below = (flap[0].ravel(), back[0][ROWS:, :20].ravel(), -8.0)
    rim = (front[0][-1, :20], flap[0][0], 0.3)
    graph, spreading = garment(front, flap, back, pairs=(behind, below, rim))
    side = np.where(np.arange(graph.count) < back[0].min(), 1.0, -1.0)
    keep, turn = front[0][20, 15:20], flap[0][3, 8:12]
    face, cost = spreading.inner_face(side, keep, turn, 1)
    assert set(face) == set(flap[0].ravel())
    _, of_turning = spreading.turned_over(side, keep, turn, 1, graph.weight)
    assert cost < of_turning


def test_a_partition_made_again_turns_over_what_hangs_on_a_neck_and_nothing_that_a_stroke_holds():
    one, two = sheet(0), sheet(ROWS * COLS, 60, COLS)
    neck = (one[0][-1, 18:22], two[0][0, 18:22], 5.0)
    graph, spreading = garment(one, two, pairs=(neck,))
    side = np.ones(graph.count)
    keep, turn = one[0][5, 5:9], two[0][30, 5:9]
    region, cost = spreading.repartitioned(side, keep, turn, 2, graph.weight)
    assert set(region) == set(two[0].ravel())
    size = region.size
    settings = SegmentationConfig()
    expected = (4 * 5.0 + 2 * settings.flip_per_cluster * size) / size**settings.flip_exponent
    np.testing.assert_allclose(cost, expected)


def test_most_of_the_cloth_is_no_inner_face():
    one, two = sheet(0, 10, COLS), sheet(10 * COLS)
    graph, spreading = garment(one, two, pairs=((one[0][-1, :3], two[0][0, :3], 0.1),))
    _, cost = spreading.inner_face(np.ones(graph.count), one[0][2, 3:7], two[0][20, 5:9], 1)
    assert cost == np.inf
