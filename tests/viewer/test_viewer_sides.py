"""The page's side of segmentation, without a page: what is shown before the labels are known."""

from __future__ import annotations

import threading
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scenes import Cylinder

from flatcloth.core.errors import FlatclothError
from flatcloth.engine.integration import Integration
from flatcloth.session.document import Document
from flatcloth.viewer.modes.sides import SideController
from flatcloth.viewer.protocol.messages import StrokeImage
from flatcloth.viewer.worker import Executor


def test_a_stroke_beside_the_image_is_no_decision() -> None:
    integration = Integration(
        Cylinder(angles_deg=(0.0, 20.0), masks=False), segmenter=lambda _views, _progress: None
    )
    sides = SideController(cast("Any", SimpleNamespace(integration=integration, executor=None)))
    camera = integration.recording.intrinsics
    for points in (((-5.0, 3.0),), ((3.0, camera.width + 9.0),), ((camera.height + 1.0, 3.0),)):
        with pytest.raises(FlatclothError, match="outside the image of view 1"):
            sides.decision(StrokeImage(side="this", view_index=1, points_rc=points, radius_m=0.01), None)
    on = StrokeImage(side="this", view_index=1, points_rc=((-5.0, 3.0), (5.0, 3.0)), radius_m=0.01)
    assert sides.decision(on, None).points_rc == on.points_rc


def test_the_cloud_of_the_first_view_is_shown_while_the_sides_are_looked_for() -> None:
    looking, shown, failed = threading.Event(), [], threading.Event()

    def observe(_views, _progress):
        looking.wait(10.0)
        raise RuntimeError("not in this test")

    integration = Integration(Cylinder(angles_deg=(0.0, 20.0), masks=False), segmenter=observe)
    executor = Executor(lambda job: job())
    seen = threading.Event()

    def see(xyz, rgb, *, anew):
        shown.append((xyz, rgb))
        seen.set()

    page = SimpleNamespace(
        integration=integration, executor=executor, publish=failed.set, scene=SimpleNamespace(see=see)
    )
    sides = SideController(cast("Any", page))
    try:
        sides.look_first()
        sides.follow(Document())
        assert seen.wait(10.0)
        assert not failed.is_set()  # still looking
        (xyz, rgb) = shown[0]
        assert len(xyz) == len(rgb) > 100
        expected = integration.views.cloud(0)
        np.testing.assert_array_equal(xyz, expected.xyz_m)
    finally:
        looking.set()
        assert failed.wait(10.0)
        executor.stop()
