"""The start screen's server: what it offers, what it opens, and what it never opens."""

import gc
import json
import os
import threading
import time
import weakref
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
import pytest
from foreign_folders import write_open3d
from page_tabs import WAIT_S, Tab, get, post
from viewer_fakes import cylinder

from flatcloth.core.config import Config
from flatcloth.core.errors import RecordingError
from flatcloth.core.resources import sample_recordings
from flatcloth.recordings import SourceOptions, open_recording
from flatcloth.recordings.base import keep_source_options
from flatcloth.session.header import default_session_folder
from flatcloth.session.store import SessionFolder
from flatcloth.viewer.places import Chosen, PlaceError, Places
from flatcloth.viewer.server.app import PageServer
from flatcloth.viewer.server.workspace import Opened

SAMPLE = sample_recordings()["shirt-sleeve-clean"]


class FakeOpener:
    """Opens cylinders; what is named ``broken`` fails, and ``slow`` waits."""

    def __init__(self) -> None:
        self.asked: list[Chosen] = []
        self.closed: list[str] = []
        self.gate = threading.Event()

    def __call__(self, chosen: Chosen, current: Path | None) -> Opened | None:
        self.asked.append(chosen)
        name = Path(chosen.source).name
        if name == "broken":
            raise RecordingError("broken: has no views. Record it again.")
        if name == "slow":
            assert self.gate.wait(WAIT_S)
        opened = cylinder()

        def close() -> None:
            opened.close()
            self.closed.append(name)

        return replace(opened, close=close)


@pytest.fixture
def root(tmp_path: Path) -> Path:
    root = tmp_path / "root"
    for name in ("a", "b", "broken", "slow", "deep/inside"):
        (root / name).mkdir(parents=True)
        (root / name / "recording.json").write_text("{}")
    (root / "turned.bag").write_bytes(b"")
    (root / "notes.txt").write_text("")
    (tmp_path / "outside").mkdir()
    (tmp_path / "outside" / "recording.json").write_text("{}")
    (root / "way-out").symlink_to(tmp_path / "outside")
    (root / "way-in").symlink_to(root / "a")
    (root / "loop").symlink_to(root / "loop")
    return root


@pytest.fixture
def opener() -> FakeOpener:
    return FakeOpener()


@pytest.fixture
def empty(root: Path, opener: FakeOpener) -> Iterator[PageServer]:
    """A page on which nothing is open."""
    with PageServer(places=Places(root), opener=opener) as running:
        yield running
        opener.gate.set()


def opened(server: PageServer, kind: str, name: str = "") -> httpx.Response:
    return post(server, "/start/open", json={"kind": kind, "name": name})


def test_what_was_open_is_freed_at_the_switch_also_if_its_tab_stays(
    empty: PageServer,
) -> None:
    gc.disable()  # what waits for the collector stays
    try:
        assert opened(empty, "folder", "a").status_code == 200
        before = weakref.ref(empty.application)
        with Tab(empty) as tab:
            tab.ready()
            assert opened(empty, "folder", "b").status_code == 200
            assert tab.until(lambda m: m["type"] == "switched")
            until = time.monotonic() + WAIT_S
            while before() is not None and time.monotonic() < until:
                time.sleep(0.05)  # its socket and its last job end on their own threads
            assert before() is None
    finally:
        gc.enable()


def test_a_name_that_is_not_utf_8_is_shown_escaped_and_refused_in_words(
    empty: PageServer, root: Path, opener: FakeOpener
) -> None:
    os.makedirs(os.fsencode(root) + b"/caf\xe9/inner")
    listed = get(empty, "/start/folder.json").json()
    assert {"name": "caf\\xe9", "kind": "folder"} in listed["entries"]
    for path in ("caf\\xe9", "caf\udce9"):
        answer = post(empty, "/start/open", content=json.dumps({"kind": "folder", "name": path}).encode())
        assert answer.status_code in (400, 409)
        assert answer.json()["error"]
    assert opener.asked == []


def test_what_is_chosen_opens_and_another_takes_its_place(empty: PageServer, opener: FakeOpener) -> None:
    assert opened(empty, "folder", "a").status_code == 200
    assert "Flattened view" in get(empty, "/").text
    assert get(empty, "/start/places.json").json()["current"] == "cylinder"
    with Tab(empty) as tab:
        tab.ready()
        assert opened(empty, "folder", "deep/inside").status_code == 200
        assert tab.until(lambda m: m["type"] == "switched")
    assert opener.closed == ["a"]
    with Tab(empty) as tab:
        tab.ready()
    empty.stop()
    assert opener.closed == ["a", "inside"]


def test_what_cannot_be_opened_leaves_what_is_open(empty: PageServer, opener: FakeOpener) -> None:
    assert opened(empty, "folder", "a").status_code == 200
    answer = opened(empty, "folder", "broken")
    assert (answer.status_code, answer.json()["error"]) == (409, "broken: has no views. Record it again.")
    with Tab(empty) as tab:
        tab.ready()
    assert opener.closed == []


def test_one_is_opened_at_a_time(empty: PageServer, opener: FakeOpener) -> None:
    answers: list[httpx.Response] = []
    first = threading.Thread(target=lambda: answers.append(opened(empty, "folder", "slow")))
    first.start()
    while not opener.asked:
        pass
    assert opened(empty, "folder", "a").status_code == 429
    opener.gate.set()
    first.join()
    assert answers[0].status_code == 200


OUTSIDE = ("..", "../outside", "way-out", "way-out/", "/etc", "a/../../outside", "loop", "no", "\0")


def test_nothing_outside_the_root_is_listed_or_opened(empty: PageServer, opener: FakeOpener) -> None:
    for path in OUTSIDE:
        answer = get(empty, "/start/folder.json?path=" + path.replace("\0", "%00"))
        assert answer.status_code == 409
        assert (opened(empty, "folder", path).status_code, opener.asked) == (409, [])


def test_a_folder_lists_what_can_be_opened_and_no_way_out(empty: PageServer) -> None:
    listed = get(empty, "/start/folder.json?path=").json()
    assert {e["name"]: e["kind"] for e in listed["entries"]} == {
        "a": "recording", "b": "recording", "broken": "recording", "slow": "recording", "deep": "folder",
        "turned.bag": "file", "way-in": "recording",
    }  # fmt: skip
    assert get(empty, "/start/folder.json?path=deep").json()["path"] == "deep"


def test_without_a_root_no_folder_is_offered(opener: FakeOpener, tmp_path: Path) -> None:
    with PageServer(opener=opener) as server:
        assert "--root" in opened(server, "folder", str(tmp_path)).json()["error"]
    with pytest.raises(PlaceError, match="Name an existing folder"):
        Places(tmp_path / "nothing")


def test_examples_and_sessions_have_pictures(empty: PageServer) -> None:
    picture = get(empty, "/start/picture/example/shirt-sleeve-clean")
    assert picture.headers["content-type"] == "image/jpeg"
    assert picture.content[:2] == b"\xff\xd8"
    assert get(empty, "/start/picture/example/nothing").status_code == 409
    assert get(empty, "/start/picture/folder/a").status_code == 409, "it has no image"
    assert get(empty, "/start/picture/folder/../outside").status_code in (404, 409)
    assert get(empty, "/start/picture/camera/a").status_code == 404


def test_sessions_are_offered_where_only_the_user_reaches_the_page(state_home: Path, root: Path) -> None:
    recording, config = open_recording(str(SAMPLE)), Config()
    SessionFolder.open(
        default_session_folder(recording, "robust", config), recording, config, "robust"
    ).close()
    (told,) = Places(root).plain()["sessions"]
    assert (told["recording"], told["views"], told["method"]) == ("shirt-sleeve-clean", 36, "robust")
    chosen = Places(root).chosen("session", told["name"])
    assert (Path(chosen.source), chosen.session is not None) == (SAMPLE, True)
    assert Places(root, own=False).plain()["sessions"] == []
    with pytest.raises(PlaceError):
        Places(root, own=False).chosen("session", told["name"])


def test_a_session_with_a_folder_elsewhere_is_offered_again(
    state_home: Path, root: Path, tmp_path: Path
) -> None:
    elsewhere = tmp_path / "mine"
    SessionFolder.open(elsewhere, open_recording(str(SAMPLE)), Config(), "robust").close()
    for _ in range(2):
        Places(root).remember(elsewhere)
    (told,) = Places(root).plain()["sessions"]
    chosen = Places(root).chosen("session", told["name"])
    assert chosen.session.resolve() == elsewhere


def test_a_session_below_the_root_cannot_name_a_recording_elsewhere(root: Path, tmp_path: Path) -> None:
    recording, config = open_recording(str(SAMPLE)), Config()
    SessionFolder.open(root / "session", recording, config, "robust").close()
    assert Places(root).chosen("folder", "session").source == str(SAMPLE)  # bundled: offered anyhow
    header = root / "session" / "session.json"
    told: dict[str, Any] = json.loads(header.read_text())
    for elsewhere in (str(tmp_path / "outside"), str(root / "way-out"), str(tmp_path / "gone"), "a\0b"):
        told["recording"]["location"] = elsewhere
        header.write_text(json.dumps(told))
        with pytest.raises(PlaceError, match=r"outside the folder|not there any more"):
            Places(root).chosen("folder", "session")


def test_a_session_knows_what_its_recording_was_opened_with(tmp_path: Path) -> None:
    root, angles = tmp_path / "root", tmp_path / "root" / "turned.csv"
    source = write_open3d(root / "scan")
    angles.write_text("0\n-10\n-20\n")
    outside = tmp_path / "outside.csv"
    outside.write_text(angles.read_text())
    for name, table in (("inside", angles), ("beyond", outside)):
        options = SourceOptions(angles=table)
        recording = open_recording(source, options)
        SessionFolder.open(root / name, recording, Config(), "robust").close()
    chosen = Places(root).chosen("folder", "inside")
    again = SourceOptions.from_dict(chosen.header.recording.options, "session.json")
    assert list(open_recording(chosen.source, again).angles_deg) == list(recording.angles_deg)
    with pytest.raises(PlaceError, match=r"outside\.csv lies outside"):
        Places(root).chosen("folder", "beyond")


def test_a_file_played_in_place_of_a_camera_lies_below_the_root(root: Path, tmp_path: Path) -> None:
    outside = tmp_path / "private.bag"
    outside.touch()
    (root / "own.bag").touch()
    (root / "link.db3").symlink_to(outside)
    places = Places(root)
    assert places.chosen("camera", "").source == ""
    assert places.chosen("camera", "012345678901").source == "012345678901"
    assert places.chosen("camera", "own.bag").source == str(root.resolve() / "own.bag")
    for name in (str(outside), "../private.bag", "link.db3"):
        with pytest.raises(PlaceError, match="outside the folder"):
            places.chosen("camera", name)
    # Nobody learns what exists there.
    with pytest.raises(PlaceError, match="No folder is offered"):
        Places().chosen("camera", str(outside))
    with pytest.raises(PlaceError) as present:
        places.chosen("camera", str(outside))
    with pytest.raises(PlaceError) as absent:
        places.chosen("camera", str(tmp_path / "absent.bag"))
    assert str(present.value).split(": ")[1] == str(absent.value).split(": ")[1]


@pytest.mark.parametrize("name", ["angles", "camera_file"])
def test_no_file_outside_the_root_is_read_for_a_session(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    root = tmp_path / "root"
    recording = open_recording(write_open3d(root / "scan"), SourceOptions(step_deg=10.0))
    keep_source_options(recording, {name: "~/secret"})
    SessionFolder.open(root / "session", recording, Config(), "robust").close()
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.chdir(root)
    with pytest.raises(PlaceError, match="lies outside the folder"):
        Places(root).chosen("folder", "session")
    header = root / "session" / "session.json"
    header.write_text(header.read_text().replace("~/secret", "a\\u0000b"))
    with pytest.raises(RecordingError, match="Give the name of a file"):
        Places(root).chosen("folder", "session")
