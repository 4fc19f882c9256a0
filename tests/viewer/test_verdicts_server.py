"""Deciding, headless: skip, reopen with what follows, scores that are kept, names of undo and redo."""

from __future__ import annotations

import pytest
from page_tabs import Tab

from flatcloth.session.machine import Accept, Cancel, Followed, Reject, Reopen
from flatcloth.viewer.server.app import PageServer
from flatcloth.viewer.server.workspace import Opened


def views(state, *indices):
    return [state["views"][i]["state"] for i in indices]


def action(state, name):
    return next(a for a in state["actions"] if a["name"] == name)


def accepted(tab, count):
    """Step and accept so many views, the first of which are 1, 2 and 3."""
    tab.ready()
    for view in range(1, count + 1):
        tab.say(type="do", action="step")
        tab.state_where(lambda s: s["pending"] and s["layers"]["overlay"])
        tab.say(type="do", action="accept", view_index=view)
        tab.state_where(lambda s, view=view: s["phase"] == "ready" and s["step"] == view + 1)


def test_skip_puts_a_view_off_and_step_goes_on_with_another(server):
    with Tab(server) as tab:
        tab.proposed()
        tab.say(type="do", action="skip", view_index=1)
        state = tab.state_where(lambda s: s["pending"] is None)
        assert views(state, 1) == ["skipped"]
        assert state["undo"] == "skip view 1"
        tab.say(type="do", action="step")
        state = tab.state_where(lambda s: s["pending"])
    assert state["pending"]["view_index"] == 2


def test_the_score_of_where_it_lay_is_kept_with_an_accepted_view(server, folder):
    with Tab(server) as tab:
        tab.proposed()
        tab.say(type="move", view_index=1, u_m=0.010)
        tab.state_where(lambda s: s["pending"]["score"] and abs(s["pending"]["score"] - 0.7) < 1e-6)
        tab.say(type="do", action="accept", view_index=1)
        state = tab.state_where(lambda s: s["step"] == 2)
    assert state["views"][1]["score"] == pytest.approx(0.7)
    assert folder.recorded[-1] == Accept(1, pytest.approx(0.7))


def test_a_reopened_view_is_asked_and_the_later_ones_follow_its_verdict(server, folder):
    with Tab(server) as tab:
        accepted(tab, 3)
        assert tab.state["views"][1]["follows"] == 2
        tab.say(type="do", action="reopen", view_index=1)
        state = tab.state_where(lambda s: s["pending"] and s["layers"]["overlay"])
        assert views(state, 1, 2, 3) == ["pending", "later", "later"]
        assert (state["pending"]["again"], state["n_later"]) == (True, 2)
        tab.say(type="do", action="reject", view_index=1)
        state = tab.state_where(lambda s: s["phase"] == "ready" and not s["n_later"])
    assert views(state, 1, 2, 3) == ["rejected", "accepted", "accepted"]
    assert [type(c) for c in folder.recorded[-2:]] == [Followed, Followed]


def test_what_no_longer_holds_is_told_and_asked_again_and_undo_brings_all_back(server, integration, folder):
    with Tab(server) as tab:
        accepted(tab, 3)
        before = folder.state.document
        integration.follow_score = 0.1
        tab.say(type="do", action="reopen", view_index=1)
        tab.state_where(lambda s: s["pending"])
        tab.say(type="do", action="reject", view_index=1)
        state = tab.state_where(lambda s: s["pending"] and s["pending"]["view_index"] == 2 and s["log"])
        assert views(state, 1, 2, 3) == ["rejected", "pending", "later"]
        assert state["pending"]["why"] == "No longer sure."
        assert state["log"][-1]["text"] == "View 2 is asked again. No longer sure."
        tab.say(type="do", action="undo")
        tab.say(type="do", action="undo")
        tab.state_where(lambda s: views(s, 1, 2, 3) == ["accepted"] * 3)
    assert folder.state.document == before


def test_undo_and_redo_tell_their_names(server):
    with Tab(server) as tab:
        accepted(tab, 1)
        assert action(tab.state, "undo")["description"] == "Undo: accept view 1."
        assert action(tab.state, "redo")["why_not"] == "There is nothing to redo."
        tab.say(type="do", action="undo")
        tab.until(lambda _: tab.notes and tab.state["redo"] == "accept view 1")
        assert action(tab.state, "redo")["description"] == "Redo: accept view 1."
        tab.say(type="do", action="redo")
        tab.until(lambda _: len(tab.notes) == 2)
    assert [n["text"] for n in tab.notes] == ["Undone: accept view 1.", "Redone: accept view 1."]


def test_what_cannot_be_reopened_is_told(server):
    with Tab(server) as tab:
        tab.ready()
        tab.say(type="do", action="reopen", view_index=0)
        assert "is the start view" in tab.note()["text"]
        tab.say(type="do", action="reopen")
        assert tab.note()["text"] == "Action 'reopen' needs a view_index."
        assert action(tab.state, "lowest_score")["why_not"] == "No view has been accepted yet."
        assert action(tab.state, "reopen")["why_not"] == "There is no decision to reopen."


def test_a_program_that_was_killed_while_views_followed_goes_on_with_them(integration, folder):
    with PageServer(Opened(integration, folder), port=0) as server, Tab(server) as tab:
        accepted(tab, 3)
    # The last is what resuming a journal does with work that nobody does any more.
    for step in (Reopen(1), Reject(1), Cancel()):
        folder.record(step)
    assert len(folder.state.document.later) == 2
    with PageServer(Opened(integration, folder), port=0) as server, Tab(server) as tab:
        state = tab.state_where(lambda s: s["phase"] == "ready" and not s["n_later"])
    assert views(state, 1, 2, 3) == ["rejected", "accepted", "accepted"]
