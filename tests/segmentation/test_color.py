"""What colors tell of the sides, where layers lie back to back."""

from __future__ import annotations

import numpy as np
import pytest

from flatcloth.segmentation.clusters import Clusters
from flatcloth.segmentation.color import alike_in_color
from flatcloth.segmentation.relations import SignedGraph
from flatcloth.segmentation.settings import SegmentationConfig

SIDE, STEP_M = 60, 0.006


def plate(opposite=-0.8):
    """A plate of 36 x 36 cm: clusters of its front, and of its back behind them."""
    row, col = np.mgrid[:SIDE, :SIDE]
    front = np.stack([STEP_M * col, STEP_M * row, np.zeros((SIDE, SIDE))], axis=-1).reshape(-1, 3)
    count, links = SIDE * SIDE, []
    for number in (np.arange(count).reshape(SIDE, SIDE), count + np.arange(count).reshape(SIDE, SIDE)):
        links += [(number[:, :-1], number[:, 1:], 0.9), (number[:-1], number[1:], 0.9)]
    links.append((np.arange(count), np.arange(count, 2 * count), opposite))
    first, second = (np.concatenate([link[n].ravel() for link in links]) for n in (0, 1))
    weight = np.concatenate([np.full(link[0].size, link[2]) for link in links])
    clusters = Clusters(
        place_m=np.concatenate([front, front + np.array([0.0, 0.0, 0.002])]), normal=np.zeros((2 * count, 3)),
        pixels=np.ones(2 * count, np.int64), facing=np.ones(2 * count), area_m2=np.ones(2 * count),
        of_pixel=np.empty(0, np.int32),
    )  # fmt: skip
    return clusters, SignedGraph(count=2 * count, first=first, second=second, weight=weight)


def of_color(apart, print_px=3, opposite=-0.8):
    clusters, graph = plate(opposite)
    random = np.random.default_rng(0)
    pattern = random.normal(128.0, 6.0, (2, SIDE // print_px, SIDE // print_px, 2))
    chroma = pattern.repeat(print_px, axis=1).repeat(print_px, axis=2).reshape(-1, 2)
    chroma[: SIDE * SIDE] += apart
    return alike_in_color(clusters, graph, chroma, SegmentationConfig())


def test_panels_of_other_colors_are_told_apart_and_by_evidence_that_is_bounded():
    evidence, probability = of_color(apart=(0.0, 8.0))
    front, back = np.split(np.sign(evidence[0]) * evidence, 2)
    assert probability > 0.99
    assert (front > 0).mean() > 0.98
    assert (back < 0).mean() > 0.98
    assert np.abs(evidence).max() <= SegmentationConfig().color_evidence


@pytest.mark.parametrize("print_px", [1, 3, 10])
def test_a_print_that_is_the_same_on_both_panels_says_nothing(print_px):
    assert of_color(apart=(0.0, 0.0), print_px=print_px)[1] < 0.5


def test_where_no_layers_lie_back_to_back_colors_say_nothing():
    evidence, probability = of_color(apart=(0.0, 8.0), opposite=0.0)
    assert not evidence.any()
    assert probability == 0.0
