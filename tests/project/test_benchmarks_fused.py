"""The peer that fuses first is given a fair chance: exact meshes come out flat, the right way round."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("igl")

from benchmarks.fused import Mesh, boundaries, cleaned, unwrap
from benchmarks.problems import signed_areas
from flatcloth.core.types import Float64, Int64

SIDE = 21


def bent_sheet() -> tuple[Float64, Int64]:
    """A sheet bent to a third of a cylinder, seen from outside by a camera that looks along z."""
    v, u = (axis.ravel() for axis in np.mgrid[0 : 0.2 : SIDE * 1j, 0 : 0.2 : SIDE * 1j])
    angle = (u - 0.1) / 0.1
    points = np.stack([0.1 * np.sin(angle), v, 1.0 - 0.1 * np.cos(angle)], axis=1)
    corner = np.arange(SIDE * SIDE).reshape(SIDE, SIDE)
    a, b, c, d = (x.ravel() for x in (corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:]))
    triangles = np.concatenate([np.stack([a, c, b], axis=1), np.stack([b, c, d], axis=1)])
    return points, triangles.astype(np.int64)


def test_a_bent_sheet_comes_out_flat_and_not_mirrored() -> None:
    mesh = cleaned(*bent_sheet())
    uv = unwrap(mesh)
    assert (signed_areas(uv, mesh.triangles) < 0).all()  # anticlockwise from outside, with v down
    found = np.linalg.norm(uv[:, None] - uv, axis=-1)
    x, v, _ = mesh.points_m.T  # cleaning renumbers them
    flat = np.stack([0.1 * np.arcsin(x / 0.1), v], axis=1)
    true = np.linalg.norm(flat[:, None] - flat, axis=-1)
    np.testing.assert_allclose(found, true, atol=5e-4)


def test_the_largest_piece_is_kept_and_made_a_manifold() -> None:
    points, triangles = bent_sheet()
    fin = [[0, 1, len(points)]]  # a second triangle above the rim; and a far triangle of its own
    far = len(points) + 1 + np.arange(3)
    more = np.array([[0.0, -0.02, 0.9], [1.0, 1.0, 1.0], [1.1, 1.0, 1.0], [1.0, 1.1, 1.0]])
    mesh = cleaned(np.concatenate([points, more]), np.concatenate([triangles, fin, [far]]))
    assert isinstance(mesh, Mesh)
    assert mesh.points_m[:, 0].max() < 0.5
    assert boundaries(mesh) == 1
