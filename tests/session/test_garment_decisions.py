"""Decisions about the garment: undone, bounded; a running computation is not disturbed."""

import dataclasses

import pytest
from journal_script import CLOTH, after

from flatcloth.core.errors import IllegalDecisionError, OutOfBoundsError
from flatcloth.session.garment import (
    ClothPlaces,
    DecidedPart,
    DecidedSeam,
    HeldPoint,
    PlacedPiece,
    ReleasePoints,
    SetKind,
)
from flatcloth.session.machine import Redo, Restart, Start, Started, Undo, apply

HOLD = HeldPoint("neck_left", (0.2, 0.3), CLOTH)
PIECE = PlacedPiece(True, CLOTH, CLOTH, 0.97)
LINK = DecidedPart(True, CLOTH, CLOTH, 0.2)
SEAM = DecidedSeam(False, CLOTH.points_m)


def test_decisions_are_undone_and_redone_one_by_one() -> None:
    state = after(SetKind("tshirt"), HOLD, PIECE, LINK)
    assert state.document.garment.parts == (LINK,)
    assert state.undo[-1].name == "cut a part off"
    state = apply(state, Undo())
    assert state.document.garment.parts == ()
    assert state.document.garment.kind == "tshirt"
    assert state.document.garment.held == (HOLD,)
    assert [item.name for item in state.undo] == [
        "garment: tshirt", "hold neck_left", "place a piece by the garment",
    ]  # fmt: skip
    back = apply(apply(state, Undo()), Undo())
    assert back.document.garment.held == ()
    assert apply(apply(back, Redo()), Redo()).document == state.document


def test_a_point_held_again_moves_and_another_kind_lets_all_points_go() -> None:
    there = dataclasses.replace(HOLD, uv_m=(0.5, 0.5))
    state = after(HOLD, there)
    assert [held.uv_m for held in state.document.garment.held] == [(0.5, 0.5)]
    assert apply(state, ReleasePoints("neck_left")).document.garment.held == ()
    assert apply(state, SetKind("towel")).document.garment.held == ()


def test_a_seam_is_cut_and_kept_again_and_undone_and_no_shape_of_this_side_depends_on_it() -> None:
    kept = dataclasses.replace(SEAM, kept=True)
    begun = after(Start())
    state = apply(apply(begun, SEAM), kept)
    assert [item.name for item in state.undo[-2:]] == ["cut a seam", "keep a seam"]
    assert state.document.garment.seams == (SEAM, kept)
    assert state.document.shape_key == begun.document.shape_key
    assert apply(state, Undo()).document.garment.seams == (SEAM,)


def test_a_running_computation_goes_on_and_a_restart_keeps_what_was_said() -> None:
    asked = after(Start())
    decided = apply(asked, SetKind("skirt"))
    assert decided.request == asked.request
    started = apply(decided, Started(1, 2))
    assert started.document.start_view == 2
    assert apply(started, Restart(1)).document.garment.kind == "skirt"


@pytest.mark.parametrize(
    "command",
    [SetKind(None), ReleasePoints(), ReleasePoints("neck_left")],
)
def test_what_changes_nothing_is_refused_with_a_reason(command) -> None:
    with pytest.raises(IllegalDecisionError, match=r"already|held"):
        after(command)


@pytest.mark.parametrize(
    "command",
    [
        dataclasses.replace(HOLD, uv_m=(1e9, 0.0)),
        dataclasses.replace(HOLD, cloth=ClothPlaces((), ())),
        dataclasses.replace(HOLD, name="n" * 100),
        dataclasses.replace(PIECE, probability=float("nan")),
        dataclasses.replace(LINK, probability=float("nan")),
        dataclasses.replace(LINK, rest=ClothPlaces((), ())),
        SetKind("k" * 100),
        DecidedSeam(True, CLOTH.points_m[:2]),
        DecidedSeam(True, (*CLOTH.points_m, (0.0, 1e9, 0.0))),
    ],
)
def test_places_and_names_that_no_garment_has_are_refused(command) -> None:
    with pytest.raises(OutOfBoundsError):
        after(command)
