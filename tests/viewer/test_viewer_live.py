"""The page of a camera, headless: which frames are flattened, and picks on them."""

from __future__ import annotations

import functools
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from page_tabs import Tab, get, get_frame
from scene_camera import SceneCamera, opened
from viewer_fakes import CylinderCamera, CylinderIntegration

from flatcloth.core.errors import FlatteningError
from flatcloth.viewer.modes.capture import CaptureApplication, CaptureSettings, LiveFrames, Shown
from flatcloth.viewer.server.app import PageServer
from flatcloth.viewer.server.workspace import Opened

# --- the frames -------------------------------------------------------------------------------------


@pytest.fixture
def camera() -> CylinderCamera:
    return CylinderCamera(CylinderIntegration())


@pytest.fixture
def frames(camera: CylinderCamera) -> LiveFrames:
    return LiveFrames(camera.newest)


def after(frames: LiveFrames, sequence: int) -> Shown:
    shown = frames.after(sequence)
    assert shown is not None
    return shown


def test_a_frame_is_flattened_when_somebody_wants_a_newer_one(
    frames: LiveFrames, camera: CylinderCamera
) -> None:
    assert camera.asked == 0
    first = after(frames, 0)
    assert first.picture is not None
    assert frames.after(0) is first  # another tab gets the same
    assert after(frames, first.sequence).sequence > first.sequence
    assert camera.asked == 2


def test_a_held_frame_stays_until_it_goes_on(frames: LiveFrames, camera: CylinderCamera) -> None:
    seen, later = after(frames, 0), after(frames, 1)
    held = frames.hold(seen.sequence)
    assert held.picture.view is seen.picture.view
    assert frames.after(later.sequence) is held  # who saw a later one gets it again
    assert frames.after(held.sequence) is None
    assert camera.asked == 2
    with ThreadPoolExecutor(1) as tab:
        waiting = tab.submit(after, frames, held.sequence)
        time.sleep(0.05)
        frames.play()
        assert waiting.result().sequence > held.sequence


def test_a_frame_without_cloth_is_empty_and_says_why_and_an_unexpected_error_also_pauses(
    frames: LiveFrames, camera: CylinderCamera
) -> None:
    no_item = FlatteningError("The camera sees no item to flatten.")
    for error, pauses in ((no_item, False), (ZeroDivisionError("division by zero"), True)):
        camera.errors[camera.asked] = error
        empty = after(frames, camera.asked)
        assert empty.picture is None
        assert str(error) in empty.reason
        assert frames.playing is not pauses
        frames.play()
        assert after(frames, empty.sequence).picture is not None


# --- the page ---------------------------------------------------------------------------------------


@pytest.fixture
def server(tmp_path: Path) -> Iterator[PageServer]:
    feed, integration, session = opened(SceneCamera(), tmp_path / "session")
    settings = CaptureSettings(folder=tmp_path / "coat")
    controller = functools.partial(CaptureApplication, integration, session, feed=feed, settings=settings)
    with PageServer(Opened(integration, session, controller=controller), port=0) as running:
        yield running
    session.close()
    left = {t.name for t in threading.enumerate()}
    assert not left & {"flatcloth-background", "flatcloth-session"}


def test_a_click_pauses_and_picks_on_the_frame_that_was_seen(server: PageServer) -> None:
    with Tab(server) as tab:
        seen = get_frame(server)
        later = get_frame(server, seen["sequence"])
        grid = seen["grid"]
        cloth = np.argwhere(seen["image"][..., 3] > 0)
        row, col = cloth[len(cloth) // 2]
        u, v = np.array(grid["origin_uv_m"]) + np.array([col, row]) * grid["pixel_size_m"]
        tab.say(type="pick", u_m=float(u), v_m=float(v), revision=seen["sequence"])
        state = tab.state_where(lambda s: s["pick"])
        assert not state["capture"]["playing"]
        np.testing.assert_allclose(state["pick"]["uv_m"], (u, v), atol=0.003)
        held = get_frame(server, later["sequence"])
        np.testing.assert_allclose(held["pick_uv_m"], (u, v), atol=0.003)
        assert get(server, f"/capture/frame/{held['sequence']}").status_code == 204
        tab.say(type="play", playing=True)
        assert tab.state_where(lambda s: s["capture"]["playing"])


def test_a_click_in_the_scene_pauses_and_picks(server: PageServer) -> None:
    with Tab(server) as tab:
        get_frame(server)
        tab.say(type="play", playing=False)
        tab.state_where(lambda s: not s["capture"]["playing"])
        server.application.click_ray((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
        state = tab.state_where(lambda s: s["pick"])
    assert state["pick"]["position_held_m"][2] > 0.3
