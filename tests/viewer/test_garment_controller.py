"""The page's garment without a browser: pieces proposed, placed, refused; `run` places sure ones."""

from __future__ import annotations

import dataclasses
import threading
from types import SimpleNamespace
from typing import Any, cast

import msgspec
import numpy as np
import pytest
from garment_evidence import at_mean, blank_view, evidence_from
from route_client import RouteClient

from flatcloth.core.errors import FlatclothError, GarmentError
from flatcloth.core.types import Rigid2
from flatcloth.engine.garment import KnownGarment, place_sure_pieces
from flatcloth.engine.sheet import lay_out
from flatcloth.export.garment import garment_document, lines_of, outcome_entry
from flatcloth.garments.deciding import DecidedPieces, decided_pieces
from flatcloth.garments.placing import Placed
from flatcloth.garments.recognition import NONE, recognise
from flatcloth.methods.answers import Canonical
from flatcloth.session.document import Accepted, Document
from flatcloth.session.machine import MemorySession, SessionState, Undo
from flatcloth.viewer.modes.doubts import DoubtService
from flatcloth.viewer.modes.garment import GarmentController
from flatcloth.viewer.protocol import messages as asked
from flatcloth.viewer.protocol.picture import Picture, layers_of
from flatcloth.viewer.worker import Executor

LAID = Rigid2(0.0, -4.9, 0.02)
TWO_VIEWS = Document(start_view=0, accepted=(Accepted(1, Rigid2()),))
THREE_VIEWS = Document(start_view=0, accepted=(Accepted(1, Rigid2()), Accepted(2, Rigid2())))


def view_at(u_m: float, rows: int = 40):
    view = blank_view(np.ones((rows, 40), dtype=bool))
    return dataclasses.replace(view, origin_uv_m=(u_m, 0.0), xyz_m=view.xyz_m + np.float32([u_m, 0, 0]))


class Service:
    """Knows a skirt with a small piece whose place is a guess, and a larger one whose place is sure."""

    def __init__(self) -> None:
        evidence = evidence_from(at_mean("skirt"))
        self.canonical = Canonical(
            view=view_at(0.0), current_from_view={}, floating=(view_at(9.0, 20), view_at(5.0))
        )
        found = recognise(self.canonical.view, [evidence])
        piece = Placed(
            index=1, shape_from_piece=LAID, probability=0.97, std_m=0.01, fit_std_m=0.01, fit=found.fit
        )
        hopeless = Placed(
            index=0, shape_from_piece=LAID, probability=0.004, std_m=1.5, fit_std_m=1.5, fit=found.fit
        )
        found = dataclasses.replace(found, pieces=(piece, hopeless))
        nothing = DecidedPieces(shape_from_piece={}, refused=frozenset())
        self._known = KnownGarment(
            canonical=self.canonical, evidence=(evidence,), by_evidence=found, found=found, pieces=nothing
        )
        self.error: Exception | None = None
        self.is_none = False

    def of(self, document: Document) -> KnownGarment:
        if self.error is not None:
            raise self.error
        decided = decided_pieces(document.garment, self.canonical.view, self.canonical.floating)
        found, kind = self._known.found, document.garment.kind
        if kind is not None or self.is_none:
            sure = {**dict.fromkeys(found.probabilities, 0.0), NONE: 1.0}
            found = dataclasses.replace(found, probabilities=sure, by_hand=kind)
        return dataclasses.replace(
            self._known,
            found=found,
            doubt=float(found.kind == NONE and kind is None),
            pieces=decided,
        )

    def known(self, document: Document) -> KnownGarment | str:
        return self.of(document)


@pytest.fixture(scope="module")
def service():
    return Service()


class Page:
    """Stands for the session's thread; jobs are done at once."""

    def __init__(self, service) -> None:
        self.told = threading.Event()
        self.executor = Executor(lambda job: job())
        self.garments, self.publish = service, self.told.set
        self.controller = GarmentController(cast("Any", self))
        self.drawn, self.picture = 0, None
        recording = SimpleNamespace(angles_deg=(0.0, 30.0))
        self.integration = SimpleNamespace(cloth=lambda _: None, method="paper", recording=recording)
        other = SimpleNamespace(made=None, is_working=False)
        self.doubts = DoubtService(cast("Any", self), self.controller, cast("Any", other))

    def draw_again(self) -> None:
        self.drawn += 1

    def follow(self, document: Document = TWO_VIEWS):
        self.told.clear()
        self.controller.follow(document, busy=False)
        assert self.told.wait(20)
        return msgspec.to_builtins(self.controller.info())

    def decide(self, message):
        return self.controller.decision(message)

    def piece(self, document: Document = TWO_VIEWS):
        """The row of the larger piece in the list of what is in doubt, and the choices that it offers."""
        self.follow(document)
        sheet = lay_out(self.garments.canonical)
        picture = SimpleNamespace(revision=1, document=document, sheet=sheet)
        revision = self.doubts.follow(cast("Any", picture))
        row = RouteClient(self.doubts.routes()).get(f"/doubts/{revision}.json").json()["doubts"][0]
        return row, {choice["how"]: n for n, choice in enumerate(row["choices"])}, revision

    def decide_piece(self, how: str):
        _, _, revision = self.piece()
        (command,) = self.doubts.decision(asked.Decide(revision=revision, index=0, how=how))
        return command


@pytest.fixture
def page(service):
    made = Page(service)
    yield made
    made.executor.stop()


def test_a_floating_piece_is_listed_with_the_file_that_holds_it(service) -> None:
    sheet = lay_out(service.canonical)
    about: Any = {"revision": 0, "legends": {}, "cloud": None, "document": TWO_VIEWS}
    pieces = layers_of(Picture(view=sheet.view, sheet=sheet, **about)).pieces
    assert [(one.label, one.file) for one in pieces] == [("B", "floating-2.npz"), ("C", "floating-1.npz")]


def test_a_piece_is_proposed_with_its_probability_and_where_it_would_lie(page) -> None:
    row, choices, _ = page.piece()
    # B is the larger one, though it is the second file; of the other piece the place is surely wrong.
    assert (row["title"], set(choices)) == ("B", {"hand", "place", "cut"})
    there = row["choices"][choices["place"]]
    assert (there["probability"], there["std_mm"]) == (pytest.approx(0.97), pytest.approx(10.0))
    motion = Rigid2(**there["placement"])
    corner = np.min(motion.apply(np.concatenate(row["outline_uv_m"])), axis=0)
    np.testing.assert_allclose(corner, [0.1, 0.02], atol=0.003)


@pytest.mark.parametrize("accepted", [True, False])
def test_a_decision_about_a_piece_is_told_and_undone(page, accepted) -> None:
    command = page.decide_piece("place" if accepted else "cut")
    assert command.accepted is accepted
    session = MemorySession(SessionState(n_views=3, document=TWO_VIEWS))
    session.record(command)
    row, choices, _ = page.piece(session.state.document)
    assert ("cut" in choices, "You refused" in row["note"]) == (accepted, not accepted)
    assert sum(choice["probability"] or 0.0 for choice in row["choices"]) == pytest.approx(1.0)
    session.record(Undo())
    _, choices, _ = page.piece(session.state.document)
    assert "cut" in choices


def test_a_list_is_decided_by_until_the_shape_changes_even_when_more_became_known(page) -> None:
    _, _, revision = page.piece()
    page.controller.forget()
    assert page.piece()[2] > revision
    assert page.doubts.decision(asked.Decide(revision=revision, index=0, how="cut"))
    page.piece(THREE_VIEWS)
    with pytest.raises(FlatclothError, match="look again"):
        page.doubts.decision(asked.Decide(revision=revision, index=0, how="cut"))


def test_what_is_not_there_is_refused_in_words(page) -> None:
    with pytest.raises(FlatclothError, match="recognised"):
        page.decide(asked.SetKind(kind="skirt"))
    page.follow()
    for message in (asked.SetKind(kind="sock"), asked.HoldPoint(name="crotch", u_m=0.0, v_m=0.0)):
        with pytest.raises(FlatclothError, match=r"no (kind|point)"):
            page.decide(message)
    unseen = next(p.name for p in page.controller.info().found.points if not p.seen)
    with pytest.raises(FlatclothError, match="predicted only"):
        page.controller.seen_point(unseen)


def test_nothing_is_recognised_of_one_view_or_while_auto_runs_and_a_reason_is_told(page, service) -> None:
    page.controller.follow(TWO_VIEWS, busy=True)
    page.controller.follow(Document(start_view=0), busy=False)
    assert not page.controller.info().working
    service.error = GarmentError("The shape has 20 cm2 of cloth.")
    try:
        said = page.follow()
    finally:
        service.error = None
    assert (said["found"], said["text"]) == (None, "The shape has 20 cm2 of cloth.")


def test_while_auto_changes_the_shape_nothing_is_decided_by_the_garment_of_an_earlier_one(page) -> None:
    page.piece()
    page.controller.follow(THREE_VIEWS, busy=True)
    assert page.controller.info().working
    assert page.controller.current is None
    page.controller.follow(TWO_VIEWS, busy=True)
    assert not page.controller.info().working
    assert page.controller.current is not None


def test_run_places_sure_pieces_once_and_leaves_refused_ones(service) -> None:
    session = MemorySession(SessionState(n_views=3, document=TWO_VIEWS))
    known = place_sure_pieces(service, session)
    assert outcome_entry(known)["placed_by_the_garment"] == ["floating-2.npz"]
    assert "Floating pieces placed by the garment: 2." in lines_of(known)
    assert garment_document(known)["pieces"]["floating-2.npz"]["placed"]
    assert [item.name for item in session.state.undo] == ["place a piece by the garment"]
    place_sure_pieces(service, session)
    assert len(session.state.undo) == 1
    (piece,) = session.state.document.garment.pieces
    session.record(dataclasses.replace(piece, accepted=False))
    known = place_sure_pieces(service, session)
    assert outcome_entry(known)["placed_by_the_garment"] == []
    assert not garment_document(known)["pieces"]["floating-2.npz"]["placed"]


def test_the_shape_is_drawn_again_when_no_kind_explains_it_and_when_its_kind_is_set_by_hand(service) -> None:
    page = Page(service)
    page.follow()
    assert page.drawn == 0
    service.is_none = True
    try:
        for kind, doubts in [(None, 1), (NONE, 2), ("towel", 2), (None, 3)]:
            page.controller.forget()
            decided = dataclasses.replace(TWO_VIEWS.garment, kind=kind)
            page.follow(dataclasses.replace(TWO_VIEWS, garment=decided))
            assert page.drawn == doubts
    finally:
        service.is_none = False
    page.controller.forget()
    page.follow()
    assert page.drawn == 4
