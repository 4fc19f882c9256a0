from functools import partial

import numpy as np
import pytest
from scenes import AXIS, Cylinder
from sheet_runs import STEPS, done, errors_m, shared
from sheet_runs import integration as sheet_integration

from flatcloth.core.config import Config, FlatteningConfig
from flatcloth.core.errors import FlatclothError, FlatteningError
from flatcloth.core.types import Rigid2, RotationAxis
from flatcloth.engine.headless import Run
from flatcloth.engine.integration import Integration
from flatcloth.engine.result import pixel_counts
from flatcloth.engine.sheet import BY_HAND, beyond, lay_out
from flatcloth.garments.deciding import decided_part
from flatcloth.session.document import Side
from flatcloth.session.machine import (
    Accept,
    MemorySession,
    NothingMore,
    Nudge,
    Phase,
    Propose,
    SessionState,
    Start,
    Undo,
    apply,
)

integration = partial(sheet_integration, "paper")


def started(made: Integration, view: int | None = None) -> SessionState:
    return done(made, SessionState(len(made.recording)), Start(view))


def test_the_whole_sheet_is_integrated_and_the_loop_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    made = shared("paper")
    monkeypatch.setattr(made, "is_unattended", True)
    state = Run(made, MemorySession(SessionState(len(STEPS)))).finish()
    assert state.phase is Phase.FINISHED
    assert "occluding edge" in (state.document.finished or "")
    assert {a.side for a in state.document.accepted} == {Side.LEFT, Side.RIGHT}
    view = made.canonical(state.document).view
    exact = np.radians(200) * 0.12 * 0.2
    assert view.area_m2 == pytest.approx(exact, rel=0.08)
    assert np.percentile(errors_m(view), 95) < 0.004


def test_a_nudge_moves_the_overlay_which_is_made_once_for_each_place_and_lowers_a_good_score() -> None:
    made = shared("paper")
    state = done(made, started(made, 0), Propose())
    before, score = made.overlay(state.document), made.score(state.document).total
    assert made.proposal(state.document).alignment.score.total == pytest.approx(score)
    fresh = beyond(before, made.canonical(state.document).view)
    assert 0.1 < fresh.sum() / before.valid.sum() < 0.6
    assert not (fresh & ~before.valid).any()
    assert made.overlay(state.document) is before
    view = state.document.pending.view_index  # type: ignore[union-attr]
    nudged = apply(state, Nudge(view, Rigid2(0.0, 0.02, 0.03)))
    moved = np.array(made.overlay(nudged.document).origin_uv_m) - before.origin_uv_m
    np.testing.assert_allclose(moved, [0.02, 0.03], atol=1e-9)
    assert made.score(nudged.document).total < score
    # Taken back, it lies where it was.
    np.testing.assert_array_equal(made.overlay(apply(nudged, Undo()).document).valid, before.valid)
    assert apply(nudged, Accept(view)).document.accepted[-1].fixed


def test_a_view_of_the_other_side_is_passed_over_with_its_reason() -> None:
    made = integration(span_deg=(-60.0, 60.0), angles_deg=(0.0, 160.0, 200.0))
    state = done(made, started(made, 0), Propose())
    assert state.phase is Phase.FINISHED
    state = apply(started(made, 0), Propose(1))
    with pytest.raises(FlatclothError, match="View 1: no pixel of it shows the side of interest"):
        made.answer(state.document, state.request)  # type: ignore[arg-type]


def test_unsure_refusals_lead_to_another_view_and_an_end(monkeypatch: pytest.MonkeyPatch) -> None:
    made = shared("paper")
    monkeypatch.setattr(made, "is_unattended", True)
    monkeypatch.setattr(Integration, "accept_score", 2.0)  # no proposal is sure
    state = Run(made, MemorySession(started(made, 0))).finish()
    refused = [r.view_index for r in state.document.rejected]
    assert len(refused) == len(set(refused)) >= 2
    assert not state.document.accepted
    assert state.phase is Phase.FINISHED


def test_without_masks_or_axis_the_notes_say_so() -> None:
    made = Integration(Cylinder(angles_deg=(0.0,), masks=False, rotation_axis=None, held_point_m=None))
    assert made.axis.estimated
    assert made.axis.point_m[2] == pytest.approx(0.73, abs=0.06)  # the nearest line of the cylinder
    text = " ".join(made.notes)
    for word in ("masks", "axis", "one view"):
        assert word in text
    state = started(made)
    assert made.canonical(state.document).view.valid.any()
    assert isinstance(made.answer(state.document, apply(state, Propose()).request), NothingMore)  # type: ignore[arg-type]


def one_accepted(made: Integration) -> SessionState:
    state = done(made, started(made, 0), Propose())
    return apply(state, Accept(state.document.pending.view_index))


def test_a_part_that_is_taken_off_floats_beside_the_shape_and_undo_joins_it_again() -> None:
    made = shared("robust")
    state = one_accepted(made)
    whole, cloth = made.canonical(state.document), made.cloth(state.document)
    placed = np.isfinite(cloth.uv_m[:, 0])
    part = placed & (cloth.uv_m[:, 1] > np.nanpercentile(cloth.uv_m[:, 1], 70))
    decision = decided_part(cloth, part, 0.2, taken_off=True)
    off = apply(state, decision)
    shape = made.canonical(off.document)
    assert made.canonical(off.document) is shape
    (index,) = shape.taken_off
    piece = shape.floating[index]
    assert piece.area_m2 == pytest.approx(0.3 * whole.view.area_m2, rel=0.15)
    assert piece.area_m2 + shape.view.area_m2 == pytest.approx(whole.view.area_m2, rel=0.02)
    rest = made.cloth(off.document)
    assert (np.isnan(rest.uv_m[part, 0])).mean() > 0.9
    before, after = (pixel_counts(made, each.document) for each in (state, off))
    assert before["floating"] == 0
    assert after["floating"] == pytest.approx(0.3 * before["shape"], rel=0.15)
    assert sum(after.values()) == sum(before.values())
    sheet = lay_out(shape)
    assert [each.reason for each in sheet.pieces] == [BY_HAND]
    assert sheet.pieces[0].view.origin_uv_m[0] > shape.view.origin_uv_m[0] + 0.1
    assert made.canonical(apply(off, Undo()).document) is whole


def test_another_axis_derives_everything_again() -> None:
    made = Integration(Cylinder(angles_deg=(0.0, 20.0, 40.0)))
    before = made.views.flattening(1), made.views.cloud(1)
    other = RotationAxis(point_m=np.add(AXIS.point_m, (0.01, 0.0, -0.02)), direction=AXIS.direction)
    made.views.turn_about(other)
    assert made.axis is other
    after = made.views.flattening(1), made.views.cloud(1)
    assert after[0] is not before[0]
    assert not np.allclose(after[1].xyz_m, before[1].xyz_m)
    made.views.turn_about(AXIS)
    np.testing.assert_array_equal(made.views.cloud(1).xyz_m, before[1].xyz_m)


def test_samples_are_as_far_apart_for_a_camera_that_is_near() -> None:
    for distance_m, wanted in ((1.7, (12, 6)), (0.85, (12, 6)), (0.425, (24, 12)), (0.0, (102, 51))):
        at = RotationAxis(point_m=np.array([0.0, 0.3, distance_m]), direction=AXIS.direction)
        made = Integration(Cylinder(rotation_axis=at))
        assert made.config.flattening.sampling_intervals_px == wanted, distance_m
        chosen = Config()
        assert Integration(made.recording, chosen).config is chosen  # a session keeps what it began with


def test_a_recording_of_which_nothing_can_be_flattened_says_so() -> None:
    made = Integration(Cylinder(span_deg=(-1.0, 1.0), half_height_m=0.004))
    with pytest.raises(FlatteningError, match=r"no view .*masks"):
        started(made)


def test_a_folded_view_is_neither_begun_with_nor_proposed() -> None:
    strict = Config(flattening=FlatteningConfig(max_folded_share=-1.0))  # everything counts as folded
    made = integration(strict)
    with pytest.raises(FlatteningError, match="without folds"):
        started(made)
    state = apply(started(made, 0), Propose(1))
    with pytest.raises(FlatclothError, match=r"View 1: .*folded.*another view"):
        made.answer(state.document, state.request)  # type: ignore[arg-type]
