"""The operator's state machine, by examples; test_session_machine.py has its laws."""

import math
from dataclasses import replace

import pytest
from journal_script import STROKE, THREE, after, at

from flatcloth.core.errors import IllegalDecisionError
from flatcloth.core.strokes import ImageStroke, SpaceStroke
from flatcloth.core.types import Rigid2
from flatcloth.session.document import UNSURE, Document, Pending, PlacedPart, Side
from flatcloth.session.machine import (
    Accept,
    AcceptAll,
    Cancel,
    Command,
    Event,
    Failed,
    NothingMore,
    Nudge,
    Propose,
    Proposed,
    Redo,
    Reject,
    Reopen,
    Restart,
    SessionState,
    Skip,
    Start,
    Started,
    TakePart,
    Undo,
    apply,
    why_illegal,
)

Steps = tuple[Command | Event, ...]

STARTED, PENDING = THREE[:2], THREE[:4]
ENDED = (*STARTED, Propose(), NothingMore(2, "The turn is complete."))
HUNG = (*STARTED, AcceptAll((3, 5), ((4, "it shows nothing"),)))
REOPENED = (*THREE, Reopen(1))
SKIPPED = (
    *PENDING,
    Skip(1),
    Propose(2),
    Proposed(3, 2, at(0.2)),
    Skip(2),
    Propose(1),
    Proposed(4, 1, at(0.1)),
)
THIS = ImageStroke(side="this", view_index=1, points_rc=((1.0, 2.0), (3.0, 4.0)))
OTHER = SpaceStroke(side="other", points_m=((0.0, 0.1, 0.8),), normals=((0.0, 0.0, -1.0),))


def told(state: SessionState) -> str:
    """What a session waits for, the views of its shape, and what became of the others."""
    document, request, pending = state.document, state.request, state.document.pending
    parts = {
        "": [str(state.phase)] if request is None else [request.kind, request.view_index],
        "shape": document.views_in_order,
        "asks": [] if pending is None else [pending.view_index],
        "rejected": [f"{each.view_index} ({each.reason})" for each in document.rejected],
        "skipped": [each.view_index for each in document.skipped],
        "refused": sorted(document.refused_views),
        "end:": [document.finished] if document.finished else [],
        "strokes": [len(document.strokes)] if document.strokes else [],
    }
    return "; ".join(" ".join([name, *map(str, words)]).strip() for name, words in parts.items() if words)


TOLD: list[tuple[Steps, str]] = [
    ((Start(4),), "start 4"),
    ((Start(4), Started(1, 4)), "ready; shape 4"),
    ((Start(), Started(7, 4)), "start None"),
    ((*STARTED, Propose()), "propose None; shape 0"),
    (PENDING, "deciding; shape 0; asks 1"),
    ((*PENDING, Accept(1)), "ready; shape 0 1"),
    # A refusal keeps its reason, until the view is chosen by hand.
    ((*PENDING, Reject(1, "bad depth")), "ready; shape 0; rejected 1 (bad depth); refused 1"),
    ((*PENDING, Reject(1), Propose(1), Proposed(3, 1, at(0.0)), Accept(1)), "ready; shape 0 1"),
    # One that was unsure, or skipped, comes again once the shape has grown.
    ((*PENDING, Reject(1, UNSURE)), "ready; shape 0; rejected 1 (score too low); refused 1"),
    (
        (*PENDING, Reject(1, UNSURE), Propose(4), Proposed(3, 4, at(0.0)), Accept(4)),
        "ready; shape 0 4; rejected 1 (score too low)",
    ),
    ((*PENDING, Skip(1)), "ready; shape 0; skipped 1; refused 1"),
    ((*PENDING, Skip(1), Propose(), Proposed(3, 2, at(0.2)), Accept(2)), "ready; shape 0 2; skipped 1"),
    ((*SKIPPED, Skip(1)), "ready; shape 0; skipped 2 1; refused 1 2"),
    ((*SKIPPED, Accept(1)), "ready; shape 0 1; skipped 2"),
    # Another view is chosen, and undo brings the proposal back.
    ((*PENDING, Propose(5)), "propose 5; shape 0"),
    ((*PENDING, Propose(5), Proposed(3, 5, at(0.0)), Undo()), "deciding; shape 0; asks 1"),
    ((*PENDING, Accept(1), Restart(5)), "start 5"),
    ((*PENDING, Accept(1), Restart(5), Started(3, 5), Undo()), "ready; shape 0 1"),
    ((*PENDING, Accept(1), Restart(5), Started(3, 5), Undo(), Redo()), "ready; shape 5"),
    # What is given up may be asked again; its late answer says nothing.
    ((*PENDING, Accept(1), Propose(), Undo(), Proposed(3, 4, at(0.0))), "deciding; shape 0; asks 1"),
    ((*STARTED, Propose(), Cancel()), "ready; shape 0"),
    ((*STARTED, Propose(), Failed(2), Propose()), "propose None; shape 0"),
    # After the end a view that is chosen by hand goes on.
    (ENDED, "finished; shape 0; end: The turn is complete."),
    ((*ENDED, Propose(4), Proposed(3, 4, at(0.0))), "deciding; shape 0; asks 4"),
    ((*ENDED, Propose(4), Proposed(3, 4, at(0.0)), Undo()), "finished; shape 0; end: The turn is complete."),
    ((*THREE, Propose(), NothingMore(5, "All."), Reopen(2)), "deciding; shape 0 1 3; asks 2"),
    # Many views at once; one of them has no placement to go back to, so it is proposed again.
    (HUNG, "ready; shape 0 3 5; rejected 4 (it shows nothing); refused 4"),
    ((*HUNG, Undo()), "ready; shape 0"),
    ((*ENDED, AcceptAll((3,))), "ready; shape 0 3"),
    ((*HUNG, Reopen(3)), "propose 3; shape 0 5; rejected 4 (it shows nothing); refused 4"),
    (
        (*HUNG, Reopen(3), Proposed(2, 3, at(0.0)), Reject(3)),
        "ready; shape 0 5; rejected 4 (it shows nothing) 3 (wrong place); refused 3 4",
    ),
    # A reopened view is asked again; no other decision changes.
    (REOPENED, "deciding; shape 0 2 3; asks 1"),
    ((*REOPENED, Accept(1, 0.5)), "ready; shape 0 2 3 1"),
    ((*REOPENED, Skip(1)), "ready; shape 0 2 3; skipped 1; refused 1"),
    ((*REOPENED, Reject(1), Undo(), Undo()), "ready; shape 0 1 2 3"),
    ((*THREE, Reopen(2), Propose(5), Proposed(5, 5, at(0.5)), Accept(5)), "ready; shape 0 1 3 5"),
    ((*THREE, Reopen(3), Reopen(1)), "deciding; shape 0 2; asks 1"),
    # A part of an accepted view is placed elsewhere in one decision, wherever it hung.
    ((*THREE, TakePart(2, 1, at(0.5))), "deciding; shape 0 1 3; asks 2"),
    ((*STARTED, AcceptAll((3, 5)), TakePart(3, 0, at(0.5)), Accept(3)), "ready; shape 0 5 3"),
    ((*STARTED, AcceptAll((3, 5)), TakePart(3, 0, at(0.5)), Undo()), "ready; shape 0 3 5"),
    ((*PENDING, Reject(1), Propose(), Proposed(3, 2, at(0.2)), Accept(2), Reopen(1)), "propose 1; shape 0 2"),
    ((*PENDING, Skip(1), Propose(2), Proposed(3, 2, at(0.2)), Accept(2), Reopen(1)), "propose 1; shape 0 2"),
    # A stroke drops a proposal, whose view may show other cloth; a restart keeps it.
    ((Start(4), THIS), "start 4; strokes 1"),
    ((*PENDING, STROKE), "ready; shape 0; strokes 1"),
    ((*THREE, THIS), "ready; shape 0 1 2 3; strokes 1"),
    ((*REOPENED, OTHER), "ready; shape 0 2 3; strokes 1"),
    ((*THREE, OTHER, Undo()), "ready; shape 0 1 2 3"),
    ((*THREE, OTHER, Restart()), "start None; strokes 1"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("steps", "expected"), TOLD, ids=lambda given: given if isinstance(given, str) else ""
)
def test_a_session_says_what_it_waits_for_and_what_became_of_each_view(steps: Steps, expected: str) -> None:
    assert told(after(*steps)) == expected


@pytest.mark.parametrize(
    ("steps", "names"),
    [
        (REOPENED, ["accept view 1", "accept view 2", "accept view 3", "reopen view 1"]),
        ((*PENDING, Nudge(1, at(0.05), "fit pairs of"), Skip(1)), ["fit pairs of view 1", "skip view 1"]),
        ((*PENDING, TakePart(1, 2, at(0.4)), Reject(1)), ["take part 3 of view 1", "reject view 1"]),
        ((THIS, OTHER), ["stroke: this side on view 1", "stroke: not this side"]),
        ((STROKE,), ["stroke: not this side"]),
        ((*HUNG, Reopen(5)), ["accept 2 views", "reopen view 5"]),
        ((*PENDING, Propose(5)), ["choose view 5 instead of 1"]),
        ((*ENDED, Propose(4)), ["go on with view 4"]),
    ],
)  # fmt: skip
def test_decisions_have_names(steps: Steps, names: list[str]) -> None:
    assert [item.name for item in after(*steps).undo] == names


ILLEGAL: list[tuple[Steps, Command, str]] = [
    ((), Undo(), "nothing to undo"),
    ((), Redo(), "nothing to redo"),
    ((*PENDING, Accept(1), Undo(), Skip(1)), Redo(), "nothing to redo"),
    ((), Cancel(), "Nothing is being computed"),
    ((), Propose(), "no start view"),
    ((), Accept(3), "no start view"),
    ((), Reopen(1), "no start view"),
    ((), Start(6), "View 6 does not exist"),
    ((), Restart(-1), "View -1 does not exist"),
    ((Start(),), Start(), "computation is running"),
    ((Start(),), Propose(), "computation is running"),
    (STARTED, Start(), "has started"),
    (STARTED, Propose(0), "already part of the shape"),
    (STARTED, Accept(3), "no proposal"),
    (PENDING, Propose(), "Decide about view 1 first"),
    (PENDING, Accept(4), "it is view 1 now, not 4"),
    (PENDING, Reject(4), "it is view 1 now, not 4"),
    (PENDING, Nudge(4, Rigid2()), "it is view 1 now, not 4"),
    (PENDING, Nudge(1, Rigid2(math.nan, 0, 0)), "finite"),
    (PENDING, TakePart(1, 2, Rigid2(math.nan, 0, 0)), "finite"),
    ((*PENDING, Reject(1)), TakePart(1, 2, Rigid2()), "no proposal"),
    ((*PENDING, Accept(1)), Accept(1), "no proposal"),  # the second click of a double click
    ((*PENDING, Accept(1), Propose()), Accept(1), "computation is running"),
    (ENDED, Propose(), "The turn is complete."),
    (STARTED, AcceptAll((3, 3)), "twice"),
    (STARTED, AcceptAll((3,), ((3, ""),)), "twice"),
    (STARTED, AcceptAll((0,)), "already part"),
    (STARTED, AcceptAll((99,)), "does not exist"),
    (STARTED, AcceptAll((-1,)), "does not exist"),
    (PENDING, AcceptAll((5,)), "Decide about view 1 first"),
    (STARTED, Reopen(9), "does not exist"),
    (STARTED, Reopen(0), "is the start view"),
    (STARTED, Reopen(1), "Nothing was decided about view 1"),
    (PENDING, Reopen(1), "is the proposal already"),
    ((*PENDING, Reject(1), Propose(1), Proposed(3, 1, at(0.1))), Reopen(1), "is the proposal already"),
    ((*THREE, Propose()), Reopen(1), "computation is running"),
    (STARTED, replace(THIS, view_index=6), "View 6 does not exist; there are 6 views"),
]


@pytest.mark.parametrize(("steps", "command", "reason"), ILLEGAL)
def test_a_decision_that_is_not_allowed_says_why(steps: Steps, command: Command, reason: str) -> None:
    state = after(*steps)
    assert reason in (why_illegal(state, command) or "")
    with pytest.raises(IllegalDecisionError, match=reason):
        apply(state, command)


def test_nudges_add_up_on_the_plane_of_the_current_view_and_mark_the_placement_as_fixed() -> None:
    first, second = Rigid2(0.0, 0.01, 0.0), Rigid2(math.pi / 2, 0.0, 0.0)
    proposed = Proposed(2, 3, Rigid2(0.1, 0.2, 0.3), Side.LEFT, 0.8)
    steps = (*STARTED, Propose(), proposed)
    (as_proposed,) = after(*steps, Accept(3)).document.accepted
    assert (as_proposed.side, as_proposed.fixed, as_proposed.current_from_new) == (
        Side.LEFT, False, proposed.current_from_new,
    )  # fmt: skip
    (accepted,) = after(*steps, Nudge(3, first), Nudge(3, second), Accept(3)).document.accepted
    assert accepted.fixed
    expected = second @ (first @ proposed.current_from_new)
    assert accepted.current_from_new.apply([1.0, 2.0]) == pytest.approx(expected.apply([1.0, 2.0]))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("by", "moved"),
    [
        (Rigid2(1e-9, 4e-5, 1e-17), False),
        (Rigid2(0.0, 1e-4, 0.0), True),
        (Rigid2(math.radians(0.1), 0.0, 0.0), True),
    ],
)
def test_a_move_that_the_page_shows_as_none_is_no_placement_by_hand(by: Rigid2, moved: bool) -> None:
    assert replace(Pending(1, Rigid2()), nudge=by).moved is moved


@pytest.mark.parametrize(
    ("steps", "score"),
    [
        ((Accept(1),), 0.9),
        ((Accept(1, 0.4),), 0.4),
        ((Nudge(1, at(0.01)), Accept(1, 0.4)), 0.4),
        ((Nudge(1, at(0.01)), Accept(1)), None),  # that of the proposal is not that of the place
    ],
)
def test_an_accepted_view_keeps_the_score_of_where_it_was_accepted(steps: Steps, score: float | None) -> None:
    assert after(*PENDING, *steps).document.accepted[0].score == score


def test_a_reopened_view_is_asked_about_where_it_lay() -> None:
    pending = after(*REOPENED).document.pending
    assert (pending.current_from_new, pending.score) == (at(0.1), 0.9)
    # Moved by hand once, it is so when it is accepted where it lay.
    again = (*PENDING, Nudge(1, at(0.05)), Accept(1), Reopen(1), Accept(1))
    assert after(*again).document.accepted[0].fixed


def test_what_lies_on_a_view_that_is_gone_lies_there_on_the_one_below_and_that_one_is_placed_again() -> None:
    part = PlacedPart(0, 1, at(0.03))
    second, third = (
        Proposed(token, view, Rigid2(0.5, 0.1 * view, 0.0), also=(part,), on=view - 1)
        for token, view in ((3, 2), (4, 3))
    )
    state = after(*PENDING, Accept(1), Propose(), second, Accept(2), Propose(), third, Accept(3), Reopen(2))
    assert (state.request.kind, state.request.view_index) == ("propose", 2)
    (_, last) = state.document.accepted
    motion = second.current_from_new
    assert (last.on, last.current_from_new) == (1, motion @ third.current_from_new)
    assert last.also == (replace(part, current_from_new=motion @ part.current_from_new),)


def test_another_part_is_placed_where_it_is_put_and_back_at_its_hypothesis_is_not_moved() -> None:
    (accepted,) = after(*PENDING, TakePart(1, 2, at(0.4)), Accept(1)).document.accepted
    assert (accepted.component, accepted.current_from_new.u_m, accepted.fixed) == (
        2,
        pytest.approx(0.4),
        True,
    )
    (accepted,) = after(*PENDING, TakePart(1, 2, at(0.1)), Accept(1)).document.accepted
    assert (accepted.component, accepted.fixed) == (2, False)


ALSO = (PlacedPart(3, 1, Rigid2(0.0, 0.5, 0.0)), PlacedPart(0, 4, Rigid2(0.0, 0.0, 0.7)))
SEVERAL = (*STARTED, Propose(), Proposed(2, 3, Rigid2(0.0, 0.2, 0.0), Side.LEFT, 0.8, also=ALSO))


def placed_with(document: Document) -> tuple[PlacedPart, ...]:
    """The further parts of the only accepted view or of the proposal."""
    return (document.pending or document.accepted[0]).also


@pytest.mark.parametrize(
    ("steps", "also"),
    [
        ((Accept(3),), ALSO),
        ((Accept(3), Undo()), ALSO),
        ((Accept(3), Reopen(3)), ALSO),
        ((TakePart(3, 2, Rigid2()), Accept(3)), ()),
    ],
)
def test_further_parts_go_with_the_view_that_they_were_proposed_with(
    steps: Steps, also: tuple[PlacedPart, ...]
) -> None:
    assert placed_with(after(*SEVERAL, *steps).document) == also


def test_a_nudge_moves_further_parts_along_and_they_are_parts_of_their_views() -> None:
    document = after(*SEVERAL, Nudge(3, Rigid2(math.pi / 2, 0.01, 0.0)), Accept(3)).document
    moved, _ = placed_with(document)
    assert moved.current_from_new.apply([0.0, 0.0]) == pytest.approx([0.01, 0.5])  # type: ignore[arg-type]
    assert [document.components_of(view) for view in (0, 1, 3)] == [{0, 4}, set(), {0, 1}]
    assert after(*SEVERAL, Reject(3)).document.accepted == ()


def test_what_can_be_reopened_is_not_the_proposal_and_the_shape_depends_on_strokes() -> None:
    asked = after(*PENDING, Reject(1), Propose(1), Proposed(3, 1, at(0.1)))
    assert asked.document.reopenable_views == frozenset()
    assert after(*THREE, Reopen(3)).document.reopenable_views == {1, 2}
    assert after(*STARTED).document.shape_key != after(*STARTED, THIS).document.shape_key
