"""How far nodes may be off: little on a patch, much on what hangs on a neck."""

from dataclasses import replace

import numpy as np
from made_up_sheets import STEP_M, exact_graph, grid

from flatcloth.core.types import Bool, Float64
from flatcloth.shape.algorithm import laid_out
from flatcloth.shape.deviations import deviations_m
from flatcloth.shape.graph import Graph

PLATE = grid(20, 20)


def deviations(graph: Graph, own: Bool | None = None, reference: Bool | None = None) -> Float64:
    laid = laid_out(graph, np.ones(len(graph.pairs), dtype=bool))
    every = np.zeros(len(graph), dtype=np.int32)
    return deviations_m(laid.at, graph, every if own is None else np.where(own, 0, -1), reference)


def with_flap(neck: int, length: int = 5) -> tuple[Graph, Bool]:
    """A plate and a flap of 10 x 10 nodes, joined by a strip so many nodes wide and long; the flap's."""
    flap = grid(10, 10, ((20 + length) * STEP_M, 5 * STEP_M))
    strip = grid(neck, length, (20 * STEP_M, 8 * STEP_M))
    uv = np.concatenate([PLATE, flap, strip])
    at = np.arange(len(uv))
    return exact_graph(uv), (at >= len(PLATE)) & (at < len(PLATE) + len(flap))


def test_a_patch_that_hangs_together_is_sure_to_a_few_millimetres() -> None:
    std_m = deviations(exact_graph(PLATE))
    assert (std_m >= 0.0005).all()
    assert np.median(std_m) < 0.002
    assert std_m.max() < 0.004


def test_what_hangs_on_a_neck_is_less_sure_the_longer_it_is() -> None:
    found_m = []
    for length in (5, 15, 30):
        graph, on_flap = with_flap(2, length)
        std_m = deviations(graph)
        assert np.median(std_m[on_flap]) > 1.6 * np.median(std_m[: len(PLATE)])
        found_m.append(np.median(std_m[on_flap]))
    assert found_m[0] < found_m[1] < found_m[2]


def test_deviations_grow_with_the_errors_of_pairs() -> None:
    graph, on_flap = with_flap(2)
    weak, strong = (
        deviations(replace(graph, variance_m2=np.full(len(graph.pairs), std_m**2)))[on_flap]
        for std_m in (0.002, 0.008)
    )
    np.testing.assert_allclose(strong / weak, 4.0, rtol=0.1)  # but for what is always unsure


def test_an_error_where_much_hangs_on_it_counts_most() -> None:
    """The same worse pairs on the neck move the flap; at the far end of the plate they move little."""
    graph, on_flap = with_flap(3)
    u = np.arange(len(graph))
    left = graph.xyz_m[:, 0][graph.pairs].max(axis=1) < 4 * STEP_M
    neck = (u[graph.pairs] >= len(PLATE) + 100).any(axis=1)
    usual, at_rim, at_neck = (
        np.median(deviations(replace(graph, variance_m2=np.where(worse, 100.0, 1.0) * 9e-8))[on_flap])
        for worse in (np.zeros_like(left), left, neck)
    )
    assert at_rim < 1.5 * usual
    assert at_neck > 3.0 * usual


def test_other_pieces_have_no_deviation() -> None:
    uv = np.concatenate([PLATE, grid(8, 8, (1.0, 0.0))])
    main = np.arange(len(uv)) < len(PLATE)
    std_m = deviations(exact_graph(uv), main)
    np.testing.assert_array_equal(np.isfinite(std_m), main)
    np.testing.assert_allclose(std_m[main], deviations(exact_graph(PLATE)), rtol=0.5)


def test_deviations_are_relative_to_the_reference() -> None:
    graph, on_flap = with_flap(2)
    std_m = deviations(graph, reference=on_flap)
    assert np.median(std_m[on_flap]) < 0.002 < np.median(std_m[: len(PLATE)])


def test_ripples_that_noise_took_make_lengths_less_sure() -> None:
    graph, on_flap = with_flap(2)
    laid = laid_out(graph, np.ones(len(graph.pairs), dtype=bool))
    every = np.zeros(len(graph), dtype=np.int32)
    smooth, rippled = (
        deviations_m(laid.at, graph, every, ripples=np.full(len(graph), ripples))[on_flap]
        for ripples in (0.0, 0.5)
    )
    assert (rippled > 2.0 * smooth).all()


def test_deviations_do_not_depend_on_how_the_cloth_lies_on_the_plane() -> None:
    graph, _ = with_flap(2)
    laid = replace(graph, offset_m=graph.offset_m * np.exp(1.0j))
    np.testing.assert_allclose(deviations(laid), deviations(graph), rtol=1e-6)
