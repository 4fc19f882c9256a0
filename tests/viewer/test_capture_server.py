"""The page of a camera, headless: what tabs are told, and what a turntable may say over HTTP."""

import json
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import httpx
import numpy as np
import pytest
from page_tabs import WAIT_S, Tab, get, post
from scene_camera import SceneCamera, opened

from flatcloth.engine import live
from flatcloth.recordings import open_recording
from flatcloth.viewer.modes.capture import CaptureApplication, CaptureSettings
from flatcloth.viewer.server.app import PageServer
from flatcloth.viewer.server.workspace import Opened


def with_camera(integration, session, feed, settings) -> Opened:
    return Opened(
        integration,
        session,
        controller=partial(CaptureApplication, integration, session, feed=feed, settings=settings),
    )


@pytest.fixture
def camera() -> SceneCamera:
    return SceneCamera()


@pytest.fixture
def server(camera: SceneCamera, tmp_path: Path) -> Iterator[PageServer]:
    feed, integration, session = opened(camera, tmp_path / "session")
    settings = CaptureSettings(folder=tmp_path / "coat", frames=8)
    with PageServer(with_camera(integration, session, feed, settings)) as running:
        yield running
    session.close()
    assert camera.closed >= 1
    left = {t.name for t in threading.enumerate()}
    assert not left & {"flatcloth-background", "flatcloth-session"}


class Robot:
    """Talks HTTP, as a turntable's program does: the token, no cookie, no Origin."""

    def __init__(self, server: PageServer) -> None:
        self.server = server

    def post(self, word: str, content: Any = None) -> httpx.Response:
        body = content if isinstance(content, bytes) else json.dumps(content).encode()
        return post(self.server, f"/capture/{word}", content=body)

    def status(self) -> dict[str, Any]:
        return get(self.server, "/capture").json()

    def until(self, found: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        end = time.monotonic() + WAIT_S
        while not found(status := self.status()):
            assert time.monotonic() < end, status
            time.sleep(0.02)
        return status


def test_a_turntable_captures_a_turn_by_itself(
    server: PageServer, camera: SceneCamera, tmp_path: Path
) -> None:
    robot = Robot(server)
    assert robot.status()["phase"] == "idle"
    for n, angle in enumerate((0.0, 15.0, 30.0)):
        camera.turn_to(angle)
        answer = robot.post("angle", {"angle_deg": angle})
        assert answer.status_code == 200
        assert answer.json()["phase"] == "settle"
        status = robot.until(lambda s, n=n: len(s["kept_deg"]) == n + 1)  # type: ignore[misc]
        assert len(open_recording(tmp_path / "coat")) == n + 1  # it is on disk when it is told
        assert status["phase"] == "turn"
        assert status["announced"] is True
    assert robot.post("finish").json()["phase"] == "done"
    read = open_recording(tmp_path / "coat")
    assert read.angles_deg == (0.0, 15.0, 30.0)
    # What was announced is what was seen: the pattern moves to the right by 15 degrees of the cylinder.
    gray = [read[n].color[60:180, 60:180].mean(axis=2).astype(np.float32) for n in range(2)]
    (shift, _), _ = cv2.phaseCorrelate(gray[0] - gray[0].mean(), gray[1] - gray[1].mean())
    assert shift > 5


def test_an_announced_view_may_wait_for_the_operator(server: PageServer, tmp_path: Path) -> None:
    robot = Robot(server)
    assert robot.post("keep").status_code == 409
    robot.post("angle", {"angle_deg": 5, "keep": False})
    status = robot.until(lambda s: s["phase"] == "review")
    assert status["view"]["angle_deg"] == 5.0
    assert status["view"]["frames"] == 8
    refused = robot.post("angle", {"angle_deg": 10})
    assert (refused.status_code, "keep or repeat it first" in refused.json()["error"]) == (409, True)
    picture = get(server, "/capture/view.png")
    assert picture.headers["content-type"] == "image/png"
    shown = cv2.imdecode(np.frombuffer(picture.content, np.uint8), cv2.IMREAD_UNCHANGED)
    assert shown.shape == (240, 480, 4)  # color beside depth
    assert robot.post("repeat").json()["phase"] == "settle"
    robot.until(lambda s: s["phase"] == "review")
    assert robot.post("keep").json()["kept_deg"] == [5.0]
    again = robot.post("angle", {"angle_deg": 365})
    assert "already" in again.json()["error"]
    assert robot.post("finish").status_code == 200
    # Going on after the end appends to the same recording.
    assert robot.post("begin").json()["phase"] == "turn"
    assert len(open_recording(tmp_path / "coat")) == 1


NOT_UNDERSTOOD: list[tuple[str, Any, int, str]] = [
    ("angle", b"angle=5", 400, "JSON is malformed"),
    ("angle", {"angle_deg": "5"}, 400, "$.angle_deg"),
    ("angle", {"angle_deg": 5000}, 400, "<= 3600"),
    ("angle", b'{"keep": ' + b"[" * 9000, 400, "$.keep"),
    ("angle", b" " * 10_001, 400, "longer than 10000 bytes"),
    ("dance", {}, 404, "Unknown address /capture/dance"),
    ("finish", {}, 409, "No capture is running"),
]


def test_what_is_not_understood_is_refused_with_the_reason(server: PageServer) -> None:
    for word, content, code, error in NOT_UNDERSTOOD:
        answer = Robot(server).post(word, content)
        assert (answer.status_code, error in answer.json()["error"]) == (code, True), (word, error)


# --- tabs ------------------------------------------------------------------------------------------


def test_warnings_come_and_go(server: PageServer, camera: SceneCamera) -> None:
    robot = Robot(server)
    with Tab(server):
        camera.empty = True
        status = robot.until(lambda s: s["warnings"])
        assert status["warnings"][0].startswith("No depth is measured")
        camera.empty = False
        robot.until(lambda s: not s["warnings"])
        assert robot.status()["camera_fps"] > 5


def test_a_camera_that_is_unplugged_is_told_and_keeps_what_is_on_disk(
    server: PageServer, camera: SceneCamera, tmp_path: Path
) -> None:
    robot = Robot(server)
    with Tab(server) as tab:
        robot.post("angle", {"angle_deg": 0})
        robot.until(lambda s: s["kept_deg"])
        camera.unplug()
        robot.until(lambda s: s["ended"])
        tab.state_where(lambda s: any("delivers no images any more" in n["text"] for n in s["log"]))
        refused = robot.post("angle", {"angle_deg": 10})
        assert (refused.status_code, "no images" in refused.json()["error"]) == (503, True)
        assert robot.post("finish").status_code == 200
    assert len(open_recording(tmp_path / "coat")) == 1


# --- the command line ------------------------------------------------------------------------------


def test_a_capture_is_checked_while_it_goes_on(tmp_path: Path) -> None:
    camera = SceneCamera()
    camera.depth_scale_m = 0.0001  # the camera says so, and means a thousandth
    feed, integration, session = opened(camera, tmp_path / "session")
    settings = CaptureSettings(folder=tmp_path / "coat", frames=8)
    with PageServer(with_camera(integration, session, feed, settings)) as server:
        robot = Robot(server)
        for n in range(6):
            camera.turn_to(15.0 * n)
            assert robot.post("angle", {"angle_deg": 15.0 * n}).status_code == 200
            robot.until(lambda s, n=n: len(s["kept_deg"]) == n + 1)  # type: ignore[misc]
        told = robot.until(lambda s: any("another unit" in text for text in s["warnings"]))
        assert any("--depth-factor 10" in text for text in told["warnings"])
    session.close()


def next_frame(tab: Tab, *, sees: str = "") -> dict[str, Any]:
    """Say that the frame shown is drawn, and return the next one with cloth, or without for a reason."""
    before = tab.state["layers"] and tab.state["layers"]["revision"]
    if before:
        tab.say(type="drawn", revision=before)
    state = tab.state_where(
        lambda s: sees in s["trouble"] if sees else s["layers"] and s["layers"]["revision"] != before
    )
    return state["layers"]


def test_a_frame_without_cloth_says_why_and_an_unexpected_error_also_holds_it(
    server: PageServer, camera: SceneCamera, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Tab(server) as tab:
        tab.state_where(lambda s: s["layers"])
        for breaks, told, plays in (
            (lambda: setattr(camera, "empty", True), "sees no item", True),
            (lambda: monkeypatch.setattr(live, "check_frame", lambda _: 1 / 0), "division by zero", False),
        ):
            breaks()
            assert next_frame(tab, sees=told) is None
            assert Robot(server).status()["playing"] is plays
            camera.empty = False
            assert next_frame(tab) if plays else True


def test_a_frame_is_made_when_a_tab_has_drawn_the_one_before(server: PageServer) -> None:
    with Tab(server) as tab:
        first = tab.state_where(lambda s: s["layers"])["layers"]["revision"]
        other_seconds = time.monotonic() + 1.0
        while time.monotonic() < other_seconds:
            assert tab.next()["layers"]["revision"] == first
        assert next_frame(tab)["revision"] == first + 1


def test_a_click_pauses_and_picks_on_the_frame_that_was_seen(server: PageServer) -> None:
    with Tab(server) as tab:
        seen = tab.state_where(lambda s: s["layers"])["layers"]
        image = cv2.imdecode(
            np.frombuffer(get(server, f"/layers/{seen['revision']}/color.png").content, np.uint8),
            cv2.IMREAD_UNCHANGED,
        )
        later = next_frame(tab)
        cloth = np.argwhere(image[..., 3] > 0)
        row, col = cloth[len(cloth) // 2]
        u, v = np.array(seen["origin_uv_m"]) + np.array([col, row]) * seen["pixel_size_m"]
        tab.say(type="pick", u_m=float(u), v_m=float(v), revision=seen["revision"])
        state = tab.state_where(lambda s: s["pick"])
        assert not state["capture"]["playing"]
        np.testing.assert_allclose(state["pick"]["uv_m"], (u, v), atol=0.003)
        assert state["layers"]["revision"] == seen["revision"] < later["revision"]
        tab.say(type="play", playing=True)
        assert tab.state_where(lambda s: s["layers"]["revision"] > later["revision"])["capture"]["playing"]
