"""Live mode, headless: the playhead, the loop behind it, and what tabs are sent."""

from __future__ import annotations

import functools
import threading
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from page_tabs import WAIT_S, Tab
from viewer_fakes import CylinderIntegration, CylinderPlayer, MemoryFolder, point_on_cylinder

from flatcloth.cli import main
from flatcloth.core.errors import FlatteningError
from flatcloth.viewer.modes.live import LiveApplication
from flatcloth.viewer.modes.player import Playhead, RateMeter, ticks_due
from flatcloth.viewer.server.app import PageServer
from flatcloth.viewer.server.workspace import Opened

STILL = 1e-4
"""Frames a second: the clock does not tick while a test runs."""
FAST = 200.0


# --- the playhead ----------------------------------------------------------------------------------


def test_frames_go_to_the_end_and_back_and_none_is_shown_twice_in_a_row():
    head = Playhead(n_frames=4, fps=30)
    frames = [head.advanced(i).frame for i in range(9)]
    assert frames == [0, 1, 2, 3, 2, 1, 0, 1, 2]
    assert [head.advanced(i).forward for i in range(7)] == [True] * 3 + [False] * 3 + [True]


@given(st.integers(1, 40), st.integers(0, 200), st.integers(-5, 50))
def test_by_hand_any_frame_is_reached_and_the_direction_kept(n_frames, ticks, frame):
    head = Playhead(n_frames=n_frames, fps=30).advanced(ticks)
    there = head.at(frame)
    assert there.frame == min(max(frame, 0), n_frames - 1)
    if 0 < there.frame < n_frames - 1:
        assert there.forward == head.forward
    turned = there.turned(not there.forward)
    assert turned.frame == there.frame
    if 0 < there.frame < n_frames - 1:
        assert turned.forward is not there.forward


def test_a_slow_clock_reader_misses_ticks():
    assert ticks_due(9.99, 10.0, 30) == 0
    assert ticks_due(10.0, 10.0, 30) == 1
    assert ticks_due(10.11, 10.0, 30) == 4


def test_the_rate_is_that_of_the_last_second():
    meter = RateMeter()
    assert meter.count(0.0) == 0
    for i in range(1, 100):
        rate = meter.count(0.05 * i)
    assert rate == pytest.approx(20)


# --- the server ------------------------------------------------------------------------------------


@pytest.fixture
def integration():
    return CylinderIntegration()


@pytest.fixture
def player(integration):
    return CylinderPlayer(integration)


def played(integration, player, fps: float) -> Opened:
    folder = MemoryFolder()
    return Opened(
        integration,
        folder,
        controller=functools.partial(LiveApplication, integration, folder, player=player, fps=fps),
    )


@pytest.fixture
def serve(integration, player):
    running: list[PageServer] = []

    def start(fps: float) -> PageServer:
        running.append(PageServer(played(integration, player, fps), port=0).start())
        return running[-1]

    yield start
    for server in running:
        server.stop()


class LiveTab(Tab):
    """A tab in live mode; draws, and acknowledges, only when told to."""

    def __init__(self, server: PageServer, layer: str = "color") -> None:
        super().__init__(server)
        self.layer = layer
        self.frames: list[dict] = []

    def ready(self):
        self.say(type="ready", layer=self.layer)

    def next(self):
        """Return the next message; frames are kept in ``frames``."""
        message = super().next()
        if message["type"] == "frame":
            self.frames.append(message)
        return message

    def until_told(self, text):
        """Read until the log has a text, which may have come before the last message."""

        def is_told(_message=None):
            return any(text in note["text"] for note in self.state.get("log", ()))

        if not is_told():
            self.until(is_told)

    def frame(self):
        return self.until(lambda m: m["type"] == "frame")

    def frame_where(self, found):
        """Draw and acknowledge frames until one is what is looked for."""
        self.ready()
        while not found(frame := self.frame()):
            self.ready()
        return frame


def test_frames_come_with_all_that_both_sides_need(serve):
    server = serve(STILL)
    with LiveTab(server) as tab:
        frame = tab.frame_where(lambda _: True)
        # It was told before or after the frame.
        state = tab.state if tab.state["layers"] else tab.state_where(lambda s: s["layers"])
    assert frame["view_index"] == state["present_view"] == 0
    assert frame["flatten_ms"] == 12.5
    grid = frame["grid"]
    assert frame["image"].shape == (grid["rows"], grid["cols"], 4)
    assert state["mode"] == "live"
    assert state["live"] == {"playing": True, "forward": True, "fps": STILL}
    position = server._now.scene._frustum.position
    np.testing.assert_allclose(position, 0, atol=1e-9)


def test_without_masks_the_side_is_looked_for_and_the_frame_is_flattened_again(serve, integration, player):
    found, strokes = threading.Event(), []

    def segment(asked):
        strokes.append(asked)
        assert found.wait(WAIT_S)
        return SimpleNamespace(segmentation=SimpleNamespace(text="Side of interest: 7 cm2 seen."))

    integration.views.sides, integration.views.segment = object(), segment
    with LiveTab(serve(STILL)) as tab:
        tab.frame_where(lambda _: True)
        tab.until_told("the whole item is shown")
        tab.say(type="play", playing=False)
        tab.state_where(lambda s: not s["live"]["playing"])
        before = len(player.shown)
        found.set()
        tab.frame_where(lambda f: f["sequence"] > before)
        tab.until_told("7 cm2")
    assert player.shown[before:] == [player.shown[before - 1]]  # paused: the same frame, with its mask
    assert strokes == [()]


def test_a_slow_tab_skips_frames_and_nothing_is_queued(serve, player):
    with LiveTab(serve(STILL)) as tab:
        tab.frame_where(lambda f: f["view_index"] == 0)
        # Not acknowledged: one frame more is flattened ahead, and no other.
        tab.say(type="play", frame=3)
        player.wait_for(2)
        for frame in (4, 5, 6):
            tab.say(type="play", frame=frame)
        tab.say(type="set", follow=False)
        tab.state_where(lambda s: not s["settings"]["follow"]["value"])
        assert player.shown == [0, 3]
        assert len(tab.frames) == 1
        assert tab.frame_where(lambda _: True)["view_index"] == 3
        assert tab.frame_where(lambda _: True)["view_index"] == 6
    assert player.shown == [0, 3, 6]


def test_a_pause_holds_and_frames_go_both_ways_by_hand(serve, player):
    with LiveTab(serve(FAST)) as tab:
        tab.frame_where(lambda f: f["sequence"] > 2)
        tab.say(type="play", playing=False)
        tab.say(type="play", frame=8)
        tab.frame_where(lambda f: f["view_index"] == 8)
        tab.ready()
        count = len(player.shown)
        tab.say(type="set", follow=False)
        tab.state_where(lambda s: not s["settings"]["follow"]["value"])
        assert len(player.shown) == count
        for step, view in ((-1, 7), (-1, 6), (1, 7)):
            tab.say(type="play", step=step)
            assert tab.frame()["view_index"] == view
            tab.ready()
        tab.say(type="play", frame=0)
        assert tab.frame()["view_index"] == 0
        tab.say(type="play", forward=False, playing=True)
        state = tab.state_where(lambda s: s["live"]["playing"])
    assert state["live"]["forward"]  # at the first frame there is only one way


def test_the_rate_and_the_direction_are_set(serve):
    with LiveTab(serve(STILL)) as tab:
        tab.say(type="play", frame=5)
        tab.say(type="play", fps=7.5)
        tab.say(type="play", forward=False)
        state = tab.state_where(lambda s: not s["live"]["forward"])
    assert state["live"] == {"playing": False, "forward": False, "fps": 7.5}


def test_a_frame_without_cloth_is_empty_and_says_why(serve, player):
    player.errors[3] = FlatteningError("View 3 shows too little cloth.")
    with LiveTab(serve(STILL)) as tab:
        tab.say(type="play", frame=3)
        frame = tab.frame_where(lambda f: f["view_index"] == 3)
        assert frame["reason"] == "View 3 shows too little cloth."
        assert frame["grid"] is None
        assert frame["image"] is None
        tab.say(type="pick", u_m=0.0, v_m=0.1, revision=frame["sequence"])
        assert "no cloth" in tab.until(lambda m: m["type"] == "note")["text"]
        tab.say(type="play", frame=4)
        assert tab.frame_where(lambda f: f["view_index"] == 4)["grid"] is not None


def test_an_unexpected_error_is_told_and_pauses(serve, player, caplog):
    player.errors[1] = ZeroDivisionError("division by zero")
    with LiveTab(serve(FAST)) as tab:
        tab.ready()
        state = tab.until(lambda m: tab.ready() or (m["type"] == "state" and bool(m["log"])))
        assert "division by zero" in state["log"][-1]["text"]
        assert not state["live"]["playing"]
        tab.say(type="play", frame=6)
        assert tab.frame_where(lambda f: f["view_index"] == 6)["grid"] is not None


def test_a_click_pauses_and_picks_on_the_frame_that_was_seen(serve):
    with LiveTab(serve(FAST)) as tab:
        seen = tab.frame_where(lambda f: f["sequence"] > 4)
        u, v = seen["grid"]["origin_uv_m"]
        u, v = u + 15 * seen["grid"]["pixel_size_m"], v + 0.1
        tab.say(type="pick", u_m=u, v_m=v, revision=seen["sequence"])
        state = tab.state_where(lambda s: s["pick"])
        other = 5 if seen["view_index"] != 5 else 6
        for view in (other, seen["view_index"]):
            tab.say(type="play", frame=view)
            frame = tab.frame_where(lambda f, view=view: not f["playing"] and f["view_index"] == view)
    assert not state["live"]["playing"]
    assert state["present_view"] == seen["view_index"]
    np.testing.assert_allclose(state["pick"]["uv_m"], (u, v), atol=0.003)
    assert state["pick"]["view_index"] == seen["view_index"]
    np.testing.assert_allclose(state["pick"]["position_held_m"], point_on_cylinder(u, v)[0], atol=0.004)
    np.testing.assert_allclose(frame["pick_uv_m"], (u, v), atol=0.003)


def test_a_click_in_the_scene_pauses_and_picks(serve):
    server = serve(FAST)
    with LiveTab(server) as tab:
        tab.frame_where(lambda f: f["sequence"] > 2)
        tab.say(type="play", frame=0)
        tab.frame_where(lambda f: f["view_index"] == 0)
        tab.say(type="play", playing=True, fps=STILL)
        tab.state_where(lambda s: s["live"]["playing"])
        target, _ = point_on_cylinder(0.02, 0.15)
        server.application.click_ray((0.0, 0.0, 0.0), tuple(target))
        state = tab.state_where(lambda s: s["pick"])
    assert not state["live"]["playing"]
    np.testing.assert_allclose(state["pick"]["uv_m"], (0.02, 0.15), atol=0.006)


def test_every_tab_gets_its_own_layer(serve):
    server = serve(STILL)
    with LiveTab(server, "stretch") as one, LiveTab(server, "density") as two:
        legends = [t.frame_where(lambda _: True)["legend"]["title"] for t in (one, two)]
        assert legends == ["Stretch (%)", "Density (px/cm²)"]
        one.layer = "color"
        assert one.frame_where(lambda _: True)["legend"]["kind"] == "none"


def test_nobody_looking_means_no_work_and_the_next_tab_goes_on(serve, player):
    server = serve(FAST)
    with LiveTab(server) as tab:
        tab.frame_where(lambda f: f["sequence"] > 2)
    with LiveTab(server) as tab:
        assert tab.frame_where(lambda f: f["sequence"] > 5)["grid"]


def test_stopping_ends_all_threads(integration, player):
    with PageServer(played(integration, player, FAST), port=0) as server:
        tab = LiveTab(server)
        tab.frame_where(lambda f: f["sequence"] > 2)
        tab.ready()
    with tab:  # the server has left it in the middle of playing
        pass
    left = {t.name for t in threading.enumerate()}
    assert not left & {"flatcloth-live", "flatcloth-read", "flatcloth-show", "flatcloth-session"}


def test_a_rate_without_live_is_refused(capsys):
    assert main(["view", "shirt-sleeve-clean", "--fps", "10"]) == 2
    assert "--live" in capsys.readouterr().err
    for rate in ("0", "nan", "x"):
        with pytest.raises(SystemExit):
            main(["view", "shirt-sleeve-clean", "--live", "--fps", rate])
