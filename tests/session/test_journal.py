"""The journal: what is on disk after every decision, and what comes back from it."""

import math

import numpy as np
import pytest
from journal_script import AGAIN, CLOTH, SCRIPT, STROKE, idle, opened, played_in, resumed, states

from flatcloth.core.errors import IllegalDecisionError, JournalError
from flatcloth.core.strokes import ImageStroke, SpaceStroke
from flatcloth.core.types import Rigid2
from flatcloth.session.document import PlacedPart, Side
from flatcloth.session.garment import (
    DecidedPart,
    DecidedSeam,
    HeldPoint,
    PlacedPiece,
    ReleasePoints,
    SetKind,
)
from flatcloth.session.journal import PickDeleted, PickRenamed, decode, encode
from flatcloth.session.machine import (
    AcceptAll,
    Nudge,
    Phase,
    Propose,
    Proposed,
)

ALSO = (PlacedPart(1, 2, Rigid2(0.1, 0.2, 0.3)), PlacedPart(0, 1, Rigid2(0.0, 0.5, 0.0)))


@pytest.mark.parametrize(
    "entry",
    [
        *AGAIN[:-4],
        AcceptAll((3, 5), ((4, "it shows nothing"),)),
        Proposed(2, 1, Rigid2(), Side.LEFT, 0.9, also=ALSO, why="It was asked for."),
        ImageStroke(side="this", view_index=1, points_rc=((1.0, 2.0), (3.0, 4.0))),
        SpaceStroke(side="other", points_m=((0.0, 0.1, 0.8),), normals=((0.0, 0.0, -1.0),)),
        STROKE,
        SetKind("shorts"),
        SetKind(None),
        HeldPoint("neck_left", (0.2, 0.3), CLOTH),
        ReleasePoints(),
        PlacedPiece(True, CLOTH, CLOTH, 0.97),
        DecidedPart(True, CLOTH, CLOTH, 0.2, place=PlacedPiece(True, CLOTH, CLOTH, 0.5)),
        DecidedSeam(False, CLOTH.points_m),
    ],
    ids=lambda entry: type(entry).__name__,
)
def test_the_journal_gives_back_every_kind_of_entry(entry):
    line, _ = encode(3, entry)
    assert decode(3, line.rstrip(b"\n")).entry == entry


def test_a_computation_in_flight_is_given_up_on_resuming_and_the_session_goes_on(place):
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


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        (lambda lines: [*lines[:4], b"\x00" * 40, *lines[5:]], "line 5 is damaged .it is not JSON"),
        (lambda lines: lines[:4] + lines[5:], "line 5 is damaged .it is numbered 6"),
        (lambda lines: [*lines[:4], b"{}", *lines[5:]], "line 5 is damaged .it is not an entry"),
        (lambda lines: [*lines[:4], b"[" * 99999, *lines[5:]], "line 5 is damaged .it is not JSON"),
        (lambda lines: [lines[0].replace(b'"start"', b'"jump"'), *lines[1:]], "line 1 is damaged"),
        (lambda lines: [lines[0].replace(b"null", b'"x"'), *lines[1:]], "line 1 is damaged"),
        (lambda lines: [lines[0].replace(b'"start"', b'"undo"'), *lines[1:]], "line 1 .*checksum"),
        (lambda lines: [*lines[:3], lines[3].replace(b"theta_rad", b"theta_deg")], "line 4 is damaged"),
        (lambda lines: [*lines[:3], lines[3].replace(b'"right"', b'"up"')], "line 4 is damaged"),
        (lambda lines: [*lines, b""], "line 13 is damaged"),
        (lambda lines: [*lines[:4], lines[5], lines[4], *lines[6:]], "line 5 is damaged .it is numbered 6"),
        (lambda lines: [*lines[:5], *lines[4:]], "line 6 is damaged .it is numbered 5"),
    ],
)
def test_damage_before_the_end_is_named_by_its_line(played, place, change, cause):
    played.close()
    lines = (place / "journal.jsonl").read_bytes().splitlines()
    damaged = b"".join(line + b"\n" for line in change(lines))  # type: ignore[operator]
    (place / "journal.jsonl").write_bytes(damaged)
    with pytest.raises(JournalError, match=cause):
        opened(place)
    # Nothing was changed, and nothing holds the folder.
    assert (place / "journal.jsonl").read_bytes() == damaged
    with pytest.raises(JournalError, match=cause):
        opened(place)


def test_numbers_and_names_that_cannot_be_read_back_are_refused(place):
    folder = played_in(place, SCRIPT[:3])
    before = (place / "journal.jsonl").read_bytes()
    with pytest.raises(JournalError, match="not finite"):
        folder.record(Proposed(2, 1, Rigid2(math.nan, 0.0, 0.0)))
    with pytest.raises(JournalError, match="not Unicode"):
        folder.add_pick("hem \ud800", np.zeros(3), np.ones(3), 0, (0.0, 0.0))
    assert folder.state == states()[3]
    assert (place / "journal.jsonl").read_bytes() == before
    folder.close()


def test_every_changed_byte_is_noticed(played, place):
    played.close()
    journal = place / "journal.jsonl"
    data = journal.read_bytes()
    rng = np.random.default_rng(1)
    for _ in range(100):
        at = int(rng.integers(len(data) - 1))
        changed = bytearray(data)
        changed[at] ^= int(rng.integers(1, 256))
        journal.write_bytes(bytes(changed))
        with pytest.raises(JournalError, match="is damaged"):
            opened(place)


@pytest.mark.parametrize("mine", [0, 7])
def test_lines_of_another_session_are_noticed(played, place, mine):
    played.close()
    lines = (place / "journal.jsonl").read_bytes().splitlines(keepends=True)
    other = place.with_name("other")
    played_in(other, (*SCRIPT[:4], Nudge(1, Rigid2(0.2)), *SCRIPT[5:])).close()
    theirs = (other / "journal.jsonl").read_bytes().splitlines(keepends=True)
    (place / "journal.jsonl").write_bytes(b"".join([*lines[:mine], *theirs[mine:]]))
    with pytest.raises(JournalError, match=rf"line {mine + 1} is damaged .its checksum"):
        opened(place)


@pytest.mark.parametrize("script", [SCRIPT, AGAIN])
def test_a_journal_cut_anywhere_resumes_to_what_was_whole_and_goes_on(place, script):
    """As of a program that was killed; of each line the first, the middle and the last bytes are tried."""
    played_in(place, script).close()
    data = (place / "journal.jsonl").read_bytes()
    known, begun = states(script), 0
    for whole, line in enumerate(data.splitlines(keepends=True)):
        for length in (0, 1, len(line) // 2, len(line) - 1):
            (place / "journal.jsonl").write_bytes(data[: begun + length])
            folder = opened(place)
            assert folder.state == idle(known[whole])
            told = f"{place / 'journal.jsonl'}: the last line is incomplete after a crash and is dropped."
            assert folder.take_notices() == (told,) * (length > 0), f"cut to {begun + length} bytes"
            folder.record(SetKind("tshirt"))
            after_cut = folder.state
            folder.close()
            assert resumed(place) == after_cut
            assert (place / "journal.jsonl").read_bytes().startswith(data[:begun])
        begun += len(line)


def test_picks_are_added_renamed_deleted_and_restored(place):
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
    np.testing.assert_equal([vars(p) for p in folder.picks], [vars(p) for p in kept])
    assert folder.picks[0].position_held_m.dtype == np.float64
    folder.record(PickDeleted(3))
    assert folder.add_pick("next", position, normal, 0, (0.0, 0.0)).id == 4
    folder.close()


def test_a_pick_that_is_not_in_the_list_is_refused(place):
    folder = opened(place)
    with pytest.raises(IllegalDecisionError, match="Pick 7 is not in the list"):
        folder.record(PickRenamed(7, "x"))
    with pytest.raises(IllegalDecisionError, match="Pick 7 is not in the list"):
        folder.record(PickDeleted(7))
    assert (place / "journal.jsonl").read_bytes() == b""
    folder.close()
