from __future__ import annotations

from collections.abc import Iterable
from typing import cast

import numpy as np
import pytest
from plates import plate
from scenes import AXIS, Cylinder, frame

from flatcloth.cameras.feed import CameraFeed
from flatcloth.core.config import Config, FlatteningConfig, SurfaceConfig
from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import RgbdFrame
from flatcloth.engine.evaluation import trimmed_fit
from flatcloth.engine.integration import Integration
from flatcloth.engine.live import LiveFlattening
from flatcloth.flattening.flatten import flatten
from flatcloth.flattening.surface import observe_item

TURN = tuple(float(a) for a in range(0, 60, 5))


def flattening(frames: Iterable[RgbdFrame], config: Config | None = None) -> LiveFlattening:
    """What flattens the frames of a camera that sees these one after the other."""
    return LiveFlattening(Integration(Cylinder(), config), cast("CameraFeed", FramesOnly(frames)))


def test_the_plane_stands_still_while_the_item_turns() -> None:
    cylinder = Cylinder(angles_deg=TURN)
    live = flattening(cylinder[n] for n in range(len(TURN)))
    drift = []
    for _ in TURN:
        view = live.newest()
        flat = view.uv_from_rc(np.argwhere(view.valid))
        true = cylinder.flat_uv_m(view.xyz_m[view.valid].astype(float))
        error = np.linalg.norm(trimmed_fit(flat, true) - true, axis=1)
        assert np.percentile(error, 95) < 1e-3
        drift.append(np.median(flat - true, axis=0))
    # A cold start would move by a turn's arc, 10 mm, from frame to frame.
    assert np.linalg.norm(np.diff(drift, axis=0), axis=1).max() < 2e-3


def test_a_frame_without_cloth_is_an_error_and_the_next_one_starts_anew() -> None:
    cylinder = Cylinder(angles_deg=(0.0, 180.0, 10.0), span_deg=(-60.0, 60.0))
    live = flattening(cylinder[n] for n in range(3))
    live.newest()
    with pytest.raises(FlatclothError):
        live.newest()
    assert live.newest().valid.any()


def test_stretch_shows_where_cloth_that_is_no_developable_sheet_had_to_give() -> None:
    from scenes import rays

    x, y = rays()
    a, b = 1 + x * x + y * y, 0.85
    depth = (b - np.sqrt(np.maximum(b * b - a * (b * b - 0.12**2), 0))) / a  # a sphere
    mask = np.hypot(x, y) < 0.09
    surface = observe_item(frame(np.where(mask, depth, 0), mask), AXIS, SurfaceConfig())
    view = flatten(surface, AXIS, FlatteningConfig()).view
    assert np.median(view.quality[view.valid][:, 2]) > 0.01


def test_both_interpolations_agree_inside_and_the_smooth_one_reaches_further() -> None:
    surface = observe_item(Cylinder()[0], AXIS, SurfaceConfig())
    smooth = flatten(surface, AXIS, FlatteningConfig()).view
    linear = flatten(surface, AXIS, FlatteningConfig(interpolation="delaunay")).view
    assert smooth.area_m2 > 1.05 * linear.area_m2
    at = np.argwhere(linear.valid)
    rc = np.rint(smooth.rc_from_uv(linear.uv_from_rc(at))).astype(int)
    both = smooth.valid[rc[:, 0], rc[:, 1]]
    assert both.mean() > 0.99
    off = linear.xyz_m[at[both, 0], at[both, 1]] - smooth.xyz_m[rc[both, 0], rc[both, 1]]
    assert np.percentile(np.linalg.norm(off, axis=1), 95) < 1.5e-3


def test_a_camera_shows_the_item_without_the_gripper() -> None:
    (view,) = plate((0.0,), gripper=True)
    shown = flattening([view.frame]).newest()
    row, col = np.rint(shown.source_rc[shown.valid]).astype(int).T
    assert view.front[row, col].all()
    assert len(np.unique(row)) > 0.9 * view.front.any(axis=1).sum()


class FramesOnly:
    """A camera that sees these frames, one after the other."""

    camera = None

    def __init__(self, frames: Iterable[RgbdFrame]) -> None:
        self._frames = iter(frames)
        self.time_s = 0.0

    def newest(self, _than_s: float | None, _timeout_s: float) -> FramesOnly:
        self.frame = next(self._frames)
        return self

    def rgbd(self, _camera: object) -> RgbdFrame:
        return self.frame
