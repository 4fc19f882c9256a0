"""Where a view shows a known node: at its foot on exact surfaces, on its ray where depth is noisy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import AXIS, CAMERA, box, frame, plane, rays

from flatcloth.core.config import FlatteningConfig, SurfaceConfig
from flatcloth.core.errors import SurfaceError
from flatcloth.core.geometry import Rigid3, project
from flatcloth.flattening.surface import NOISELESS_STD_M, observe_surface
from flatcloth.methods.robust.observations import (
    FRONTAL_NOISE,
    Association,
    Nodes,
    _in_narrow_places,
    associate,
    no_nodes,
    observe,
)

STILL = Rigid3(np.eye(3), np.zeros(3))
NO_ASSOCIATION = Association(node=np.zeros(0, dtype=np.int32), rc=np.zeros((0, 2)), incidence_deg=np.zeros(0))
OFF_M = 0.001
SLOPE = 1.0


def test_the_error_of_a_noisy_view_moves_no_node_along_steep_cloth() -> None:
    depth = plane(slope_x=SLOPE)
    surface = observe_surface(frame(depth, box(0.06, depth)), AXIS, SurfaceConfig())
    inner = np.argwhere(surface.usable)[::37]
    inner = inner[(np.abs(inner - [CAMERA.cy, CAMERA.cx]) < 20).all(axis=1)]
    own = surface.xyz_m[inner[:, 0], inner[:, 1]].astype(float)
    normal = surface.normal[inner[:, 0], inner[:, 1]].astype(float)
    # What the view measures is off along its rays: the nodes are where the cloth truly is.
    nodes = Nodes(xyz_m=own * (1.0 + OFF_M / own[:, 2:]), normal=normal, weight=np.ones(len(own)))
    noisy = associate(nodes, replace(surface, noisy=True, noise_m=0.001), STILL)
    assert len(noisy.node) == len(inner) > 20
    np.testing.assert_allclose(noisy.rc, inner, atol=1e-3)
    # Without noise the node itself may be off: it is where the surface is nearest.
    exact = associate(nodes, surface, STILL)
    foot = nodes.xyz_m - ((nodes.xyz_m - own) * normal).sum(axis=1)[:, None] * normal
    np.testing.assert_allclose(exact.rc, project(foot[exact.node], CAMERA), atol=0.02)
    moved_px = np.abs(exact.rc - inner[exact.node]).max()
    assert moved_px > 0.4 * OFF_M * CAMERA.fx / own[:, 2].max() * SLOPE / (1.0 + SLOPE**2)


@pytest.mark.parametrize("width", [3, 5, 7])
def test_the_nodes_of_a_strip_lie_in_its_middle_first(width: int) -> None:
    usable = np.zeros((40, 120), dtype=np.bool_)
    usable[20 : 20 + width] = True
    row, col = _in_narrow_places(usable, 6, np.zeros((0, 2))).T
    middle = 20 + width // 2
    assert (row == middle).sum() >= 120 // 3 - 1
    assert np.ptp(col[row == middle]) > 110
    inner = (col > 10) & (col < 110)  # the ends of the strip are outlines, too
    assert ((row == middle) | (np.abs(row - middle) >= 3))[inner].all()


def test_no_strip_of_the_surface_is_too_narrow_for_nodes() -> None:
    """Two areas joined by 1 to 3 pixels, wherever these lie between the nodes of a grid, and known cloth."""
    for width in (1, 2, 3):
        for row in range(30, 36):
            usable = np.zeros((66, 100), dtype=np.bool_)
            usable[10:56, :30] = usable[10:56, 70:] = True
            usable[row : row + width, 30:70] = True
            known = np.argwhere(usable[::6, ::6]).astype(float) * 6
            known = known[(known[:, 1] < 30) | (known[:, 1] >= 70)]
            places = _in_narrow_places(usable, 6, known)
            at = places.astype(int)
            assert usable[at[:, 0], at[:, 1]].all()
            along = np.sort(places[(places[:, 1] >= 30) & (places[:, 1] < 70), 1])
            assert along[0] < 34
            assert along[-1] > 65
            assert np.diff(along).max() <= 5  # pairs are as long as 1.5 times half the interval
            between = np.abs(places[:, None] - places).max(axis=2) + 99 * np.eye(len(places))
            assert between.min() >= 3
            assert np.linalg.norm(places[:, None] - known, axis=2).min() > 0.8 * 3


def test_a_view_that_shows_one_place_alone_is_no_view_of_the_shape() -> None:
    depth = plane()
    surface = observe_surface(frame(depth, box(0.06, depth)), AXIS, SurfaceConfig())
    alone = np.zeros_like(surface.usable)
    d = FlatteningConfig().sampling_intervals_px[-1]
    row, col = (int(at) // d * d + d // 2 for at in (CAMERA.cy, CAMERA.cx))
    alone[row, col] = True
    with pytest.raises(SurfaceError, match=r"View \d+: it shows no two places of cloth side by side"):
        observe(no_nodes(), NO_ASSOCIATION, replace(surface, usable=alone), STILL, FlatteningConfig())
    _, seen = observe(no_nodes(), NO_ASSOCIATION, surface, STILL, FlatteningConfig())
    assert len(seen.edges)


def test_pairs_across_a_crease_are_a_quarter_of_the_evidence() -> None:
    """Touching layers look like a crease."""
    x, _ = rays()
    depth = plane() - 0.4 * np.abs(x) * 0.85
    surface = observe_surface(frame(depth, box(0.1, depth)), AXIS, SurfaceConfig())
    _, seen = observe(no_nodes(), NO_ASSOCIATION, surface, STILL, FlatteningConfig())
    left = seen.points_m[:, 0][seen.edges]
    across = left.prod(axis=1) < 0.0
    far = (np.abs(left) > 0.02).all(axis=1) & ~across
    share = seen.edge_evidence * np.square(seen.edge_std_m / NOISELESS_STD_M)
    assert across.sum() > 10
    assert far.sum() > 50
    np.testing.assert_allclose(share[across], 0.25, rtol=1e-5)
    np.testing.assert_allclose(share[far], 1.0, rtol=1e-5)


def test_lengths_of_steep_noisy_cloth_are_as_unsure_as_the_square_of_the_slope() -> None:
    depth = plane(slope_x=0.5)
    surface = observe_surface(frame(depth, box(0.06, depth)), AXIS, SurfaceConfig())
    noisy = replace(surface, noisy=True, noise_m=0.001)
    _, seen = observe(no_nodes(), NO_ASSOCIATION, noisy, STILL, FlatteningConfig())
    slope = np.tan(np.radians(seen.incidence_deg))[seen.edges]
    assert np.ptp(slope) > 0.05
    noise_m = 0.001 * (FRONTAL_NOISE + np.square(slope).mean(axis=1))
    np.testing.assert_allclose(seen.edge_std_m, np.hypot(NOISELESS_STD_M, noise_m), rtol=1e-5)
