"""What colors tell of the sides of a long strip of cloth: two layers, back to back."""

import numpy as np
import pytest

from flatcloth.segmentation.clusters import Clusters
from flatcloth.segmentation.color import alike_in_color, odds_by_color
from flatcloth.segmentation.relations import SignedGraph

FRONT = np.arange(600)
BACK = FRONT + 600
FACE = FRONT[300:312]


def of_color(apart, print_px=3, opposite=-0.8):
    """Evidence and odds by a print, this many clusters wide, so far off the other's in b*, but on FACE."""
    pairs = np.concatenate([np.stack([each[:-1], each[1:]]) for each in (FRONT, BACK)], axis=1)
    weight = np.append(np.full(len(pairs[0]), 0.9), np.full(600, opposite))
    first, second = np.concatenate([pairs, [FRONT, BACK]], axis=1)
    place, one = 0.006 * np.tile(FRONT, 2)[:, None] * [1.0, 0.0, 0.0], np.ones(1200)
    clusters = Clusters(place_m=place, normal=place, pixels=one, facing=one, area_m2=one, of_pixel=one)
    chroma = np.random.default_rng(0).normal(128.0, 4.0, (1200 // print_px, 2)).repeat(print_px, axis=0)
    chroma[np.setdiff1d(FRONT, FACE), 1] += apart
    graph = SignedGraph(count=1200, first=first, second=second, weight=weight)
    evidence, probability = alike_in_color(clusters, graph, chroma)
    return evidence, probability, odds_by_color(graph, chroma, evidence)


def test_panels_of_other_colors_are_told_apart():
    evidence, probability, _ = of_color(8.0)
    evidence *= np.sign(evidence[0])
    assert probability > 0.99
    assert (evidence[FRONT] > 0).mean() > 0.98
    assert (evidence[BACK] < 0).mean() > 0.98


def test_an_inner_face_has_the_color_of_its_panel_among_cloth_of_the_other():
    evidence, _, odds = of_color(20.0)
    odds *= np.sign(evidence[0])
    assert (odds[FACE[2:-2]] < -1.0).all()
    assert (odds[np.setdiff1d(FRONT, FRONT[290:322])] > 1.0).mean() > 0.98


@pytest.mark.parametrize(("print_px", "opposite"), [(1, -0.8), (3, -0.8), (10, -0.8), (3, 0.0)])
def test_the_same_print_on_both_panels_or_no_layers_back_to_back_say_nothing(print_px, opposite):
    assert of_color(0.0, print_px, opposite)[1] < 0.5
