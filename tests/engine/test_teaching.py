"""The stages of the method, computed beside a session: the same as the paper's method, step by step."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import Cylinder

from flatcloth.core.errors import AlignmentError
from flatcloth.engine.integration import Integration
from flatcloth.engine.teaching import Teaching, paper_config
from flatcloth.methods.registry import method_names
from flatcloth.session.document import Document, Pending
from flatcloth.session.machine import Request

ANGLES_DEG = tuple(10.0 * n for n in range(36))
CLOTH = {"angles_deg": ANGLES_DEG, "span_deg": (-150.0, 60.0)}


@pytest.fixture(scope="module")
def session() -> Integration:
    return Integration(Cylinder(**CLOTH))


@pytest.fixture(scope="module")
def teaching(session: Integration) -> Teaching:
    return Teaching(session)


@pytest.fixture(scope="module")
def paper(session: Integration, teaching: Teaching) -> Integration:
    """The paper's method by itself, with the numbers of the lessons."""
    return Integration(Cylinder(**CLOTH), paper_config(session.config, teaching.defaults), "paper")


@pytest.mark.parametrize("method", method_names())
def test_the_rotation_is_the_papers_whatever_the_method_of_the_session(paper, method):
    lessons = Teaching(Integration(Cylinder(**CLOTH), method=method))
    plan = lessons.planning(0, lessons.defaults).plan
    expected = paper.plan(Document(start_view=0))
    assert (plan.view_index, plan.side, plan.rotation_deg) == (
        expected.view_index, expected.side, expected.rotation_deg
    )  # fmt: skip
    assert plan.view_index is not None


def test_the_alignment_is_the_papers_step_by_step(teaching, paper):
    lesson = teaching.alignment(0, teaching.defaults)
    document = Document(start_view=0)
    event = paper.answer(document, Request(0, "propose"))
    pending = Pending(event.view_index, event.current_from_new, event.side, component=event.component)
    expected = paper.proposal(replace(document, pending=pending)).alignment
    alignment = lesson.proposal.alignment
    assert lesson.view_index == lesson.planned_view == event.view_index
    assert alignment.initial == expected.initial
    assert alignment.current_from_new == expected.current_from_new
    assert alignment.score == expected.score


def test_the_search_leads_from_the_initial_estimate_to_its_end_which_is_proposed_if_it_scores_more(teaching):
    lesson = teaching.alignment(0, teaching.defaults)
    search, alignment = lesson.search, lesson.proposal.alignment
    assert search.motions[0].apply(np.eye(2)) == pytest.approx(alignment.initial.apply(np.eye(2)))
    if search.end_score >= alignment.initial_score.total:
        end = search.motions[-1].apply(np.eye(2))
        assert end == pytest.approx(alignment.current_from_new.apply(np.eye(2)))
        assert search.end_score == pytest.approx(alignment.score.total)
    else:
        assert alignment.current_from_new == alignment.initial
    assert len(search.motions) == len(search.path) == len({tuple(p) for p in search.path})
    assert search.path[0] == pytest.approx([0, 0, 0])
    assert search.cost.shape == (search.turns_rad.size, search.shifts_m.size, search.shifts_m.size)
    assert search.tried > search.cost.size
    # The coarse search starts its detailed ones at its best places.
    t, u, v = np.unravel_index(np.argmin(search.cost), search.cost.shape)
    best = [search.turns_rad[t], search.shifts_m[u], search.shifts_m[v]]
    assert any(np.allclose(start, best) for start in search.starts)


def test_a_recording_with_nothing_to_add_says_so():
    lessons = Teaching(Integration(Cylinder()))
    with pytest.raises(AlignmentError, match="no view remains"):
        lessons.alignment(0, lessons.defaults)
