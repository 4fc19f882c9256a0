"""What the page is told of why a proposal lies where it does."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from cylinder_views import CylinderViews, proposed
from route_client import RouteClient

from flatcloth.core.types import Rigid2
from flatcloth.viewer.modes.review import diagnostics_routes


@pytest.fixture
def held():
    views = CylinderViews()
    hypotheses = tuple(SimpleNamespace(current_from_new=Rigid2(0.0, u, 0.0)) for u in (0.0, 0.15))
    proposal = SimpleNamespace(view_index=1, component=0, placement=SimpleNamespace(hypotheses=hypotheses))
    sheet = SimpleNamespace(shown=lambda motion, _center: motion)
    overlay = SimpleNamespace(revision=7, proposal=proposal, own_center_uv_m=(0.0, 0.0), sheet=sheet)
    document = proposed(1)
    picture = SimpleNamespace(revision=3, overlay=overlay, document=document, view=views.view(0))
    page = SimpleNamespace(integration=views, picture=picture)
    return SimpleNamespace(held=page, get=RouteClient(diagnostics_routes(page)).get)


def test_the_page_is_told_the_lines(held):
    told = held.get("/diagnostics/3-7.json").json()["reasons"]
    assert (told["view_index"], told["front_view"], told["side"]) == (1, 0, "left")
    assert told["correspondence"]["a_m_deg"] == pytest.approx(-15.0, abs=2.5)
    assert told["current_from_new"] == {"theta_rad": 0.0, "u_m": 0.012, "v_m": -0.004}
    assert told["trouble"] == ""


def test_what_cannot_be_computed_is_told_in_one_line(held):
    held.held.picture.document = proposed(4)
    told = held.get("/diagnostics/3-7.json").json()
    assert told["reasons"]["correspondence"] is None
    assert "no Z-angle in common" in told["reasons"]["trouble"]
    held.held.picture.overlay.revision = 8
    held.held.picture.document = SimpleNamespace(pending=None)
    failed = held.get("/diagnostics/3-8.json")
    assert failed.status_code == 409
    assert "\n" not in failed.text


@pytest.mark.parametrize("path", ["/diagnostics/2-7.json", "/diagnostics/3-6.json"])
def test_what_is_no_longer_shown_is_not_there(held, path):
    assert held.get(path).status_code == 410
    held.held.picture = None
    assert held.get(path).status_code == 410
