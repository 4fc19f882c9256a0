"""How a shape grew, on an exact cylinder; and opening a session for export."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
import pytest
from exported_sessions import cylinder_session, write_cylinder
from scenes import sheet

from flatcloth.core.errors import JournalError, RecordingError
from flatcloth.core.types import Rigid2
from flatcloth.engine.integration import Integration
from flatcloth.engine.result import at_step
from flatcloth.export.growth import grow, key_of
from flatcloth.export.report import _floating
from flatcloth.export.session import OpenedSession, open_session
from flatcloth.garments.deciding import placed_piece
from flatcloth.methods.answers import Canonical
from flatcloth.session.document import Accepted, Document
from flatcloth.session.garment import GarmentDecisions, PlacedPiece


def test_each_step_shows_what_the_shape_was(session: OpenedSession) -> None:
    growth = session.growth
    assert [s.view_index for s in growth.steps] == [0, 1, 2]
    assert [s.order for s in growth.steps] == [0, 1, 2]
    pixel_m2 = growth.view.pixel_size_m**2
    for step in growth.steps:
        exact = session.integration.canonical(at_step(session.history.document, step.order)).view
        assert step.area_m2 == pytest.approx(exact.area_m2)
        # On the grid of the whole shape it is the same area, but for a pixel at the rim here and there.
        assert growth.shown_after(step.order).sum() * pixel_m2 == pytest.approx(exact.area_m2, rel=0.02)
    assert (growth.shown_after(2) == growth.view.valid).all()
    assert sum(s.added_m2 for s in growth.steps) == pytest.approx(growth.view.area_m2)


def test_source_steps_are_the_views_of_the_pixels(session: OpenedSession) -> None:
    growth = session.growth
    for step in growth.steps:
        assert (growth.view.view_index[growth.source_step == step.order] == step.view_index).all()
    assert (growth.source_step[~growth.view.valid] == -1).all()
    assert (growth.first_step <= growth.source_step).all()


def test_each_step_knows_the_decision_that_stands(session: OpenedSession) -> None:
    start, first, second = session.growth.steps
    assert start.decision is None
    assert (first.decision.number, first.decision.verdict) == (2, "accepted")  # not the refusal before
    assert second.decision.number == 3


def drawn(session: OpenedSession, *shapes: Canonical) -> Integration:
    """An integration that draws these shapes: of the start view, and with each further view."""

    class Drawn:
        recording, axis = session.integration.recording, session.integration.axis

        def canonical(self, document: Document, _whole: Document | None = None) -> Canonical:
            return shapes[len(document.accepted)]

        def cameras(self, _document: Document) -> None:
            return None

        earlier = canonical

    made = Drawn()
    made.algorithm = made  # type: ignore[attr-defined]
    return cast("Integration", made)


def test_floating_pieces_grow_beside_the_shape_and_join_it(session: OpenedSession) -> None:
    main, piece = sheet(0, 0, 40, 0.0), sheet(1, 0, 30, 0.0)
    far = replace(piece, origin_uv_m=(12.0, 3.0))
    wider = replace(sheet(0, 0, 50, 0.0), origin_uv_m=(0.0, 0.0))

    # The start view; then a piece floats; then the shape is wider.
    one, two, three = (
        Canonical(view=main, current_from_view={}),
        Canonical(view=main, current_from_view={}, floating=(far,)),
        Canonical(view=wider, current_from_view={}, floating=(far,)),
    )
    accepted = (Accepted(1, Rigid2()), Accepted(2, Rigid2()))
    history = replace(session.history, document=Document(start_view=0, accepted=accepted), decisions=())
    growth = grow(drawn(session, one, two, three), history)
    pixel_m2 = main.pixel_size_m**2
    areas = [(s.area_m2, s.floating_m2, s.added_m2) for s in growth.steps]
    np.testing.assert_allclose(
        areas, pixel_m2 * np.array([[800, 0, 800], [800, 600, 600], [1000, 600, 200]]), rtol=1e-9
    )
    assert growth.area_m2 == pytest.approx(1000 * pixel_m2)
    assert int(growth.view.valid.sum()) == 1600
    assert (growth.first_step[growth.sheet.piece == 1] == 1).all()
    on_shape = growth.first_step[growth.sheet.piece == 0]
    assert [int((on_shape == n).sum()) for n in range(3)] == [1000, 0, 0]  # all of it shows view 0


def test_a_piece_placed_by_the_garment_counts_as_shape(session: OpenedSession) -> None:
    main, piece = sheet(0, 0, 40, 0.0), sheet(1, 60, 30, 0.0)
    far = replace(piece, origin_uv_m=(12.0, 3.0))
    canonical = Canonical(view=main, current_from_view={}, floating=(far,))

    onto = Rigid2(0.0, 0.1 - 12.0, -3.0)
    decided = placed_piece(far, main, onto, 0.9, 0.02, accepted=True)
    document = Document(
        start_view=0, accepted=(Accepted(1, Rigid2()),), garment=GarmentDecisions(pieces=(decided,))
    )
    history = replace(session.history, document=document, decisions=())
    growth = grow(drawn(session, canonical, canonical), history)
    pixel_m2 = main.pixel_size_m**2
    assert growth.area_m2 == pytest.approx(1400 * pixel_m2)
    last = growth.steps[-1]
    assert (last.area_m2, last.floating_m2) == pytest.approx((1400 * pixel_m2, 0.0))
    told = dict(_floating(growth.sheet))["Piece B"]
    assert told.startswith("part of the shape")


# --- opening --------------------------------------------------------------------------------------


def test_a_recording_that_moved_is_named(tmp_path: Path) -> None:
    cylinder_session(tmp_path)
    shutil.move(tmp_path / "recording", tmp_path / "elsewhere")
    with pytest.raises(RecordingError, match=r"cannot be opened.*--recording") as caught:
        open_session(tmp_path / "session")
    assert "\n" not in str(caught.value)
    assert open_session(tmp_path / "session", tmp_path / "elsewhere").growth.view.valid.any()
    with pytest.raises(RecordingError, match="nowhere"):
        open_session(tmp_path / "session", tmp_path / "nowhere")
    other = write_cylinder(tmp_path / "other", name="another")
    with pytest.raises(JournalError, match="belongs to another recording"):
        open_session(tmp_path / "session", other)


def test_poses_are_given_where_the_item_stands(session: OpenedSession) -> None:
    last = session.integration.recording.angles_deg[session.growth.steps[-1].view_index]
    assert session.data.frames.rotation_deg == last
    assert session.data.frames.grips[1].opening_m == 0.06


# --- what exports share ---------------------------------------------------------------------------


def test_what_is_kept_is_that_of_the_axis_and_of_the_decisions(session: OpenedSession) -> None:
    axis, document = session.integration.axis, session.history.document
    moved = replace(axis, point_m=axis.point_m + 0.001)
    piece = replace(document.garment, pieces=(cast("PlacedPiece", "a piece"),))
    others = [
        replace(document, accepted=document.accepted[:1]),
        replace(document, accepted=document.accepted[::-1]),
        replace(document, garment=piece),
    ]
    keys = {key_of(axis, document), key_of(moved, document), *(key_of(axis, other) for other in others)}
    assert len(keys) == 5
    # What happened after a shape does not change it.
    later = replace(document, pending=None, finished="done")
    assert key_of(axis, later) == key_of(axis, document)
