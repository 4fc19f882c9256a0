"""Where a noisy view shows the outline of its cloth next to another layer, whose depth may be mixed in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import AXIS, frame, plane

from flatcloth.core.config import SurfaceConfig
from flatcloth.core.types import Bool
from flatcloth.flattening.surface import observe_surface
from flatcloth.methods.robust.uncertainty import _layer_rims

EDGE = 120
"""The first column of the sheet; another layer ends where it begins."""


def rims_beside(layer_m: float) -> tuple[Bool, Bool]:
    """Return the rims (H, W) of a sheet at 0.85 m whose left outline is beside a layer, and its pixels."""
    depth, columns = plane(), np.arange(240)
    own = np.zeros(depth.shape, dtype=np.bool_)
    own[40:200, EDGE:200] = True
    beside = (columns >= 60) & (columns < EDGE)
    shown = np.where(own, depth, np.where(beside, layer_m, np.nan))
    surface = observe_surface(frame(shown, own), AXIS, SurfaceConfig())
    assert surface.usable[100, EDGE + 1]
    of_item = np.where(own | (beside & (layer_m > 0.85)), np.float32(1.0), np.float32(0.0))
    return _layer_rims(replace(surface, noisy=True, inverse_depth=of_item)), surface.usable


@pytest.mark.parametrize("layer_m", [0.82, 0.88])
def test_the_rim_is_the_outline_beside_the_layer_as_wide_as_depths_are_mixed(layer_m: float) -> None:
    rims, usable = rims_beside(layer_m)
    first = int(np.flatnonzero(usable[100])[0])
    np.testing.assert_array_equal(np.flatnonzero(rims[100]), first + np.arange(4))
    assert not rims[~usable].any()
    assert not rims[:, first + 6 :].any()  # other outlines, beside which nothing lies


def test_the_rim_around_a_single_pixel_of_another_layer_is_round() -> None:
    depth = plane()
    own = np.zeros(depth.shape, dtype=np.bool_)
    own[40:200, 40:200] = True
    surface = observe_surface(frame(depth, own), AXIS, SurfaceConfig())
    nearer, usable = surface.frame.depth_m.copy(), surface.usable.copy()
    nearer[60, 80], usable[60, 80] = 0.82, False
    rims = _layer_rims(
        replace(surface, noisy=True, usable=usable, frame=replace(surface.frame, depth_m=nearer))
    )
    row, col = np.indices(usable.shape)
    around = np.hypot(row - 60, col - 80)
    np.testing.assert_array_equal(rims, (around <= 4.0) & (around > 0))


def test_a_layer_that_is_hardly_nearer_or_farther_makes_no_rim() -> None:
    for layer_m in (0.843, 0.857):
        assert not rims_beside(layer_m)[0].any()
