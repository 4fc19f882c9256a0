"""Where a view shows a known node, which nodes it adds, and what it says of pairs."""

from dataclasses import replace

import numpy as np
import pytest
from made_up_sheets import STILL, grid, nodes_at, observed
from scenes import AXIS, CAMERA, Cylinder, box, frame, placed_view, plane, rays

from flatcloth.core.config import FlatteningConfig
from flatcloth.core.errors import SurfaceError
from flatcloth.core.geometry import Rigid3, project
from flatcloth.flattening.surface import NOISELESS_STD_M, Surface
from flatcloth.shape.graph import graph_of
from flatcloth.shape.observations import (
    FRONTAL_NOISE,
    Nodes,
    Observation,
    PlacedView,
    associate,
    averaged,
    observe,
    observe_all,
)

INTERVAL_PX = FlatteningConfig().sampling_intervals_px[-1]
OFF_M = 0.001
SLOPE = 1.0


NO_NODES = Nodes(xyz_m=np.zeros((0, 3)), normal=np.zeros((0, 3)), weight=np.zeros(0))


def seen_alone(surface: Surface) -> Observation:
    return observe(NO_NODES, associate(NO_NODES, surface, STILL), surface, STILL, INTERVAL_PX)[1]


def test_the_error_of_a_noisy_view_moves_no_node_along_steep_cloth() -> None:
    depth = plane(slope_x=SLOPE)
    surface = placed_view(frame(depth, box(0.06, depth))).surface
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


def test_a_view_that_shows_one_place_alone_is_no_view_of_the_shape() -> None:
    depth = plane()
    surface = placed_view(frame(depth, box(0.06, depth))).surface
    usable = np.zeros_like(surface.usable)
    row, col = (int(at) // INTERVAL_PX * INTERVAL_PX + INTERVAL_PX // 2 for at in (CAMERA.cy, CAMERA.cx))
    usable[row, col] = True
    alone = replace(surface, usable=usable)
    with pytest.raises(SurfaceError, match=r"View \d+: it shows no two places of cloth side by side"):
        seen_alone(alone)
    assert len(seen_alone(surface).edges)
    other = replace(surface, frame=replace(surface.frame, view_index=7))
    views = [PlacedView(surface=each, object_from_camera=STILL) for each in (alone, other)]
    assert [seen.view_index for seen in observe_all(views, INTERVAL_PX).observations] == [7]


def test_cloth_that_a_view_knows_from_another_gets_no_second_nodes() -> None:
    cylinder = Cylinder(angles_deg=(0.0, 30.0))
    seen = observe_all([placed_view(cylinder[n]) for n in range(2)], INTERVAL_PX)
    flat = cylinder.flat_uv_m(seen.nodes.xyz_m)
    apart = np.linalg.norm(flat[:, None] - flat, axis=2) + np.eye(len(flat))
    assert (apart.min(axis=1) < 0.004).mean() < 0.05  # nodes are 12 mm apart, fewer where a view ends
    assert seen.observations[1].is_new.mean() == pytest.approx(30.0 / 144.0, rel=0.2)  # of what it shows
    shared = np.intersect1d(seen.observations[0].node, seen.observations[1].node)
    assert len(shared) > 100


def test_the_ways_between_nodes_of_a_cylinder_are_those_of_the_cloth_unrolled() -> None:
    cylinder = Cylinder(angles_deg=(0.0,), radius_m=0.05)
    surface = placed_view(cylinder[0]).surface
    nodes, seen = observe(NO_NODES, associate(NO_NODES, surface, STILL), surface, STILL, INTERVAL_PX)
    graph, _ = graph_of(nodes, [seen], [STILL])
    arm = nodes.xyz_m - AXIS.point_m
    flat = np.stack([np.arctan2(arm[:, 0], -arm[:, 2]) * 0.05, arm[:, 1]], axis=1)
    well = np.asarray((np.abs(flat) < (0.05, 0.08)).all(axis=1))
    inner = well[graph.pairs].all(axis=1)
    true = (flat[graph.pairs[:, 1]] - flat[graph.pairs[:, 0]]) @ np.array([1.0, 1j])
    off_m = np.abs(graph.offset_m - true[:, None])[inner]
    assert inner.sum() > 100
    assert np.abs(true[inner]).mean() > 0.008
    assert np.percentile(off_m, 95) < 0.0002
    assert np.percentile(np.abs(graph.length_m - np.abs(true))[inner], 95) < 0.0002


def test_pairs_across_a_crease_are_a_quarter_of_the_evidence() -> None:
    """Touching layers look like a crease."""
    x, _ = rays()
    depth = plane() - 0.4 * np.abs(x) * 0.85
    seen = seen_alone(placed_view(frame(depth, box(0.1, depth))).surface)
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
    surface = placed_view(frame(depth, box(0.06, depth))).surface
    seen = seen_alone(replace(surface, noisy=True, noise_m=0.001))
    slope = np.tan(np.radians(seen.incidence_deg))[seen.edges]
    assert np.ptp(slope) > 0.05
    noise_m = 0.001 * (FRONTAL_NOISE + np.square(slope).mean(axis=1))
    np.testing.assert_allclose(seen.edge_std_m, np.hypot(NOISELESS_STD_M, noise_m), rtol=1e-5)


def test_frontal_views_count_most_in_the_mean_of_a_node() -> None:
    """Weights are the squared cosine of the incidence: at 60 degrees a quarter of a frontal view's."""
    uv = grid(4, 5)
    everything = np.ones(len(uv), dtype=bool)
    nodes = nodes_at(uv)
    shifted = Rigid3(np.eye(3), np.array([0.0, 0.0, 0.005]))
    after = averaged(nodes, observed(uv, everything, 1, incidence_deg=60.0), shifted)
    moved = np.tile([0.0, 0.0, 0.001], (len(uv), 1))
    np.testing.assert_allclose(after.xyz_m - nodes.xyz_m, moved, atol=1e-12)
    np.testing.assert_allclose(after.weight, 1.25)
