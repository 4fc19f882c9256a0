"""Session folders that are removed, replaced or prepared by somebody else while or before they are used."""

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from full_disks import full
from journal_script import SCRIPT, after, opened, played_in, states

from flatcloth.core.errors import IllegalDecisionError, JournalError, OutOfBoundsError
from flatcloth.core.plain_files import open_own, replace_file
from flatcloth.core.types import Rigid2
from flatcloth.export.history import read_history
from flatcloth.session.document import PlacedPart
from flatcloth.session.journal import encode
from flatcloth.session.machine import Nudge, Propose, Proposed, Start, Started, Undo, apply

HARMS: dict[str, Callable[[Path], object]] = {
    "removed": shutil.rmtree,
    "renamed": lambda place: place.rename(place.with_name("elsewhere")),
    "journal removed": lambda place: (place / "journal.jsonl").unlink(),
    "journal replaced": lambda place: replace_file(place / "journal.jsonl", b""),
    "journal cut": lambda place: os.truncate(place / "journal.jsonl", 100),
    "journal longer": lambda place: os.truncate(place / "journal.jsonl", 100_000),
}


@pytest.mark.parametrize("harm", HARMS)
def test_no_decision_is_lost_when_the_journal_is_taken_away(place, harm):
    folder = played_in(place, SCRIPT[:6])
    pick = folder.add_pick("cuff", np.zeros(3), np.ones(3), 0, (1.0, 2.0))
    HARMS[harm](place)
    for step in SCRIPT[6:]:
        folder.record(step)
    fresh = place.with_name("session-continued")
    assert folder.folder == fresh
    (notice,) = folder.take_notices()
    assert str(place / "journal.jsonl") in notice
    assert f"--session {fresh}" in notice
    assert folder.take_notices() == ()
    folder.close()
    again = opened(fresh)
    assert again.state == states()[-1]
    assert [p.name for p in again.picks] == [pick.name]
    again.close()


def test_a_second_harm_leads_to_another_fresh_folder(place):
    folder = opened(place)
    for step in SCRIPT[:2]:
        folder.record(step)
        shutil.rmtree(folder.folder)
    folder.record(SCRIPT[2])
    assert folder.folder.name == "session-continued-continued"
    assert folder.state == states()[3]
    folder.close()


def test_where_there_is_no_room_for_a_fresh_folder_the_decision_is_refused(place, monkeypatch):
    folder = opened(place)
    folder.record(SCRIPT[0])
    shutil.rmtree(place)

    with monkeypatch.context() as patched:
        patched.setattr(Path, "mkdir", full)
        with pytest.raises(JournalError, match=r"No space left on device.*was not made"):
            folder.record(SCRIPT[1])
    assert folder.state == states()[1]
    folder.record(SCRIPT[1])
    assert folder.state == states()[2]
    folder.close()


def test_deleting_the_lock_lets_no_second_process_in(place):
    folder = played_in(place)
    (place / "session.lock").unlink()
    with pytest.raises(JournalError, match="open in another flatcloth"):
        opened(place)
    folder.record(Undo())
    folder.close()
    opened(place).close()


@pytest.mark.parametrize("link", [os.symlink, os.link])
@pytest.mark.parametrize("name", ["session.lock", "journal.jsonl"])
def test_a_link_in_a_session_folder_is_not_written_through(place, tmp_path, name, link):
    mine = tmp_path / "mine.txt"
    mine.write_text("precious\n")
    opened(place).close()
    (place / name).unlink(missing_ok=True)
    link(mine, place / name)
    with pytest.raises(JournalError, match=f"cannot be used as session folder .{name}: ") as caught:
        opened(place)
    assert "\n" not in str(caught.value)
    assert mine.read_text() == "precious\n"


@pytest.mark.parametrize(
    "name", [".session.json.partial", ".summary.json.partial", ".grips.json.partial", "session.json.new"]
)
def test_a_draft_that_is_a_link_is_not_written_through(place, tmp_path, name):
    mine = tmp_path / "mine.txt"
    mine.write_text("precious\n")
    place.mkdir()
    (place / name).symlink_to(mine)
    folder = opened(place)
    replace_file(place / name.removeprefix(".").removesuffix(".partial"), b"{}")
    folder.close()
    assert mine.read_text() == "precious\n"


def test_a_pipe_or_device_in_place_of_a_file_does_not_block(place):
    place.mkdir()
    os.mkfifo(place / "session.lock")
    with pytest.raises(JournalError, match=r"session\.lock: "):
        opened(place)
    with pytest.raises(OSError, match="not a file"):
        open_own(Path("/dev/null"), os.O_RDWR)


def test_nobody_else_reads_a_session(place):
    opened(place).close()
    assert place.stat().st_mode & 0o077 == 0


def test_a_folder_of_another_user_is_told(place, monkeypatch):
    opened(place).close()
    monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)
    folder = opened(place)
    (notice,) = folder.take_notices()
    assert "belongs to another user" in notice
    folder.close()


def test_a_write_that_fails_leaves_nothing_behind(tmp_path, monkeypatch):
    (tmp_path / "cloud.ply").write_text("old")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        replace_file(tmp_path / "cloud.ply", b"new")
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == {"cloud.ply": "old"}


@pytest.mark.parametrize("by", [Rigid2(0.0, 11.0, 0.0), Rigid2(0.0, 1e9, 0.0), Rigid2(0.0, 0.0, -1e308)])
def test_a_view_cannot_be_moved_to_where_no_garment_reaches(place, by):
    folder = played_in(place, SCRIPT[:4])
    before = (place / "journal.jsonl").read_bytes()
    with pytest.raises(OutOfBoundsError, match=r"a garment.s plane reaches 10 m\. Move it by less"):
        folder.record(Nudge(1, by))
    for _ in range(3):
        folder.record(Nudge(1, Rigid2(0.0, 3.0, 0.0)))
    with pytest.raises(IllegalDecisionError):  # many steps lead there as well as one
        folder.record(Nudge(1, Rigid2(0.0, 3.0, 0.0)))
    assert (place / "journal.jsonl").read_bytes().startswith(before)
    folder.close()


FAR = Rigid2(0.0, 1e5, 0.0)


@pytest.mark.parametrize(
    "answer",
    [
        (Started(1, 36),), (Started(1, -1),),
        *((Started(1, 0), Propose(1), each) for each in (
            Proposed(2, 36, Rigid2()), Proposed(2, -1, Rigid2()), Proposed(2, 1, FAR),
            Proposed(2, 1, Rigid2(), component=-1),
            Proposed(2, 1, Rigid2(), also=(PlacedPart(36, 0, Rigid2()),)),
            Proposed(2, 1, Rigid2(), also=(PlacedPart(2, 0, FAR),)),
            Proposed(2, 1, Rigid2(), also=(PlacedPart(2, 0, Rigid2()),) * 1001),
        )),
    ],
    ids=repr,
)  # fmt: skip
def test_no_answer_is_about_a_view_that_does_not_exist_or_lies_beyond_any_plane(answer):
    state = after(Start(), *answer[:-1], n_views=36)
    with pytest.raises(OutOfBoundsError):
        apply(state, answer[-1])


def test_a_journal_with_an_absurd_number_is_refused_by_its_line(place):
    played_in(place, SCRIPT[:5]).close()
    journal = place / "journal.jsonl"
    link = int(json.loads(journal.read_bytes().splitlines()[-1])["crc"], 16)
    with journal.open("ab") as file:
        file.write(encode(6, Nudge(1, Rigid2(0.0, 1e9, 0.0)), link)[0])
    for read in (opened, read_history):
        with pytest.raises(JournalError, match=r"line 6 is damaged .View 1 would lie 1e"):
            read(place)
