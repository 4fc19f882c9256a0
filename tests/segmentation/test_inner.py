"""Inner faces, thin and in the shade: the back panel reaches beyond the hem of the front one."""

from dataclasses import replace

import numpy as np
import pytest

from flatcloth.segmentation.clusters import Clusters
from flatcloth.segmentation.inner import inner_faces
from flatcloth.segmentation.relations import SignedGraph, surroundings

STEP_M, COLS, ROWS, FLAP = 0.006, 20, 24, 5
TWO_LAYERS_M = 0.0016
BACK_ROWS = ROWS + FLAP


def sheet(first_row, rows, depth_m, normal_z):
    row, col = np.mgrid[first_row : first_row + rows, :COLS]
    place = np.stack([STEP_M * col, STEP_M * row, np.full(row.shape, depth_m)], axis=-1).reshape(-1, 3)
    return place, np.tile([0.0, 0.0, normal_z], (len(place), 1))


def garment(two_layers_m=TWO_LAYERS_M, noise_m=0.0):
    """Clusters of the front panel's face, of the inner face below its hem, and of the back panel's face."""
    parts = [sheet(0, ROWS, 0.0, -1.0), sheet(ROWS, FLAP, two_layers_m, -1.0)]
    parts.append(sheet(0, BACK_ROWS, two_layers_m, 1.0))
    place, normal = (np.concatenate([part[n] for part in parts]) for n in (0, 1))
    place[:, 2] += noise_m * np.random.default_rng(0).standard_normal(len(place))
    face = np.repeat([0, 1, 2], [len(part[0]) for part in parts])
    count, begin, links = len(place), 0, []
    for part in parts:
        number = begin + np.arange(len(part[0])).reshape(-1, COLS)
        for a, b in ((number[:, :-1], number[:, 1:]), (number[:-1], number[1:])):
            links.append((a.ravel(), b.ravel(), np.full(a.size, 8.0)))
        begin += number.size
    hem = np.arange((ROWS - 1) * COLS, ROWS * COLS)
    links.append((hem, hem + COLS, np.full(COLS, 0.1)))  # the views hardly join it to what lies beyond
    first, second, weight = (np.concatenate([link[n] for link in links]) for n in range(3))
    clusters = Clusters(
        place_m=place, normal=normal, pixels=np.full(count, 60), facing=np.full(count, 0.95),
        area_m2=np.full(count, 4e-5), of_pixel=np.empty(0, dtype=np.int32),
    )  # fmt: skip
    return clusters, SignedGraph(count=count, first=first, second=second, weight=weight), face


def found(clusters, graph, face, dark=60.0):
    """Return the inner faces; light falls on all but the inner one."""
    around, lightness = surroundings(clusters, 0.02), np.where(face == 1, dark, 100.0)
    return inner_faces(clusters, graph, around, lightness)


@pytest.mark.parametrize(("two_layers_m", "noise_m"), [(0.0016, 0.0), (0.0016, 0.0003), (0.004, 0.001)])
@pytest.mark.parametrize("link", [None, 8.0])
def test_the_inner_face_beyond_a_hem_is_found_and_no_outer_face(two_layers_m, noise_m, link):
    clusters, graph, face = garment(two_layers_m, noise_m)
    if link is not None:  # the views join it to the front panel
        graph = replace(graph, weight=np.full(graph.weight.size, link))
    inner = found(clusters, graph, face)
    assert (inner[face == 1] >= 0).mean() > 0.7
    assert (inner[face != 1] >= 0).mean() < 0.03
    assert len(set(inner[inner >= 0])) == 1


def test_thin_cloth_in_the_light_is_no_inner_face_nor_is_thick_cloth_in_the_dark():
    clusters, graph, face = garment()
    assert (found(clusters, graph, face, dark=110.0) < 0).all()
    for further_m in (TWO_LAYERS_M, 0.05):  # thick, and nothing at its back that could be measured
        clusters.place_m[face == 1, 2] -= further_m
        assert (found(clusters, graph, face) < 0).all()


@pytest.mark.parametrize("two_layers_m", [0.0, 0.05])
def test_a_towel_and_layers_too_far_apart_to_be_compared_have_no_inner_face(two_layers_m):
    assert (found(*garment(two_layers_m)) < 0).all()
