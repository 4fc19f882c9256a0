import numpy as np
import pytest
from scenes import AXIS, CAMERA, Cylinder, box, flattened, frame, plane, rays

from flatcloth.core.config import FlatteningConfig, SurfaceConfig
from flatcloth.core.errors import FlatteningError
from flatcloth.core.geometry import object_from_camera
from flatcloth.engine.evaluation import trimmed_fit
from flatcloth.flattening.flatten import Flattening, flatten
from flatcloth.flattening.sampling import path_on_surface
from flatcloth.flattening.surface import observe_item


@pytest.mark.parametrize("slope", [(0.0, 0.0), (0.9, 0.0), (-0.4, 0.6)])
def test_a_plane_keeps_its_distances(slope: tuple[float, float]) -> None:
    depth = plane(*slope)
    view = flattened(frame(depth, box(0.08, depth))).view
    uv = view.uv_from_rc(np.argwhere(view.valid))
    xyz = view.xyz_m[view.valid].astype(float)
    pair = np.random.default_rng(0).integers(0, len(uv), (2, 5000))
    flat = np.linalg.norm(uv[pair[0]] - uv[pair[1]], axis=1)
    space = np.linalg.norm(xyz[pair[0]] - xyz[pair[1]], axis=1)
    assert np.percentile(np.abs(flat - space), 99) < 2e-5
    assert np.abs(flat - space).max() < 1e-3


def test_normals_and_quality_of_a_sloping_plane_are_exact() -> None:
    depth = plane(0.5, -0.3)
    view = flattened(frame(depth, box(0.05, depth))).view
    normal = np.array([0.5, -0.3, -1.0]) / np.linalg.norm([0.5, -0.3, -1.0])
    np.testing.assert_allclose(view.normal[view.valid], np.tile(normal, (view.valid.sum(), 1)), atol=1e-4)
    at = view.xyz_m[view.valid].astype(float)
    cos = -(at @ normal) / np.linalg.norm(at, axis=1)
    density, incidence_deg, stretch = view.quality[view.valid].T
    np.testing.assert_allclose(incidence_deg, np.degrees(np.arccos(cos)), atol=0.05)
    # A pixel sees z^2 / (fx fy) of a frontal plane, and more of a sloping one, by the ray against its normal.
    towards = -(at @ normal) / at[:, 2]
    np.testing.assert_allclose(density, CAMERA.fx * CAMERA.fy * towards / (1e4 * at[:, 2] ** 2), rtol=1e-3)
    assert np.nanmax(stretch) < 0.01


def test_a_cylinder_unrolls_to_its_arc_length() -> None:
    cylinder = Cylinder()
    view = flattened(cylinder[0]).view
    uv = view.uv_from_rc(np.argwhere(view.valid))
    true = cylinder.flat_uv_m(view.xyz_m[view.valid].astype(float))
    error = np.linalg.norm(trimmed_fit(uv, true) - true, axis=1)
    assert np.sqrt(np.mean(error**2)) < 0.4e-3
    # Wider than the chord: it is unrolled, not projected.
    assert np.ptp(uv[:, 0]) > 1.25 * 2 * 0.12 * np.sin(np.radians(60))


def test_the_view_is_not_mirrored_and_keeps_the_image_directions() -> None:
    view = flattened(Cylinder()[0]).view
    rows, cols = np.nonzero(view.valid)
    source = view.source_rc[view.valid]
    assert np.corrcoef(cols, source[:, 1])[0, 1] > 0.9
    assert np.corrcoef(rows, source[:, 0])[0, 1] > 0.99


def test_every_pixel_is_linked_to_its_image_pixel_and_held_point() -> None:
    cylinder = Cylinder(angles_deg=(0.0, 40.0))
    view = flattened(cylinder[1]).view
    k, source = CAMERA, view.source_rc[view.valid]
    camera = object_from_camera(AXIS, 40.0).inverse().apply(view.xyz_m[view.valid])
    np.testing.assert_allclose(camera[:, 0] / camera[:, 2] * k.fx + k.cx, source[:, 1], atol=1e-3)
    np.testing.assert_allclose(camera[:, 1] / camera[:, 2] * k.fy + k.cy, source[:, 0], atol=1e-3)
    offset = view.xyz_m[view.valid] - AXIS.point_m
    np.testing.assert_allclose(np.hypot(offset[:, 0], offset[:, 2]), 0.12, atol=1e-3)
    np.testing.assert_allclose(np.linalg.norm(view.normal[view.valid], axis=1), 1.0, atol=1e-5)
    assert set(np.unique(view.view_index)) == {-1, 1}
    for array in (view.xyz_m, view.normal, view.z_angle_deg, view.source_rc):
        assert np.isnan(array[~view.valid]).all()


def test_colors_come_from_the_linked_pixel() -> None:
    shown = Cylinder()[0]
    view = flattened(shown).view
    source = np.rint(view.source_rc[view.valid]).astype(int)
    exact = shown.color[source[:, 0], source[:, 1], 0].astype(int)
    assert np.mean(np.abs(view.rgb[view.valid][:, 0] - exact) <= 3) > 0.75


def test_holes_and_necklines_stay_open() -> None:
    depth = plane()
    x, y = rays()
    mask = box(0.1, depth)
    hole = np.hypot(x * 0.85, y * 0.85) < 0.03
    neck = (np.abs(x * 0.85) < 0.03) & (y * 0.85 < -0.05)
    view = flattened(frame(depth, mask & ~hole & ~neck)).view
    place = view.xyz_m[view.valid]
    assert np.hypot(place[:, 0], place[:, 1]).min() > 0.029
    assert not ((np.abs(place[:, 0]) < 0.028) & (place[:, 1] < -0.052)).any()
    assert view.area_m2 == pytest.approx(0.04 - np.pi * 0.03**2 - 0.06 * 0.05, rel=0.06)


def test_separate_parts_are_flattened_each_on_its_own_largest_first() -> None:
    depth = plane()
    x, _ = rays()
    mask = box(0.1, depth)
    mask &= (x * 0.85 < 0.02) | (x * 0.85 > 0.05)
    result = flattened(frame(depth, mask))
    areas = [part.view.area_m2 for part in result.components]
    assert len(areas) == 2
    assert areas[0] == pytest.approx(0.12 * 0.2, rel=0.06)
    assert areas[1] == pytest.approx(0.05 * 0.2, rel=0.1)
    assert len(flattened(frame(depth, mask), min_area_m2=0.015).components) == 1


def test_the_pixel_size_is_metric_and_free_to_choose() -> None:
    depth = plane()
    shown = frame(depth, box(0.08, depth))
    coarse = flattened(shown, FlatteningConfig(pixel_size_m=0.004)).view
    fine = flattened(shown, FlatteningConfig(pixel_size_m=0.001)).view
    assert coarse.pixel_size_m == 0.004
    assert coarse.area_m2 == pytest.approx(fine.area_m2, rel=0.04)


def test_the_intermediates_of_both_levels_are_kept() -> None:
    result = flattened(Cylinder()[0], record=True)
    assert [level.sampling_interval_px for level in result.levels] == [12, 6]
    for level in result.levels:
        n = len(level.points_rc)
        assert level.initial_uv_m.shape == level.uv_m.shape == (n, 2)
        assert level.edges.max() < n
        assert level.edge_length_m.min() > 0
        assert level.energy[-1] <= level.energy[0]
        assert level.states
        assert level.states[0].shape == (len(level.state_members), 2)
    assert result.triangles.max() < len(result.levels[-1].points_rc)


def test_too_little_cloth_is_said() -> None:
    depth = plane()
    speck = np.zeros(depth.shape, dtype=bool)
    speck[100:104, 100:104] = True
    with pytest.raises(FlatteningError, match=r"View 3: .*too small.*another view"):
        flattened(frame(depth, speck, view_index=3))


@pytest.mark.parametrize("hole", [None, (2, 0), (3, 0), (2, 2)])
def test_a_straight_path_visits_every_pixel_between_its_ends(hole: tuple[int, int] | None) -> None:
    usable, steps = np.ones((5, 5), dtype=np.bool_), np.full((5, 5), 3, dtype=np.uint8)
    if hole is not None:
        usable[hole] = False
    rc = np.array([(0, 0), (4, 0), (4, 4), (0, 4)], dtype=np.int32)
    pairs = np.array([(0, 1), (1, 0), (0, 2), (2, 0), (2, 3)], dtype=np.int32)
    column, diagonal = hole is not None and hole[1] == 0, hole == (2, 2)
    blocked = [column, column, diagonal, diagonal, False]
    assert (~path_on_surface(usable, steps, rc, pairs)).tolist() == blocked


def hourglass(neck_m: float, least_core: int = 8) -> Flattening:
    """Two squares of 80 mm joined by a strip 30 mm long."""
    depth = plane()
    x, y = rays()[0] * 0.85, rays()[1] * 0.85
    mask = box(0.095, depth) & (np.abs(x) < 0.04) & ((np.abs(y) > 0.015) | (np.abs(x) < neck_m / 2))
    surface = observe_item(frame(depth, mask), AXIS, SurfaceConfig())
    return flatten(surface, AXIS, FlatteningConfig(least_core_samples=least_core))


def test_parts_joined_by_a_narrow_neck_are_flattened_apart() -> None:
    parts = hourglass(0.02).components
    assert len(parts) == 2
    for part in parts:
        xyz = part.view.xyz_m[part.view.valid]
        assert np.ptp(xyz[:, 1]) < 0.12  # none reaches through the neck
        assert part.view.area_m2 == pytest.approx(0.08 * 0.08, rel=0.15)
    level = hourglass(0.02).levels[-1]
    assert len(level.edges) == len(level.edge_length_m)
    a, b = level.component[level.edges].T
    assert (a == b).all()


def test_a_wide_neck_holds_and_zero_cuts_nothing() -> None:
    assert len(hourglass(0.06).components) == 1
    assert len(hourglass(0.02, least_core=0).components) == 1


def test_a_thin_strip_alone_is_one_part() -> None:
    depth = plane()
    mask = box(0.09, depth) & (np.abs(rays()[0] * 0.85) < 0.012)
    made = flatten(observe_item(frame(depth, mask), AXIS, SurfaceConfig()), AXIS, FlatteningConfig())
    assert len(made.components) == 1
    assert made.view.area_m2 == pytest.approx(0.024 * 0.18, rel=0.12)
