"""A camera looks for the loop when the item hangs still; an unplugged one is told, nothing is lost."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from cells import led, loop_in, seen, sheet_cell

from flatcloth.active.eye import CameraEye
from flatcloth.cameras.base import CameraError, CameraFrame
from flatcloth.cameras.capture import LEAST_FRAMES
from flatcloth.cameras.feed import CameraFeed


class FakeCamera:
    """A camera before a cell; ten frames a second by its own clock, delivered at once."""

    name, notes, fps, depth_scale_m = "fake", (), 10.0, 0.0001

    def __init__(self, cell) -> None:
        self._cell, self.intrinsics = cell, cell.intrinsics
        self._views: dict[float, tuple] = {}
        self.angle_deg, self.time_s, self.plugged = 0.0, 0.0, True

    def read(self) -> CameraFrame:
        time.sleep(0.002)
        if not self.plugged:
            raise CameraError("fake: it was unplugged. Plug it in again.")
        self.time_s += 0.1
        if self.angle_deg not in self._views:
            view = self._cell.look(self.angle_deg, 0)
            units = np.rint(view.depth_units * (self._cell.depth_scale_m / self.depth_scale_m))
            self._views[self.angle_deg] = (view.color, units.astype(np.uint16))
        color, units = self._views[self.angle_deg]
        return CameraFrame(time_s=self.time_s, color=color, depth_units=units)

    def measure(self, on: bool) -> None:
        pass

    def close(self) -> None:
        pass


@pytest.fixture
def camera(tmp_path: Path):
    return FakeCamera(sheet_cell(tmp_path / "cell"))


def test_it_looks_when_the_item_hangs_still(camera: FakeCamera) -> None:
    feed = CameraFeed(camera)
    feed.start()
    eye = CameraEye(feed, LEAST_FRAMES)
    for number, angle in enumerate((0.0, 60.0)):
        camera.angle_deg = angle
        view = eye(angle, number)
        right = camera._cell.look(angle, 0)
        assert view.angle_deg == angle
        both = (view.depth_m > 0) & (right.depth_units > 0)
        off = np.abs(view.depth_m - right.depth_units * np.float32(0.0001))[both]
        assert both.sum() > 0.9 * (right.depth_units > 0).sum()
        assert np.median(off) < 0.001
        assert view.mask is None
    feed.stop(1.0)


def test_a_camera_that_is_unplugged_is_told_and_views_stay(camera: FakeCamera, tmp_path: Path) -> None:
    loop = led(loop_in(tmp_path / "out"), camera._cell, most=2)
    feed = CameraFeed(camera)
    feed.start()
    eye = CameraEye(feed, LEAST_FRAMES)
    camera.plugged = False
    with pytest.raises(CameraError, match=r"it was unplugged\. .* Views that were taken are on disk"):
        eye(60.0, 2)
    assert loop.views == 2
    loop.take(seen(camera._cell, 200.0, 2))
    assert loop.views == 3
    loop.close()
    feed.stop(1.0)
