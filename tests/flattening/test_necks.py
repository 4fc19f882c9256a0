from __future__ import annotations

import numpy as np
import pytest
from scenes import AXIS, box, frame, plane, rays

from flatcloth.core.config import FlatteningConfig, SurfaceConfig
from flatcloth.flattening.flatten import Flattening, flatten
from flatcloth.flattening.surface import observe_item


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
