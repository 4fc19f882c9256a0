"""Grips and exports of the page's server, headless."""

from __future__ import annotations

import io
import json
import shutil
import threading
import time
import zipfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import pytest
from exported_sessions import serving, write_cylinder, write_session
from page_tabs import WAIT_S, Tab, get, post

from flatcloth.cli import main
from flatcloth.core.errors import CancelledError
from flatcloth.export import by_name
from flatcloth.export.session import OpenedSession
from flatcloth.viewer.routes import exports
from flatcloth.viewer.server.app import PageServer


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("server")
    return write_session(folder / "session", write_cylinder(folder / "recording"))


@pytest.fixture
def place(written: Path, tmp_path: Path) -> Path:
    """A session of its own, for a test that changes it."""
    return Path(shutil.copytree(written, tmp_path / "session"))


@pytest.fixture
def server(written: Path, place: Path) -> Iterator[PageServer]:
    with serving(place, written.parent / "recording") as running:
        yield running


@pytest.fixture(scope="module")
def unchanged(written: Path) -> Iterator[PageServer]:
    with serving(written, written.parent / "recording") as running:
        yield running


def shown(tab: Tab) -> dict:
    """Wait for the shape, then show the first pick and return its numbers."""
    tab.state_where(lambda s: s["layers"])
    tab.say(type="show_pick", id=1)
    return tab.state_where(lambda s: s["pick"])["pick"]


def test_a_grip_that_is_none_is_told_and_changes_nothing(server: PageServer, place: Path) -> None:
    before = (place / "grips.json").read_bytes()
    with Tab(server) as tab:
        shown(tab)
        for wrong, cause in (
            ({"id": 1, "opening_m": 2.0}, "A gripper opens 5 to 300 mm"),
            ({"id": 3, "axis_deg": 10.0}, "too little cloth"),  # the pick that is not on the shape
            ({"id": 99, "opening_m": 0.05}, "no longer in the list"),
            ({"id": 1, "axis_deg": "steep"}, "at `$.axis_deg`"),
        ):
            tab.say(type="grip", **wrong)
            assert cause in tab.note()["text"]
    assert (place / "grips.json").read_bytes() == before


def test_a_deleted_pick_takes_its_grip_along(server: PageServer, place: Path) -> None:
    with Tab(server) as tab:
        shown(tab)
        tab.say(type="delete_pick", id=1)
        tab.state_where(lambda s: len(s["picks"]) == 2)
    assert json.loads((place / "grips.json").read_text())["grips"] == {}


def test_the_data_are_those_of_the_command_line_with_the_scores_of_decisions_by_hand(
    unchanged: PageServer, written: Path, tmp_path: Path
) -> None:
    main(["export", str(written), "--data", str(tmp_path)])
    by_hand = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with zipfile.ZipFile(io.BytesIO(get(unchanged, "/export/data.zip", timeout=120).content)) as archive:
        assert {name: archive.read(name) for name in archive.namelist()} == by_hand
    assert set(by_hand) >= {"flattened.npz", "flattened.png", "cloud.ply", "grasps.json", "outcome.json"}
    accepted = json.loads(by_hand["outcome.json"])["accepted"]
    assert len(accepted) == 2
    assert all(0.0 < view["score"] <= 1.0 and not view["by_hand"] for view in accepted)
    single = get(unchanged, "/export/cloud.ply", timeout=120)
    assert single.content == by_hand["cloud.ply"]
    assert single.headers["content-disposition"].endswith('-cloud.ply"')
    missing = get(unchanged, "/export/floating-1.npz", timeout=120)
    assert (missing.status_code, missing.text) == (409, "This session has no floating-1.npz.")
    assert get(unchanged, "/export/floating-0.npz").status_code == 404


def test_an_export_that_does_not_exist_is_one_line(server: PageServer) -> None:
    unknown = get(server, "/export/shirt.exe", timeout=120)
    assert unknown.status_code == 404
    assert "choose one of page.html" in unknown.text
    assert "\n" not in unknown.text


# --- one at a time --------------------------------------------------------------------------------


@pytest.fixture
def slow_export(monkeypatch: pytest.MonkeyPatch) -> Iterator[SlowExport]:
    slow = SlowExport()
    made = by_name.made

    def slowly(session: OpenedSession, name: str) -> bytes:
        return slow(session) if name == "outline.svg" else made(session, name)

    monkeypatch.setattr(exports, "made", slowly)
    yield slow
    slow.gate.set()


class SlowExport:
    """An export that takes until its gate is opened, looking now and then whether it is still wanted."""

    def __init__(self) -> None:
        self.gate, self.begun = threading.Event(), threading.Event()
        self.ended: str = ""
        self.threads: list[str] = []

    def __call__(self, session: OpenedSession) -> bytes:
        self.threads.append(threading.current_thread().name)
        self.begun.set()
        try:
            while not self.gate.wait(0.02):
                session.progress(0.5, "drawing")
        except CancelledError:
            self.ended = "was cancelled"
            raise
        self.ended = "made"
        return b"<svg/>"


def test_a_second_export_waits_for_its_turn_and_too_many_are_refused(
    unchanged: PageServer, slow_export: SlowExport, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(exports, "MOST_WAITING", 2)
    with ThreadPoolExecutor(2) as pool:
        first = pool.submit(get, unchanged, "/export/outline.svg", 120)
        assert slow_export.begun.wait(WAIT_S)
        second = pool.submit(get, unchanged, "/export/outline.svg", 120)
        until = time.monotonic() + WAIT_S
        while unchanged._now.exports.waiting < 2:
            assert time.monotonic() < until
            time.sleep(0.02)
        third = get(unchanged, "/export/outline.json")
        assert (third.status_code, "Too many exports wait" in third.text) == (429, True)
        # Nothing else waits for them.
        assert get(unchanged, "/start/places.json").status_code == 200
        slow_export.gate.set()
        assert first.result().content == second.result().content == b"<svg/>"
    assert get(unchanged, "/export/outline.json", timeout=120).status_code == 200
    assert all(name.startswith("flatcloth-export") for name in slow_export.threads)


def test_an_export_is_given_up_when_its_client_leaves(unchanged: PageServer, slow_export: SlowExport) -> None:
    with pytest.raises(httpx.ReadTimeout):
        get(unchanged, "/export/outline.svg", timeout=1.0)
    until = time.monotonic() + WAIT_S
    while not slow_export.ended:
        assert time.monotonic() < until
        time.sleep(0.02)
    assert slow_export.ended == "was cancelled"
    answer = get(unchanged, "/export/outline.json", timeout=120)
    while answer.status_code == 429:
        answer = get(unchanged, "/export/outline.json", timeout=120)
    assert answer.status_code == 200


def test_a_hand_eye_file_that_the_page_sends_gives_poses_in_the_robots_frame(server: PageServer) -> None:
    matrix = [[1, 0, 0, 0.5], [0, 1, 0, 0], [0, 0, 1, 0.2], [0, 0, 0, 1]]
    wrong = (b"no json", 400, "malformed"), (b"{}", 409, "no format"), (b"x" * 10**5, 400, "longer")
    for content, status, said in wrong:
        refused = post(server, "/hand-eye", content=content)
        assert (refused.status_code, said in refused.json()["error"]) == (status, True)
    file = {"format": "flatcloth-hand-eye/1", "base_from_camera": matrix}
    with Tab(server) as tab:
        tab.state_where(lambda s: s["layers"])  # the session that was opened is drawn
    assert post(server, "/hand-eye", content=json.dumps(file).encode()).status_code == 200
    assert get(server, "/export/grasps.json").json()["base_from_camera"] == matrix
