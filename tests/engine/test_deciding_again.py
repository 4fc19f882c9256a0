"""Reopened and skipped views on a real shape: what stays, what is asked again, what comes back."""

from functools import lru_cache

import numpy as np
import pytest
from garment_evidence import blank_view
from sheet_runs import STEPS, done, integration, shared

from flatcloth.core.errors import AlignmentError
from flatcloth.core.types import Rigid2
from flatcloth.engine.headless import Run
from flatcloth.engine.integration import Integration
from flatcloth.engine.outcome import outcome_of
from flatcloth.engine.placing import laid_beside
from flatcloth.engine.sheet import lay_out, place_of_piece
from flatcloth.methods.registry import method_names
from flatcloth.session.document import Document, Side
from flatcloth.session.machine import (
    Accept,
    MemorySession,
    Nudge,
    Phase,
    Propose,
    Reject,
    Reopen,
    SessionState,
    Skip,
    Start,
    TakePart,
    apply,
)


@lru_cache(2)
def three_accepted(made: Integration) -> SessionState:
    """Views 1, 2 and 3 laid one after the other on view 0."""
    state = done(made, SessionState(len(made.recording)), Start(0))
    for view in (1, 2, 3):
        state = done(made, state, Propose(view), Accept(view))
    assert [a.view_index for a in state.document.accepted] == [1, 2, 3]
    return state


def places(made: Integration, document: Document) -> dict[int, Rigid2]:
    """Where each accepted view lies on the start view's plane."""
    motions = made.canonical(document).current_from_view
    start = motions[document.start_view or 0].inverse()
    return {view: start @ motion for view, motion in motions.items()}


def apart_m(one: Rigid2, other: Rigid2) -> float:
    corners = np.array([[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1]])
    return float(np.linalg.norm(one.apply(corners) - other.apply(corners), axis=1).max())


def lays_nothing(made: Integration, patched: pytest.MonkeyPatch) -> None:
    """Let the method lay no view any more."""

    def nothing(*_: object) -> None:
        raise AlignmentError("View 2: it has no cloth in common with the shape; choose another view.")

    patched.setattr(made.algorithm, "propose", nothing)


@pytest.mark.parametrize("method", method_names())
def test_what_was_accepted_stays_where_it_lies_if_a_view_is_refused(method):
    made = shared(method)
    before = three_accepted(made)
    after = done(made, before, Reopen(2), Reject(2))
    assert after.phase is Phase.READY
    assert [a.view_index for a in after.document.accepted] == [1, 3]
    assert apart_m(places(made, after.document)[3], places(made, before.document)[3]) < 0.004
    again = done(made, before, Reopen(2), Accept(2)).document
    assert sorted(a.view_index for a in again.accepted) == [1, 2, 3]
    assert apart_m(places(made, again)[2], places(made, before.document)[2]) < 0.004


def test_a_skipped_view_comes_again_when_the_others_are_done():
    made = integration("robust", angles_deg=(0.0, 20.0, 40.0))
    state = done(made, SessionState(3), Start(0), Propose())
    asked = []
    for _ in range(5):
        pending = state.document.pending
        asked.append(pending.view_index)
        state = done(made, state, Skip(pending.view_index), Propose())
    assert len(set(asked[:2])) == 2  # first the other one,
    assert asked[2:] == [*asked[:2], asked[0]]  # then in the order in which they were put off
    left = outcome_of(made, state.document)["left"]
    put_off = [s.view_index for s in state.document.skipped]
    assert [(v["view_index"], v["reason"]) for v in left] == [(view, "skipped") for view in put_off]
    end = Run(made, MemorySession(state)).finish()
    assert end.phase is Phase.FINISHED
    assert not any(s.view_index in end.document.used_views for s in end.document.skipped)


@pytest.mark.parametrize("method", method_names())
def test_a_view_that_the_method_cannot_lay_lies_beside_the_shape_to_be_placed_by_hand(method, monkeypatch):
    made = integration(method)
    state = done(made, SessionState(len(STEPS)), Start(0))
    lays_nothing(made, monkeypatch)
    state = done(made, state, Propose(2))
    pending = state.document.pending
    assert pending.score == 0.0
    assert pending.why.endswith("choose another view. It lies next to the shape; move it.")
    shape, overlay = made.canonical(state.document).view, made.overlay(state.document)
    u_shape = shape.uv_from_rc(np.argwhere(shape.valid))[:, 0]
    u_new = overlay.uv_from_rc(np.argwhere(overlay.valid))[:, 0]
    assert u_new.max() < u_shape.min() or u_new.min() > u_shape.max()
    assert made.proposal(state.document).alignment.score.total == 0.0
    # Dragged to where it belongs and accepted, it is part of the shape.
    right = done(shared(method), done(shared(method), SessionState(len(STEPS)), Start(0)), Propose(2))
    by = right.document.pending.current_from_new @ pending.current_from_new.inverse()
    moved = apply(state, Nudge(2, by))
    assert made.score(moved.document).total > 0.5
    placed = apply(moved, Accept(2))
    assert placed.document.accepted[0].fixed
    assert made.canonical(placed.document).view.area_m2 > 1.1 * shape.area_m2


def test_a_piece_of_several_views_comes_as_a_whole_when_one_component_of_it_is_placed_by_hand():
    # Views 0 and 1 share cloth, and so do 2 and 3 on the other side.
    made = integration("robust", angles_deg=(0.0, 20.0, 170.0, 190.0), span_deg=(-180.0, 180.0))
    state = three_accepted(made)
    apart = made.canonical(state.document)
    (piece,) = lay_out(apart).pieces
    assert piece.views == (2, 3)
    place = place_of_piece(made.views, piece, [3]).current_from_new
    state = done(made, state, Reopen(3))
    before = made.canonical(state.document)
    # Laid with 40 mm on the shape's right border.
    part = made.views.part(3, 0)
    right = float(before.view.uv_from_rc(np.argwhere(before.view.valid))[:, 0].max())
    left = float(place.apply(part.uv_from_rc(np.argwhere(part.valid)))[:, 0].min())
    there = Rigid2(0.0, right - left - 0.04, 0.0) @ place
    placed = done(made, state, TakePart(3, 0, there), Accept(3))
    joined = made.canonical(placed.document)
    assert joined.floating == ()
    assert set(np.unique(joined.view.view_index[joined.view.valid])) == {0, 1, 2, 3}
    whole_m2 = apart.view.area_m2 + piece.view.area_m2
    assert whole_m2 - 0.04 * 0.25 < joined.view.area_m2 < whole_m2


def test_a_piece_that_outgrows_the_shape_becomes_the_shape():
    made = integration("robust", angles_deg=(0.0, 150.0, 170.0, 190.0), span_deg=(-180.0, 180.0))
    state = three_accepted(made)
    shape = made.canonical(state.document)
    assert set(np.unique(shape.view.view_index[shape.view.valid])) == {1, 2, 3}
    assert np.isfinite(shape.view.placement_std_m[shape.view.valid]).mean() > 0.9


@pytest.mark.parametrize("side", [Side.LEFT, Side.RIGHT])
def test_a_component_is_laid_on_its_side_of_the_shape_at_its_height_without_touching_it(side):
    shape, part = (
        blank_view(np.pad(np.ones(size, dtype=bool), ((0, 0), (5, 0))), origin_uv_m=origin_uv_m)
        for size, origin_uv_m in (((30, 20), (-0.1, 0.3)), ((12, 8), (0.5, -0.2)))
    )
    motion = laid_beside(shape, {3: part}, side).alignment.current_from_new
    assert motion.theta_rad == 0.0
    shape_uv_m = shape.uv_from_rc(np.argwhere(shape.valid))
    part_uv_m = motion.apply(part.uv_from_rc(np.argwhere(part.valid)))
    own_m, moved_m = ([uv.min(axis=0), uv.max(axis=0)] for uv in (shape_uv_m, part_uv_m))
    gap_m = own_m[0][0] - moved_m[1][0] if side is Side.LEFT else moved_m[0][0] - own_m[1][0]
    assert gap_m == pytest.approx(0.02)
    assert sum(moved_m)[1] == pytest.approx(sum(own_m)[1])  # the middles of their heights
