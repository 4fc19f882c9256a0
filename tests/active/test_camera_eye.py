"""A camera looks for the loop when the item hangs still; an unplugged one is told, nothing is lost."""

from pathlib import Path

import numpy as np
import pytest
from cells import led, loop_in, seen, sheet_cell
from scene_camera import SceneCamera
from scenes import Cylinder

from flatcloth.active.eye import CameraEye
from flatcloth.cameras.base import CameraError
from flatcloth.cameras.capture import LEAST_FRAMES
from flatcloth.cameras.feed import CameraFeed


def test_it_looks_when_the_item_hangs_still_and_says_when_the_camera_is_gone(tmp_path: Path) -> None:
    camera = SceneCamera()
    feed = CameraFeed(camera)
    feed.start()
    eye = CameraEye(feed, LEAST_FRAMES)
    for number, angle in enumerate((0.0, 60.0)):
        camera.turn_to(angle)
        view, right = eye(angle, number), Cylinder(angles_deg=(angle,))[0].depth_m
        assert view.angle_deg == angle
        both = (view.depth_m > 0) & (right > 0)
        assert both.sum() > 0.9 * (right > 0).sum()
        assert np.median(np.abs(view.depth_m - right)[both]) < 0.001
        assert view.mask is None
    cell = sheet_cell(tmp_path / "cell")
    loop = led(loop_in(tmp_path / "out"), cell, most=2)
    camera.unplug()
    with pytest.raises(CameraError, match=r"delivers no images any more\. Views that were taken are on disk"):
        eye(60.0, 2)
    assert loop.views == 2
    loop.take(seen(cell, 200.0, 2))
    assert loop.views == 3
    loop.close()
    feed.stop(1.0)
