"""The session folder: what it belongs to, who may write, and disks that fail."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from full_disks import fill_disk
from journal_script import RECORDING, opened, resumed, states
from tiny_recordings import MemoryRecording

from flatcloth.core.config import Config, PlanningConfig
from flatcloth.core.errors import JournalError
from flatcloth.session.header import default_session_folder
from flatcloth.session.machine import Undo, apply
from flatcloth.session.store import SessionFolder


def test_a_session_of_another_recording_method_or_configuration_is_refused(place):
    opened(place).close()
    other = Config(planning=PlanningConfig(overlap_area_m2=0.05))
    for recording, config, method, cause in (
        (MemoryRecording(name="towel"), Config(), "paper", "another recording .'memory', not 'towel'"),
        (MemoryRecording(angles_deg=(0.0, 5.0)), Config(), "paper", "another recording"),
        (RECORDING, Config(), "robust", "method 'paper', not 'robust'"),
        (RECORDING, other, "paper", "planning.overlap_area_m2 was 0.0, is 0.05"),
    ):
        with pytest.raises(JournalError, match=cause):
            SessionFolder.open(place, recording, config, method)
    opened(place).close()


def test_a_recording_that_moved_is_the_same(place):
    opened(place).close()
    SessionFolder.open(place, MemoryRecording(location="elsewhere"), Config(), "paper").close()


@pytest.mark.parametrize(
    ("header", "cause"),
    [
        *((text, "se another folder") for text in ("", "[]", "{}", "null", "[" * 99999)),
        ('{"format": "flatcloth-session/5"}', "se another folder"),
        ('{"format": "flatcloth-session/2"}', "se another folder"),
        ({"recording": {}}, "not valid"),
        ({"config": {"planning": {"magic": 1}}}, "not valid.*magic"),
    ],
)
def test_a_header_that_cannot_be_understood_is_refused(place, header, cause):
    opened(place).close()
    file = place / "session.json"
    whole = header if isinstance(header, str) else json.dumps(json.loads(file.read_text()) | header)
    file.write_text(whole)
    with pytest.raises(JournalError, match=rf"session\.json: .*{cause}") as caught:
        opened(place)
    assert "\n" not in str(caught.value)


def test_a_journal_without_its_header_is_refused(played, place):
    played.close()
    (place / "session.json").unlink()
    with pytest.raises(JournalError, match="missing, but there is a journal"):
        opened(place)


def test_a_folder_with_other_files_can_become_a_session(place):
    place.mkdir()
    (place / "notes.txt").write_text("mine")
    opened(place).close()
    assert (place / "notes.txt").read_text() == "mine"


def test_only_one_process_writes(played, place):
    with pytest.raises(JournalError, match=rf"open in another flatcloth .process {os.getpid()}"):
        opened(place)
    code = (
        "import sys; sys.path[:0] = sys.argv[2:]\n"
        "from pathlib import Path\n"
        "from tiny_recordings import MemoryRecording\n"
        "from flatcloth.core.config import Config\n"
        "from flatcloth.session.store import SessionFolder\n"
        "SessionFolder.open(Path(sys.argv[1]), MemoryRecording(), Config(), 'paper')"
    )
    here = Path(__file__).parents[1]
    command = [sys.executable, "-c", code, str(place), str(here), str(here.parent)]
    refused = subprocess.run(command, capture_output=True, text=True, check=False)
    assert "open in another flatcloth" in refused.stderr
    played.record(Undo())  # the first one is not disturbed
    played.close()
    # A process that died without closing leaves the folder free.
    subprocess.run(command, capture_output=True, check=True)
    opened(place).close()


def test_a_place_that_cannot_be_a_folder_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    for folder in (tmp_path / "file", tmp_path / "file" / "below", Path("/proc/session")):
        with pytest.raises(JournalError, match="Choose a writable folder"):
            opened(folder)


def test_a_full_disk_refuses_the_decision_and_leaves_the_journal_whole(played, place, monkeypatch):
    before = (place / "journal.jsonl").read_bytes()
    fill_disk(monkeypatch)
    with pytest.raises(JournalError, match="No space left on device"):
        played.record(Undo())
    monkeypatch.undo()
    assert played.state == states()[-1]
    assert (place / "journal.jsonl").read_bytes() == before
    played.record(Undo())
    played.close()
    assert resumed(place) == apply(states()[-1], Undo())


def test_each_line_is_on_the_disk_before_the_decision_counts(played, place, monkeypatch):
    synced = []
    monkeypatch.setattr(os, "fsync", lambda _: synced.append((place / "journal.jsonl").read_bytes()))
    played.record(Undo())
    assert synced
    assert json.loads(synced[-1].splitlines()[-1])["kind"] == "undo"


def test_a_closed_session_takes_no_decision(played):
    played.close()
    played.close()
    with pytest.raises(JournalError, match="closed"):
        played.record(Undo())


def test_default_folders_keep_apart_what_cannot_continue_each_other(state_home):
    other = Config(planning=PlanningConfig(overlap_area_m2=0.05))
    folders = [
        default_session_folder(RECORDING, "paper"),
        default_session_folder(RECORDING, "robust"),
        default_session_folder(MemoryRecording(location="elsewhere"), "paper"),
        default_session_folder(RECORDING, "paper", other),
        default_session_folder(MemoryRecording(angles_deg=(0.0, 5.0)), "paper"),
    ]
    assert len(set(folders)) == 5
    assert {f.parent for f in folders} == {state_home / "flatcloth" / "sessions"}
    assert folders[0].name.startswith("memory-")
    assert folders[0] == default_session_folder(RECORDING, "paper", Config())


@pytest.mark.parametrize("name", ["../../etc", "a/b", "..", "", "x" * 300, "Hemd grün"])
def test_a_default_folder_lies_where_it_should_whatever_the_name(state_home, name):
    folder = default_session_folder(MemoryRecording(name=name), "paper")
    assert folder.resolve().parent == (state_home / "flatcloth" / "sessions").resolve()
    assert len(folder.name) < 80


def test_without_a_state_home_the_users_own_is_taken(monkeypatch):
    for value in ("", "relative/place"):
        monkeypatch.setenv("XDG_STATE_HOME", value)
        expected = Path.home() / ".local" / "state" / "flatcloth" / "sessions"
        assert default_session_folder(RECORDING, "paper").parent == expected
