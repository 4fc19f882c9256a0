"""The canonical view of two views of a cylinder: every pixel from the view that saw it best."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import AXIS, CAMERA, Cylinder, box, frame, plane

from flatcloth.core.config import FlatteningConfig, SurfaceConfig
from flatcloth.core.geometry import object_from_camera
from flatcloth.core.types import FlattenedView
from flatcloth.flattening.surface import observe_surface
from flatcloth.methods.robust.compositing import _Canvas, _composite, _PlacedView, composite, pixel_cost
from flatcloth.methods.robust.joint import begin_joint, extend_joint
from flatcloth.methods.robust.joint_shape import JointShape
from flatcloth.methods.robust.observations import FRONTAL_NOISE, associate
from flatcloth.methods.robust.uncertainty import MOST_STD_M, with_placement_std

ANGLES = (0.0, 30.0)
PIXEL_M = 0.002
CYLINDER = Cylinder(angles_deg=ANGLES)
SURFACES = {n: observe_surface(CYLINDER[n], AXIS, SurfaceConfig()) for n in range(2)}
COSTS = {n: pixel_cost(surface) for n, surface in SURFACES.items()}


@pytest.fixture(scope="module")
def shape() -> JointShape:
    flat = CYLINDER.flat_uv_m(SURFACES[0].xyz_m.astype(float))
    first = begin_joint(SURFACES[0], object_from_camera(AXIS, 0.0), flat, FlatteningConfig())
    pose = object_from_camera(AXIS, 30.0)
    shown = associate(first.nodes, SURFACES[1], pose)
    return extend_joint(first, SURFACES[1], pose, FlatteningConfig(), shown)


@pytest.fixture(scope="module")
def view(shape: JointShape) -> FlattenedView:
    return composite(shape, SURFACES, AXIS, 6, PIXEL_M, COSTS)


def test_each_pixel_lies_where_its_cloth_belongs(view: FlattenedView) -> None:
    true = CYLINDER.flat_uv_m(view.xyz_m[view.valid].astype(float))
    found = view.uv_from_rc(np.argwhere(view.valid))
    off = np.linalg.norm(found - true, axis=1)
    assert np.median(off) < 0.0005
    assert np.percentile(off, 99) < 0.002


def test_each_pixel_comes_from_the_view_that_looks_at_it_more_squarely(view: FlattenedView) -> None:
    """Turned by 30 degrees, the views look equally at what lies 15 degrees to the left."""
    around = CYLINDER.flat_uv_m(view.xyz_m.astype(float))[..., 0] / 0.12
    inner = view.valid & (np.abs(np.degrees(around) + 15.0) < 30.0) & (np.abs(view.xyz_m[..., 1]) < 0.07)
    clear = inner & (np.abs(np.degrees(around) + 15.0) > 4.0)
    expected = np.where(np.degrees(around) < -15.0, 1, 0)
    assert (view.view_index[clear] == expected[clear]).mean() > 0.99
    assert set(np.unique(view.view_index[inner])) == {0, 1}


def test_what_is_read_is_what_the_image_shows_there(view: FlattenedView) -> None:
    rows, cols = np.nonzero(view.valid)
    for row, col in zip(rows[::911], cols[::911], strict=True):
        r, c = np.rint(view.source_rc[row, col]).astype(int)
        recorded = CYLINDER[int(view.view_index[row, col])]
        near = recorded.color[max(r - 1, 0) : r + 2, max(c - 1, 0) : c + 2, 0].astype(int)
        assert near.min() - 1 <= int(view.rgb[row, col, 0]) <= near.max() + 1


@pytest.mark.parametrize(
    ("node_std_m", "shown_m"), [(0.005, 0.005), (MOST_STD_M, MOST_STD_M), (0.3, MOST_STD_M)]
)
def test_what_does_not_float_is_no_less_sure_than_what_just_does(
    node_std_m: float, shown_m: float, shape: JointShape, view: FlattenedView
) -> None:
    std_m = np.full(len(shape.nodes), node_std_m)
    seen = with_placement_std(view, shape, std_m, SURFACES).placement_std_m
    assert seen is not None
    assert seen[view.valid] == pytest.approx(shown_m)
    assert np.isnan(seen[~view.valid]).all()


def test_nodes_without_a_place_are_not_drawn(shape: JointShape, view: FlattenedView) -> None:
    half = np.where(shape.uv_m[:, :1] < 0.0, np.nan, shape.uv_m)
    drawn = composite(shape, SURFACES, AXIS, 6, PIXEL_M, COSTS, half)
    assert drawn.uv_from_rc(np.argwhere(drawn.valid))[:, 0].min() > -0.012  # nearer to the others beyond
    assert 0.3 < drawn.area_m2 / view.area_m2 < 0.6


@pytest.mark.parametrize(("mirrored", "filled"), [(False, 11 * 11), (True, 4)])
def test_a_quad_is_filled_unless_it_is_mirrored(mirrored: bool, filled: int) -> None:
    """Four neighbouring pixels that come to lie 10 pixels apart; mirrored, they are drawn as points."""
    points = np.array([[[2.0, 3.0], [12.0, 3.0]], [[2.0, 13.0], [12.0, 13.0]]])
    points = points[:, ::-1].copy() if mirrored else points
    source, cost = np.full((20, 20, 2), np.nan, np.float32), np.full((20, 20), np.inf, np.float32)
    label = np.full((20, 20), -1, np.int16)
    whole, joined = np.ones((2, 2), bool), np.full((2, 2), 3, np.uint8)
    placed = _PlacedView(points, whole, joined, np.ones((2, 2), np.float32), 7)
    _composite(placed, _Canvas(source, cost, label))
    assert (label == 7).sum() == filled
    corner = source[3, 12 if mirrored else 2]
    np.testing.assert_allclose(corner, [0.0, 0.0], atol=1e-6)


def test_the_cost_is_the_noise_at_that_incidence() -> None:
    """Noise of a pair: a share seen frontally, and tan^2 of the incidence more; both fade in from the rim."""
    flat = plane(slope_x=0.5)
    surface = observe_surface(frame(flat, box(0.08, flat)), AXIS, SurfaceConfig())
    row, col = CAMERA.height // 2, CAMERA.width // 2
    offset = np.asarray(surface.frame.offset_rc)
    found = pixel_cost(surface)
    center = found[row - int(offset[0]), col - int(offset[1])]
    assert center == pytest.approx(FRONTAL_NOISE + 0.5**2, abs=0.02)
    assert np.isinf(found[~surface.usable]).all()
    assert found[surface.usable].max() > center + 1.0
