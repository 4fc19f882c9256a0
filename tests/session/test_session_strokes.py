"""Strokes are decisions: undone, named in the history, kept in the journal; the shape follows them."""

from __future__ import annotations

from pathlib import Path

import pytest
from journal_script import after, played_in, resumed

from flatcloth.core.errors import IllegalDecisionError
from flatcloth.core.strokes import Cut, ImageStroke, SpaceStroke
from flatcloth.core.types import Rigid2
from flatcloth.session.commands import paint
from flatcloth.session.machine import (
    Accept,
    Followed,
    Phase,
    Propose,
    Proposed,
    Restart,
    SessionState,
    Start,
    Started,
    Undo,
    apply,
)

THIS = ImageStroke(side="this", view_index=1, points_rc=((1.0, 2.0), (3.0, 4.0)))
OTHER = SpaceStroke(side="other", points_m=((0.0, 0.1, 0.8),), normals=((0.0, 0.0, -1.0),))
CUT = Cut(
    points_m=((0.0, 0.0, 0.8), (0.1, 0.0, 0.8)),
    normals=((0.0, 0.0, -1.0), (0.0, 0.0, -1.0)),
    beyond_m=(0.0, 0.2, 0.8),
    beyond_normal=(0.0, 0.0, -1.0),
)


def with_one_view() -> SessionState:
    proposed = Proposed(2, 3, Rigid2(0.1, 0.2, 0.3), None, 0.8)
    return after(Start(), Started(1, 2), Propose(), proposed, Accept(3))


def test_the_views_of_the_shape_are_laid_anew_after_a_stroke() -> None:
    state = apply(with_one_view(), paint(THIS))
    assert state.document.strokes == (THIS,)
    assert state.request is not None
    assert (state.request.kind, state.request.view_index) == ("follow", 3)
    state = apply(state, Followed(state.request.token, 3, Rigid2(0.0, 0.1, 0.0), 0.9))
    assert state.phase is Phase.READY
    assert [a.current_from_new for a in state.document.accepted] == [Rigid2(0.0, 0.1, 0.0)]


def test_undo_brings_back_the_shape_from_before_the_stroke() -> None:
    before = with_one_view()
    state = apply(before, paint(OTHER))
    assert state.undo[-1].name == "stroke: not this side"
    assert apply(state, Undo()).document == before.document


def test_a_stroke_while_the_start_view_is_sought_asks_for_it_again() -> None:
    asked = apply(SessionState(6), Start())
    state = apply(asked, paint(THIS))
    assert state.request is not None
    assert asked.request is not None
    assert state.request.kind == "start"
    assert state.request.token != asked.request.token


def test_a_proposal_is_dropped_since_its_view_may_show_other_cloth() -> None:
    state = apply(with_one_view(), Propose(4))
    assert state.request is not None
    state = apply(state, Proposed(state.request.token, 4, Rigid2()))
    assert apply(state, paint(CUT)).document.pending is None


def test_strokes_outlast_a_restart() -> None:
    state = apply(apply(with_one_view(), paint(THIS)), Restart())
    assert state.document.strokes == (THIS,)


def test_a_stroke_on_a_view_that_does_not_exist_is_refused() -> None:
    stroke = ImageStroke(side="this", view_index=6, points_rc=((0.0, 0.0),))
    with pytest.raises(IllegalDecisionError, match="View 6 does not exist; there are 6 views"):
        apply(with_one_view(), paint(stroke))


def test_the_journal_keeps_every_kind_of_stroke(tmp_path: Path) -> None:
    strokes = (THIS, OTHER, CUT)
    played_in(tmp_path, [paint(stroke) for stroke in strokes], "robust").close()
    assert resumed(tmp_path, "robust").document.strokes == strokes
