from dataclasses import fields, replace

import numpy as np
from scenes import AXIS, CAMERA, box, frame, plane

from flatcloth.core.config import FlatteningConfig, SurfaceConfig
from flatcloth.core.types import FlattenedView
from flatcloth.flattening.flatten import flatten
from flatcloth.flattening.surface import observe_item

ATTRIBUTES = [field.name for field in fields(FlattenedView)]


def flattened() -> FlattenedView:
    depth = plane()
    surface = observe_item(frame(depth, box(0.05, depth)), AXIS, SurfaceConfig())
    return flatten(surface, AXIS, FlatteningConfig()).view


def assert_same(view: FlattenedView, other: FlattenedView) -> None:
    for name in ATTRIBUTES:
        np.testing.assert_array_equal(getattr(view, name), getattr(other, name))


def test_normals_and_quality_of_a_sloping_plane_are_exact() -> None:
    depth = plane(0.5, -0.3)
    view = flatten(
        observe_item(frame(depth, box(0.05, depth)), AXIS, SurfaceConfig()), AXIS, FlatteningConfig()
    ).view
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


def test_a_copy_with_another_attribute_has_all_others() -> None:
    view = flattened()
    half = view.valid & (np.arange(view.shape[1]) % 2 == 0)
    copy = replace(view, valid=half)
    assert copy.valid is half
    assert_same(replace(copy, valid=view.valid), view)
