"""The stages of the method, computed beside a session: the same as the paper's method, step by step."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import Cylinder

from flatcloth.core.errors import AlignmentError, CancelledError, ConfigError
from flatcloth.core.types import Rigid2
from flatcloth.engine.integration import Integration
from flatcloth.engine.teaching import (
    KEPT,
    NEW,
    NEW_OF_BOTH,
    OLD_OF_BOTH,
    Teaching,
    paper_config,
    unused_pairs,
)
from flatcloth.methods.registry import method_names
from flatcloth.session.document import Document, Pending
from flatcloth.session.machine import Request

CLOTH = {"angles_deg": tuple(10.0 * n for n in range(36)), "span_deg": (-150.0, 60.0)}


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


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"sampling_interval_px": 3}, "d, the sampling interval"),
        ({"z_angle_limit_deg": 90.0}, "A_w, the measurement limit"),
        ({"overlap_cm2": 0.0}, "S_0, the desirable overlap"),
        ({"overlap_cm2": float("nan")}, "S_0, the desirable overlap"),
    ],
)
def test_a_number_that_cannot_be_shown_is_named(teaching, change, named):
    with pytest.raises(ConfigError, match=named):
        replace(teaching.defaults, **change)


def test_every_neighbour_is_a_pair_or_an_unused_pair(teaching):
    for level in teaching.paper(teaching.defaults).views.flattening(0).levels:
        rc, d = level.points_rc, level.sampling_interval_px
        used = {tuple(sorted(map(int, pair))) for pair in level.edges}
        left_out = {tuple(sorted(map(int, pair))) for pair in unused_pairs(level)}
        place = {tuple(p): n for n, p in enumerate(rc.tolist())}
        neighbours = {
            tuple(sorted((n, place[r + dr, c + dc])))
            for (r, c), n in place.items()
            for dr, dc in ((0, d), (d, 0), (d, d), (d, -d))
            if (r + dr, c + dc) in place
        }
        assert used.isdisjoint(left_out)
        assert used | left_out == neighbours


@pytest.mark.parametrize("method", method_names())
def test_the_rotation_is_the_papers_whatever_the_method_of_the_session(paper, method):
    lessons = Teaching(Integration(Cylinder(**CLOTH), method=method))
    plan = lessons.paper(lessons.defaults).plan(Document(start_view=0))
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
    search, alignment = lesson.search, lesson.alignment
    assert lesson.view_index == event.view_index
    assert alignment.initial == expected.initial
    assert alignment.current_from_new == expected.current_from_new
    assert alignment.score == expected.score
    # The search leads from the initial estimate to its end, which is proposed if it scores more.
    assert search.motions[0].apply(np.eye(2)) == pytest.approx(alignment.initial.apply(np.eye(2)))
    if search.end_score >= alignment.initial_score.total:
        end = search.motions[-1].apply(np.eye(2))
        assert end == pytest.approx(alignment.current_from_new.apply(np.eye(2)))
        assert search.end_score == pytest.approx(alignment.score.total)
    else:
        assert alignment.current_from_new == alignment.initial
    assert len(search.motions) == len(search.path) == len({tuple(p) for p in search.path})
    assert search.path[0] == pytest.approx([0, 0, 0])
    assert search.tried > search.cost.size
    # The coarse search starts its detailed ones at its best places.
    t, u, v = np.unravel_index(np.argmin(search.cost), search.cost.shape)
    best = [search.turns_rad[t], search.shifts_m[u], search.shifts_m[v]]
    assert any(np.allclose(start, best) for start in search.starts)


def test_the_renewed_view_tells_which_view_shows_each_pixel(teaching):
    lesson = teaching.alignment(0, teaching.defaults)
    view, origin, added = lesson.renewed.view, lesson.origin, lesson.view_index
    assert np.array_equal(origin > 0, view.valid)
    assert np.array_equal(np.isin(origin, (NEW, NEW_OF_BOTH)), view.view_index == added)
    assert np.array_equal(np.isin(origin, (KEPT, OLD_OF_BOTH)), view.view_index == 0)
    assert all(np.any(origin == kind) for kind in (KEPT, NEW, NEW_OF_BOTH))
    # The plane is that of the new view: what it alone shows lies where it lay.
    assert lesson.renewed.current_from_view[added] == Rigid2()


def test_a_lesson_that_cannot_be_made_says_so_and_one_can_be_given_up(session):
    alone, lessons = Teaching(Integration(Cylinder())), Teaching(session)
    with pytest.raises(AlignmentError, match="no view remains"):
        alone.alignment(0, alone.defaults)

    def stop(_share: float, _text: str) -> None:
        raise CancelledError

    with pytest.raises(CancelledError):
        lessons.start_view(stop)
    with pytest.raises(CancelledError):
        lessons.alignment(0, lessons.defaults, stop)
    assert lessons.alignment(0, lessons.defaults).view_index > 0
