"""Guided capture in a real browser, with a scene as the camera."""

from __future__ import annotations

import functools
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import Tab  # type: ignore[attr-defined]  # mypy takes the conftest of tests/

sys.path.append(str(Path(__file__).parents[1]))

from scene_camera import SceneCamera, opened

from flatcloth.recordings import open_recording
from flatcloth.viewer.modes.capture import CaptureApplication, CaptureSettings
from flatcloth.viewer.server.app import PageServer
from flatcloth.viewer.server.workspace import Opened

pytestmark = pytest.mark.browser


@pytest.fixture
def camera() -> SceneCamera:
    return SceneCamera()


@pytest.fixture
def tab(flat_chromium, camera: SceneCamera, tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Tab]:
    feed, integration, session = opened(camera, tmp_path / "session")
    settings = CaptureSettings(folder=tmp_path / "coat")
    controller = functools.partial(CaptureApplication, integration, session, feed=feed, settings=settings)
    with PageServer(Opened(integration, session, controller=controller)) as server:
        page = flat_chromium.new_page(viewport={"width": 1280, "height": 720})
        tab = Tab(page, server.url, has_scene=False)
        yield tab
        tab.shoot(f"last-{request.node.name}-0")
        page.close()
    session.close()
    assert tab.errors == []


def test_views_are_captured_turn_by_turn(tab: Tab, camera: SceneCamera, tmp_path: Path) -> None:
    tab.until("flatcloth.state?.capture && flatcloth.layerRevision > 0")
    page = tab.page
    assert page.locator("#capture-task").inner_text() == "Hang the item in sight, then begin."
    tab.shoot("capture-idle")
    page.get_by_role("button", name="Begin capture").click()
    tab.until("flatcloth.state.capture.phase === 'review'")
    page.wait_for_function("document.querySelector('.capture-picture')?.naturalWidth === 480")
    assert "Keep view 0 at 0°?" in page.locator("#capture-task").inner_text()
    tab.shoot("capture-review")

    page.keyboard.press("j")
    tab.until("flatcloth.state.capture.phase !== 'review'")
    tab.until("flatcloth.state.capture.phase === 'review' && flatcloth.state.capture.view.number === 2")
    page.keyboard.press("m")
    tab.until("flatcloth.state.capture.phase === 'turn'")
    assert open_recording(tmp_path / "coat").angles_deg == (0.0,)  # on disk before the next
    assert page.locator("#capture-task").inner_text() == "Turn by 10°, to 10°."
    assert "to the right" in page.locator("#capture-way").inner_text()
    tab.shoot("capture-turn")

    camera.turn_to(12.0)
    tab.until("flatcloth.state.capture.phase === 'review'")
    page.locator("#capture-view input").fill("12")
    page.keyboard.press("Enter")
    tab.until("flatcloth.state.capture.target_deg === 12")
    page.get_by_role("button", name="Keep").click()
    tab.until("flatcloth.state.views.length === 2 && flatcloth.state.capture.phase === 'turn'")
    assert page.locator("#timeline .view").count() == 2
    page.get_by_role("button", name="Finish").click()
    tab.until("flatcloth.state.capture.phase === 'done'")
    assert open_recording(tmp_path / "coat").angles_deg == (0.0, 12.0)
    tab.shoot("capture-done")
