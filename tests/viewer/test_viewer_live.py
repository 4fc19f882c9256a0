"""The page of a camera, headless: which frames are flattened, which tabs get them, and picks on them."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from page_tabs import WAIT_S, Tab
from scene_camera import SceneCamera, opened
from viewer_fakes import CylinderCamera, CylinderIntegration

from flatcloth.core.errors import FlatteningError
from flatcloth.viewer.modes.capture import CaptureApplication, CaptureSettings
from flatcloth.viewer.modes.live import LiveLoop, Shown
from flatcloth.viewer.server.app import PageServer
from flatcloth.viewer.server.workspace import Opened

# --- the loop ---------------------------------------------------------------------------------------


class Tabs:
    """A loop with tabs that draw, and acknowledge, only when they are told to."""

    def __init__(self, camera: CylinderCamera) -> None:
        self.told: list[str] = []
        self._got: list[tuple[Shown, dict[int, str]]] = []
        self._changed = threading.Condition()
        self.loop = LiveLoop(camera.newest, deliver=self._deliver, report=self.told.append)
        self.loop.start()

    def _deliver(self, shown: Shown, tabs: dict[int, str]) -> None:
        with self._changed:
            self._got.append((shown, tabs))
            self._changed.notify_all()

    @property
    def frames(self) -> list[int]:
        """The sequences that were delivered."""
        return [shown.sequence for shown, _ in self._got]

    def frame(self, tab: int = 1, layer: str = "color") -> Shown:
        """Acknowledge as a tab, and return what it gets then."""
        before = len(self._got)
        self.loop.ready(tab, layer)
        with self._changed:
            assert self._changed.wait_for(lambda: len(self._got) > before, timeout=WAIT_S)
        shown, tabs = self._got[before]
        assert tabs == {tab: layer}
        return shown

    def frame_where(self, found: Callable[[Shown], Any]) -> Shown:
        while not found(shown := self.frame()):
            pass
        return shown


@pytest.fixture
def camera() -> CylinderCamera:
    return CylinderCamera(CylinderIntegration())


@pytest.fixture
def tabs(camera: CylinderCamera) -> Iterator[Tabs]:
    tabs = Tabs(camera)
    yield tabs
    tabs.loop.stop(timeout_s=WAIT_S)
    assert "flatcloth-live" not in {t.name for t in threading.enumerate()}


def test_a_slow_tab_skips_frames_and_nothing_is_queued(tabs: Tabs, camera: CylinderCamera) -> None:
    assert camera.asked == 0  # nobody looks
    first = tabs.frame()
    camera.wait_for(2)  # one frame more is flattened ahead, and no other
    tabs.loop.leave(2)
    assert tabs.frames == [first.sequence]
    assert tabs.frame().sequence == first.sequence + 1
    camera.wait_for(3)


def test_a_pause_holds_and_what_was_flattened_ahead_is_not_shown(tabs: Tabs, camera: CylinderCamera) -> None:
    seen = tabs.frame_where(lambda f: f.sequence > 2)
    camera.wait_for(seen.sequence + 1)
    held = tabs.loop.hold(seen.sequence)
    assert held is not None
    assert held.picture is not None
    assert seen.picture is not None
    assert held.picture.view is seen.picture.view
    count = camera.asked
    assert tabs.frame(layer="density").sequence == held.sequence  # another layer of the same frame
    assert camera.asked == count
    tabs.loop.play()
    assert tabs.frame(layer="density").sequence > held.sequence


def test_a_frame_without_cloth_is_empty_and_says_why(tabs: Tabs, camera: CylinderCamera) -> None:
    camera.errors[2] = FlatteningError("The camera sees no item to flatten.")
    empty = tabs.frame_where(lambda f: f.picture is None)
    assert empty.reason == "The camera sees no item to flatten."
    assert tabs.frame().picture is not None


def test_an_unexpected_error_is_told_and_pauses(
    tabs: Tabs, camera: CylinderCamera, caplog: pytest.LogCaptureFixture
) -> None:
    camera.errors[1] = ZeroDivisionError("division by zero")
    tabs.frame_where(lambda f: "division by zero" in f.reason)
    assert "division by zero" in tabs.told[0]
    assert not tabs.loop.playing
    tabs.loop.play()
    assert tabs.frame().picture is not None


def test_nobody_looking_means_no_work_and_the_next_tab_goes_on(tabs: Tabs, camera: CylinderCamera) -> None:
    seen = tabs.frame_where(lambda f: f.sequence > 2)
    tabs.loop.leave(1)
    assert tabs.frame(tab=2).sequence >= seen.sequence
    assert tabs.frame(tab=2).sequence > seen.sequence


# --- the page ---------------------------------------------------------------------------------------


@pytest.fixture
def server(tmp_path: Path) -> Iterator[PageServer]:
    feed, integration, session = opened(SceneCamera(fps=30.0), tmp_path / "session")
    settings = CaptureSettings(folder=tmp_path / "coat")
    controller = functools.partial(CaptureApplication, integration, session, feed=feed, settings=settings)
    with PageServer(Opened(integration, session, controller=controller), port=0) as running:
        yield running
    session.close()
    left = {t.name for t in threading.enumerate()}
    assert not left & {"flatcloth-live", "flatcloth-background", "flatcloth-session"}


def frame_of(tab: Tab, layer: str = "color") -> dict[str, Any]:
    tab.say(type="ready", layer=layer)
    return tab.until(lambda m: m["type"] == "frame" and m["grid"])


def test_every_tab_gets_its_own_layer(server: PageServer) -> None:
    with Tab(server) as one, Tab(server) as two:
        legends = [frame_of(one, "stretch")["legend"]["title"], frame_of(two, "density")["legend"]["title"]]
        assert legends == ["Stretch (%)", "Density (px/cm²)"]
        frame = frame_of(one)
    grid = frame["grid"]
    assert frame["legend"]["kind"] == "none"
    assert frame["image"].shape == (grid["rows"], grid["cols"], 4)


def test_a_click_pauses_and_picks_on_the_frame_that_was_seen(server: PageServer) -> None:
    with Tab(server) as tab:
        frame_of(tab)
        seen = frame_of(tab)
        grid = seen["grid"]
        row, col = np.argwhere(seen["image"][..., 3] > 0)[seen["image"][..., 3].astype(bool).sum() // 2]
        u, v = np.array(grid["origin_uv_m"]) + np.array([col, row]) * grid["pixel_size_m"]
        tab.say(type="pick", u_m=float(u), v_m=float(v), revision=seen["sequence"])
        state = tab.state_where(lambda s: s["pick"])
        assert not state["capture"]["playing"]
        np.testing.assert_allclose(state["pick"]["uv_m"], (u, v), atol=0.003)
        held = frame_of(tab, "density")
        np.testing.assert_allclose(held["pick_uv_m"], (u, v), atol=0.003)
        tab.say(type="play", playing=True)
        assert tab.state_where(lambda s: s["capture"]["playing"])


def test_a_click_in_the_scene_pauses_and_picks(server: PageServer) -> None:
    with Tab(server) as tab:
        frame_of(tab)
        tab.say(type="play", playing=False)
        tab.state_where(lambda s: not s["capture"]["playing"])
        server.application.click_ray((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
        state = tab.state_where(lambda s: s["pick"])
    assert state["pick"]["position_held_m"][2] > 0.3
