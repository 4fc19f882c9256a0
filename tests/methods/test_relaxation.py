"""As-rigid-as-possible relaxation against sheets whose places are known."""

from __future__ import annotations

import cmath

import numpy as np
import pytest

from flatcloth.core.geometry import fit_rigid2
from flatcloth.flattening.banded import BandedLaplacian, banding
from flatcloth.methods.relaxation import local_rotations, relax_rigidly

ROWS, COLS, SPACING_M = 7, 9, 0.01


def grid() -> tuple[np.ndarray, np.ndarray]:
    """Places u + iv of a grid, and its pairs: neighbours and diagonals."""
    row, col = np.mgrid[0:ROWS, 0:COLS].reshape(2, -1)
    near = [
        (a, b)
        for a in range(ROWS * COLS)
        for b in range(a + 1, ROWS * COLS)
        if abs(row[a] - row[b]) <= 1 and abs(col[a] - col[b]) <= 1
    ]
    return SPACING_M * (col + 1j * row), np.array(near, dtype=np.int32)


def seen(z: np.ndarray, edges: np.ndarray, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Offsets (M, 2) as each end sees the other, every node in a frame of its own; the frames' turns."""
    turn = np.exp(1j * random.uniform(-3, 3, len(z)))
    along = z[edges[:, 1]] - z[edges[:, 0]]
    return along[:, None] / turn[edges], turn


def test_turns_are_those_of_the_frames() -> None:
    z, edges = grid()
    offset, turn = seen(z, edges, np.random.default_rng(1))
    alike = np.ones(len(edges))
    np.testing.assert_allclose(local_rotations(z, edges, edges, offset, alike, len(z)), turn, atol=1e-12)
    turned = z * cmath.exp(0.7j)
    np.testing.assert_allclose(
        local_rotations(turned, edges, edges, offset, alike, len(z)), turn * cmath.exp(0.7j), atol=1e-12
    )
    unused = np.zeros(len(edges))
    assert not local_rotations(z, edges, edges, offset, unused, len(z)).any()


def test_a_sheet_that_was_shaken_comes_back_to_its_shape() -> None:
    random = np.random.default_rng(2)
    z, edges = grid()
    offset, _ = seen(z, edges, random)
    shaken = z + 0.003 * (random.standard_normal(len(z)) + 1j * random.standard_normal(len(z)))
    weight = np.ones(len(edges))
    found = relax_rigidly(shaken, edges, edges, offset, weight, len(z), 60, banding(len(z), edges))
    true = np.stack([z.real, z.imag], axis=1)
    before = np.stack([shaken.real, shaken.imag], axis=1)

    def off_m(places: np.ndarray) -> float:
        return float(np.abs(fit_rigid2(places, true).apply(places) - true).max())

    assert off_m(before) > 0.004
    assert off_m(found) < 1e-4
    np.testing.assert_allclose(found.mean(axis=0), before.mean(axis=0), atol=1e-9)


def test_held_nodes_stay_and_the_others_come_back_to_them() -> None:
    random = np.random.default_rng(4)
    z, edges = grid()
    offset, _ = seen(z, edges, random)
    shaken = z + 0.003 * (random.standard_normal(len(z)) + 1j * random.standard_normal(len(z)))
    held = np.arange(len(z)) % COLS < 4
    start, weight = np.where(held, z, shaken), np.ones(len(edges))
    found = relax_rigidly(start, edges, edges, offset, weight, len(z), 200, banding(len(z), edges), held)
    np.testing.assert_allclose(found, np.stack([z.real, z.imag], axis=1), atol=1e-4)
    np.testing.assert_allclose(found[held, 0], z.real[held], atol=1e-8)


@pytest.mark.parametrize("shuffled", [False, True])
def test_the_banded_laplacian_is_the_laplacian(shuffled: bool) -> None:
    random = np.random.default_rng(3)
    z, edges = grid()
    if shuffled:
        edges = random.permutation(len(z)).astype(np.int32)[edges]
    weight = random.uniform(0.1, 2.0, len(edges))
    matrix = 0.25 * np.eye(len(z))
    for (a, b), w in zip(edges, weight, strict=True):
        matrix[[a, b], [a, b]] += w
        matrix[[a, b], [b, a]] -= w
    rhs = random.standard_normal((len(z), 2))
    solved = BandedLaplacian(banding(len(z), edges), weight, 0.25).solve(rhs)
    np.testing.assert_allclose(matrix @ solved, rhs, atol=1e-9)
