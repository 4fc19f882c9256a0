"""The other side on the page, headless: computed when asked for, hovered, picked, and its seams decided."""

from __future__ import annotations

import threading
from dataclasses import replace

import numpy as np
import pytest
from page_tabs import Has, Tab, get, leads_to
from viewer_fakes import HEIGHT_M, CylinderIntegration, cylinder_view

from flatcloth.core.types import FlattenedView, LaidPiece, Rigid2
from flatcloth.methods.answers import Canonical, JoinedSides, Seam
from flatcloth.viewer.modes.session import Application
from flatcloth.viewer.server.app import PageServer
from flatcloth.viewer.server.workspace import Opened

PLACES = np.stack([np.zeros(40), np.linspace(0.02, HEIGHT_M - 0.02, 40)], axis=1)


class Both:
    """Knows a back of the cylinder with one seam, or says why there is none."""

    def __init__(self, integration: CylinderIntegration) -> None:
        self.integration = integration
        self.gate = threading.Event()
        self.gate.set()
        self.trouble = ""
        self.laid: tuple[LaidPiece, ...] = ()
        self.floating: tuple[FlattenedView, ...] = ()
        self.asked: list = []
        self.made_of: list = []
        self.view = cylinder_view({6: 180.0})

    def joined(self, document, progress, check) -> JoinedSides | str:
        self.asked.append(document)
        progress(0.3, "flattening view 7")
        assert self.gate.wait(20)
        check()
        self.made_of.append(document)
        if self.trouble:
            return self.trouble
        seams = document.garment.seams
        xyz_m = np.column_stack([PLACES[:, 0], PLACES[:, 1], np.full(40, 0.7)])
        cut = bool(seams) and not seams[-1].kept
        seam = Seam(
            this_piece=0,
            other_piece=0,
            this_uv_m=PLACES,
            other_uv_m=PLACES * (-1, 1),
            xyz_m=xyz_m,
            views=np.tile(np.int16([1, 6]), (40, 1)),
            residual_m=np.linspace(0.001, 0.005, 40),
            why="cut by the operator" if cut else "",
            decided=None if not seams else "cut" if cut else "keep",
        )
        other = Canonical(view=self.view, current_from_view={}, floating=self.floating)
        return JoinedSides(other=other, seams=(seam,), is_related=not cut, laid=self.laid)


@pytest.fixture
def both(server: PageServer, integration: CylinderIntegration) -> Both:
    assert isinstance(server.application, Application)
    integration.algorithm.joins_sides = True
    made = Both(integration)
    server.application.other.both = made  # type: ignore[assignment]
    return made


SHOW = {"type": "other_side"}


def known(both: Both, **more) -> dict:
    """What a tab is told when the other side is known."""
    more = {f"other.{path.replace('__', '.')}": value for path, value in more.items()}
    return {"other.working": False, "other.layers.area_cm2": pytest.approx(1e4 * both.view.area_m2), **more}


def doubts(server: PageServer, tab: Tab) -> list:
    """What is in doubt about the shape that a tab shows."""
    return get(server, f"/doubts/{tab.state['doubts']}.json").json()["doubts"]


def turned_over(tab: Tab, both: Both) -> dict:
    """Ask for the other side and wait until it is known."""
    tab.proposed()
    leads_to(tab, SHOW, known(both))
    return tab.state["other"]


def test_the_other_side_is_computed_when_it_is_asked_for_and_its_progress_told(server, both):
    both.gate.clear()
    with Tab(server) as tab:
        assert tab.proposed()["other"]["layers"] is None
        assert not both.asked
        leads_to(tab, SHOW, {"other.progress.text": "flattening view 7"})
        # A shape that changes meanwhile is not joined.
        leads_to(tab, {"type": "do", "action": "accept"}, {"step": 2, "drawing": False})
        both.gate.set()
        leads_to(tab, None, known(both, is_related=True))
        (seam,) = (each for each in doubts(server, tab) if each["kind"] == "seam")
        # Cut, it joins nothing; that is a decision.
        cut = {"type": "decide", "revision": tab.state["doubts"], "how": "cut", "index": 0}
        index = [each["kind"] for each in doubts(server, tab)].index("seam")
        leads_to(tab, {**cut, "index": index}, {"undo": "cut a seam"})
        leads_to(tab, None, known(both, is_related=False))
        assert "You cut it." in doubts(server, tab)[index]["note"]
        leads_to(tab, {**cut, "index": index}, {"note": Has("look again")})
    assert (seam["said"], len(seam["this_uv_m"]), len(seam["other_uv_m"])) == ("24 cm, joins", 40, 40)
    assert {view["view_index"]: view["places"] for view in seam["views"]} == {1: 40, 6: 40}
    assert "40 places" in seam["note"]
    assert "3.0 mm apart, nine tenths below 4.6 mm" in seam["note"]
    assert [len(document.accepted) for document in both.asked] == [0, 1, 1]
    assert [len(document.accepted) for document in both.made_of] == [1, 1]


def test_why_there_is_no_other_side_is_told_and_the_papers_method_has_none(server, both, integration):
    both.trouble = "Only one side is in the shape: no cloth."
    with Tab(server) as tab:
        tab.proposed()
        leads_to(tab, SHOW, {"other.text": both.trouble, "other.working": False})
        pick = {"type": "pick", "u_m": 0.0, "v_m": 0.1, "sheet": "other"}
        leads_to(tab, pick, {"note": "The other side is not known"})
        integration.algorithm.joins_sides = False
        leads_to(tab, SHOW, {"other": None})


def test_a_place_of_the_other_side_is_hovered_and_picked_there_with_its_pose(server, both):
    row, col = 20, both.view.shape[1] // 2
    u_m, v_m = both.view.uv_from_rc(np.array([row, col])).tolist()
    with Tab(server) as tab:
        turned_over(tab, both)
        tab.say(type="hover", id=3, u_m=u_m, v_m=v_m, sheet="other")
        answer = tab.until(lambda m: m["type"] == "hover")
        np.testing.assert_allclose(answer["shape"]["xyz_mm"], 1e3 * both.view.xyz_m[row, col], atol=1e-3)
        assert (answer["shape"]["view_index"], answer["proposal"]) == (6, None)
        told = {"pick.side": "other", "pick.uv_m": pytest.approx([u_m, v_m]), "picks.0.side": "other"}
        leads_to(tab, {"type": "pick", "u_m": u_m, "v_m": v_m, "sheet": "other"}, told)
        (grasp,) = get(server, "/robot/grasps").json()["grasps"]
        # A point in space is found on the side that has it.
        server.application.propose_pick(tuple(both.view.xyz_m[row, col].astype(float).tolist()))
        leads_to(tab, None, {"picks.0.kept": True, "pick.side": "other"})
    assert (grasp["side"], grasp["flattened"]["file"]) == ("other", "flattened-other.npz")
    approach = np.array(grasp["poses"]["held"]["matrix"])[:3, 2]
    np.testing.assert_allclose(approach, -both.view.normal[row, col], atol=1e-3)


def test_a_pick_on_the_other_side_is_kept_while_that_is_not_known(integration, folder):
    folder.add_pick("behind", np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, 1.0]), 6, (3.0, 4.0), "other")
    with PageServer(Opened(integration, folder)) as server, Tab(server) as tab:
        assert tab.proposed()["picks"][0]["uv_m"] is None
        leads_to(tab, {"type": "show_pick", "id": 1}, {"pick.uv_m": None, "pick.grip": None})


def test_what_floats_of_the_other_side_is_among_the_doubts_and_nothing_is_decided_about_it(server, both):
    both.floating = (replace(both.view, origin_uv_m=(3.0, 0.0)),)
    with Tab(server) as tab:
        turned_over(tab, both)
        (piece,) = (each for each in doubts(server, tab) if each["side"] == "other")
    assert (piece["title"], piece["choices"]) == ("B, other side", [])
    assert [view["view_index"] for view in piece["views"]] == [6]


def test_pieces_that_seams_lay_are_shown_on_the_shape(server, both, integration, folder):
    """Half of the shape floats; the other side that is known then has a place for it."""
    whole = integration.canonical

    def halved(document):
        found = whole(document)
        if found.view.shape not in made:
            away = replace(cylinder_view({3: 90.0}), origin_uv_m=(7.0, 0.0))
            made[found.view.shape] = replace(found, floating=(away,))
        return made[found.view.shape]

    made: dict = {}
    integration.canonical = halved
    both.laid = (LaidPiece(index=0, shape_from_piece=Rigid2(0.0, -6.5, 0.0), std_m=0.01),)
    with Tab(server) as tab:
        state = tab.proposed()
        assert [piece["placed"] for piece in state["layers"]["pieces"]] == [False]
        placed = {"layers.pieces.0.placed": True, "layers.pieces.0.reason": Has("seams")}
        leads_to(tab, SHOW, {**known(both), **placed})
