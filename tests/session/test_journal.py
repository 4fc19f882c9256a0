"""The journal: what is on disk after every decision, and what comes back from it."""

from __future__ import annotations

import json
import logging
import math
import re
from pathlib import Path

import numpy as np
import pytest
from journal_script import SCRIPT, idle, opened, played_in, resumed, states

from flatcloth.core.config import Config
from flatcloth.core.errors import IllegalDecisionError, JournalError
from flatcloth.core.types import Rigid2
from flatcloth.session.journal import Pick, PickDeleted, PickRenamed
from flatcloth.session.machine import (
    Accept,
    LeaveOut,
    Nudge,
    Phase,
    PlacedPart,
    Propose,
    Proposed,
    SessionState,
    Start,
    Undo,
    apply,
)
from flatcloth.session.store import SessionFolder


def plain(pick: Pick) -> tuple[object, ...]:
    return (
        pick.id,
        pick.name,
        pick.position_held_m.tolist(),
        pick.normal_held.tolist(),
        pick.view_index,
        pick.source_rc,
    )


def test_a_new_folder_says_what_the_session_is_about(place: Path) -> None:
    folder = opened(place)
    folder.close()
    header = json.loads((place / "session.json").read_text())
    assert header["format"] == "flatcloth-session/2"
    assert header["recording"]["name"] == "memory"
    assert header["recording"]["views"] == 6
    assert header["method"] == "paper"
    assert Config.from_dict(header["config"]) == Config()
    assert set(header["versions"]) == {"flatcloth", "numpy", "scipy", "viser"}
    assert folder.state == SessionState(6)
    assert folder.picks == ()


def unsealed(place: Path, lines: list[bytes]) -> list[bytes]:
    """The lines as earlier versions wrote them, which also gave sessions no id."""
    header = json.loads((place / "session.json").read_text())
    header.pop("id", None)
    (place / "session.json").write_text(json.dumps(header))
    return [re.sub(rb',"crc":"[0-9a-f]{8}"', b"", line) for line in lines]


def test_a_journal_of_an_earlier_version_opens_and_is_sealed_from_there_on(
    played: SessionFolder, place: Path
) -> None:
    played.close()
    journal = place / "journal.jsonl"
    old = b"".join(line + b"\n" for line in unsealed(place, journal.read_bytes().splitlines()))
    assert b"crc" not in old
    journal.write_bytes(old)
    folder = opened(place)
    assert folder.state == states()[-1]
    folder.record(Undo())
    folder.close()
    opened(place).close()
    new = journal.read_bytes()
    assert new.startswith(old)
    # The first checksum covers the old lines, too.
    journal.write_bytes(new.replace(b"0.75", b"0.74"))
    with pytest.raises(JournalError, match=r"line 13 is damaged .its checksum"):
        opened(place)


def test_every_changed_byte_is_noticed(played: SessionFolder, place: Path) -> None:
    played.close()
    journal = place / "journal.jsonl"
    data = journal.read_bytes()
    rng = np.random.default_rng(1)
    for _ in range(300):
        at = int(rng.integers(len(data) - 1))
        changed = bytearray(data)
        changed[at] ^= int(rng.integers(1, 256))
        journal.write_bytes(bytes(changed))
        with pytest.raises(JournalError, match="is damaged"):
            opened(place)


def test_lines_of_another_session_are_noticed(played: SessionFolder, place: Path) -> None:
    played.close()
    lines = (place / "journal.jsonl").read_bytes().splitlines(keepends=True)
    other = place.with_name("other")
    played_in(other, (*SCRIPT[:4], Nudge(1, Rigid2(0.2)), *SCRIPT[5:])).close()
    theirs = (other / "journal.jsonl").read_bytes().splitlines(keepends=True)
    (place / "journal.jsonl").write_bytes(b"".join([*lines[:7], *theirs[7:]]))
    with pytest.raises(JournalError, match=r"line 8 is damaged .its checksum"):
        opened(place)


def test_a_name_that_is_no_unicode_is_refused_and_one_of_an_earlier_version_is_mended(place: Path) -> None:
    folder = opened(place)
    with pytest.raises(JournalError, match="not Unicode"):
        folder.add_pick("hem \ud800", np.zeros(3), np.ones(3), 0, (0.0, 0.0))
    assert folder.picks == ()
    folder.add_pick("hem \U0001f455", np.zeros(3), np.ones(3), 0, (0.0, 0.0))
    folder.close()
    (line,) = unsealed(place, (place / "journal.jsonl").read_bytes().splitlines())
    old = json.dumps(json.loads(line) | {"name": "hem \ud800 \U0001f455"}).encode() + b"\n"
    (place / "journal.jsonl").write_bytes(old)
    folder = opened(place)
    assert [p.name for p in folder.picks] == ["hem ? \U0001f455"]
    folder.close()


def test_every_line_is_json_with_number_time_and_kind(played: SessionFolder, place: Path) -> None:
    lines = [json.loads(line) for line in (place / "journal.jsonl").read_text().splitlines()]
    assert [line["line"] for line in lines] == list(range(1, len(SCRIPT) + 1))
    assert [line["kind"] for line in lines[:4]] == ["start", "started", "propose", "proposed"]
    assert all(line["time"].endswith("+00:00") for line in lines)
    assert lines[3]["current_from_new"] == {"theta_rad": 0.1, "u_m": 1 / 3, "v_m": -2e-17}
    assert lines[3]["side"] == "right"
    assert lines[7]["score"] is None


def test_a_computation_in_flight_is_given_up_on_resuming_and_the_session_goes_on(place: Path) -> None:
    folder = played_in(place, SCRIPT[:7])
    assert folder.state.phase is Phase.COMPUTING
    folder.close()
    for _ in range(2):  # also when it is resumed again
        assert resumed(place) == idle(states()[7])
    folder = opened(place)
    folder.record(Proposed(3, 4, Rigid2()))  # nobody asks any more
    assert folder.state == idle(states()[7])
    folder.record(Propose(5))
    folder.record(Proposed(4, 5, Rigid2()))
    expected = folder.state
    assert expected.phase is Phase.DECIDING
    folder.close()
    assert resumed(place) == expected


def test_a_journal_cut_at_any_byte_resumes_to_what_was_whole(played: SessionFolder, place: Path) -> None:
    played.close()
    data = (place / "journal.jsonl").read_bytes()
    known = states()
    for end in range(len(data) + 1):
        (place / "journal.jsonl").write_bytes(data[:end])
        whole = data[:end].count(b"\n")
        folder = opened(place)
        assert folder.state == idle(known[whole])
        torn = end > 0 and data[end - 1 : end] != b"\n"
        told = f"{place / 'journal.jsonl'}: the last line is incomplete after a crash and is dropped."
        assert folder.take_notices() == (told,) * torn, f"cut to {end} bytes"
        folder.close()
        kept = (place / "journal.jsonl").read_bytes()
        assert kept.startswith(data[: data[:end].rfind(b"\n") + 1])
        assert kept.endswith(b"\n") or kept == b""


def test_a_decision_after_a_torn_line_is_legible(
    played: SessionFolder, place: Path, caplog: pytest.LogCaptureFixture
) -> None:
    played.close()
    with (place / "journal.jsonl").open("ab") as file:
        file.write(b'{"line": 13, "ki')
    with caplog.at_level(logging.WARNING, "flatcloth.session.store"):
        folder = opened(place)
    assert [r.levelname for r in caplog.records] == ["WARNING"]
    folder.record(Undo())
    folder.close()
    assert resumed(place) == apply(states()[-1], Undo())


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        (lambda lines: [*lines[:4], b"\x00" * 40, *lines[5:]], "line 5 is damaged .it is not JSON"),
        (lambda lines: lines[:4] + lines[5:], "line 5 is damaged .it is numbered 6"),
        (lambda lines: [*lines[:4], b"{}", *lines[5:]], "line 5 is damaged .it is not an entry"),
        (lambda lines: [*lines[:4], b"[" * 99999, *lines[5:]], "line 5 is damaged .it is not JSON"),
        (lambda lines: [lines[0].replace(b'"start"', b'"jump"'), *lines[1:]], "line 1 is damaged"),
        (lambda lines: [lines[0].replace(b"null", b'"x"'), *lines[1:]], "line 1 is damaged"),
        (lambda lines: [lines[0].replace(b'"start"', b'"undo"'), *lines[1:]], "line 1 .*nothing to undo"),
        (lambda lines: [*lines[:3], lines[3].replace(b"theta_rad", b"theta_deg")], "line 4 is damaged"),
        (lambda lines: [*lines[:3], lines[3].replace(b'"right"', b'"up"')], "line 4 is damaged"),
        (lambda lines: [*lines, b""], "line 13 is damaged"),
    ],
)
@pytest.mark.parametrize("sealed", [True, False])
def test_damage_before_the_end_is_named_by_its_line(
    played: SessionFolder, place: Path, change: object, cause: str, sealed: bool
) -> None:
    played.close()
    lines = (place / "journal.jsonl").read_bytes().splitlines()
    if sealed:
        cause = cause.replace("nothing to undo", "checksum")
    else:
        lines = unsealed(place, lines)
    damaged = b"".join(line + b"\n" for line in change(lines))  # type: ignore[operator]
    (place / "journal.jsonl").write_bytes(damaged)
    with pytest.raises(JournalError, match=cause):
        opened(place)
    # Nothing was changed, and nothing holds the folder.
    assert (place / "journal.jsonl").read_bytes() == damaged
    with pytest.raises(JournalError, match=cause):
        opened(place)


def test_an_illegal_command_and_a_late_answer_leave_no_line(played: SessionFolder, place: Path) -> None:
    before = (place / "journal.jsonl").read_bytes()
    with pytest.raises(IllegalDecisionError):
        played.record(Start())
    played.record(Proposed(1, 5, Rigid2()))
    assert (place / "journal.jsonl").read_bytes() == before


def test_numbers_that_cannot_be_read_back_are_refused(place: Path) -> None:
    folder = played_in(place, SCRIPT[:3])
    before = (place / "journal.jsonl").read_bytes()
    with pytest.raises(JournalError, match="not finite"):
        folder.record(Proposed(2, 1, Rigid2(math.nan, 0.0, 0.0)))
    assert folder.state == states()[3]
    assert (place / "journal.jsonl").read_bytes() == before
    folder.close()


# --- picks ----------------------------------------------------------------------------------------


def test_picks_are_added_renamed_deleted_and_restored(place: Path) -> None:
    folder = opened(place)
    position, normal = np.array([0.1, -0.2, 0.85]), np.array([0.0, math.nan, -1.0])
    first = folder.add_pick("shoulder", position, normal, 3, (10.5, 20.25))
    second = folder.add_pick("hem\n", position + 1, normal, 4, (1.0, 2.0))
    assert (first.id, second.id) == (1, 2)
    folder.record(PickRenamed(1, "left shoulder"))
    folder.record(PickDeleted(2))
    third = folder.add_pick("cuff", position.astype(np.float32), normal, 5, (0.0, 0.0))
    assert third.id == 3  # a number is never used again
    kept = folder.picks
    folder.close()
    folder = opened(place)
    assert [p.name for p in folder.picks] == ["left shoulder", "cuff"]
    np.testing.assert_equal([plain(p) for p in folder.picks], [plain(p) for p in kept])
    assert folder.picks[0].position_held_m.dtype == np.float64
    folder.record(PickDeleted(3))
    assert folder.add_pick("next", position, normal, 0, (0.0, 0.0)).id == 4
    folder.close()


def test_picks_and_decisions_do_not_disturb_each_other(place: Path) -> None:
    folder = opened(place)
    for step in SCRIPT:
        folder.record(step)
        folder.add_pick("p", np.zeros(3), np.ones(3), 0, (0.0, 0.0))
    folder.close()
    folder = opened(place)
    assert folder.state == states()[-1]
    assert len(folder.picks) == len(SCRIPT)
    folder.close()


def test_a_pick_that_is_not_in_the_list_is_refused(place: Path) -> None:
    folder = opened(place)
    with pytest.raises(IllegalDecisionError, match="Pick 7 is not in the list"):
        folder.record(PickRenamed(7, "x"))
    with pytest.raises(IllegalDecisionError, match="Pick 7 is not in the list"):
        folder.record(PickDeleted(7))
    assert (place / "journal.jsonl").read_bytes() == b""
    folder.close()


def test_further_parts_of_a_proposal_come_back_from_the_journal(place: Path) -> None:
    also = (PlacedPart(1, 2, Rigid2(0.1, 0.2, 0.3)), PlacedPart(0, 1, Rigid2(0.0, 0.5, 0.0)))
    proposed = Proposed(2, 1, Rigid2(), score=0.9, also=also)
    played_in(place, (*SCRIPT[:3], proposed, LeaveOut(1, 0, 1), Undo(), Accept(1))).close()
    assert [a.also for a in resumed(place).document.accepted] == [also]
