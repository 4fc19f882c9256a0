"""Floating pieces: seen beside the shape, picked, and placed by hand."""

from __future__ import annotations

import json

import pytest
from exported_sessions import write_cylinder
from playwright.sync_api import expect

pytestmark = pytest.mark.browser
WHERE = "JSON.stringify([flatcloth.state.pending?.view_index, flatcloth.state.pending?.nudge])"


@pytest.fixture
def program(tmp_path, program_of):
    """A cylinder of which a band across the middle is never seen: its upper half floats."""
    recording = write_cylinder(tmp_path / "cut", "cut", slice(112, 128))
    return program_of(str(recording), tmp_path / "session")


def a_piece_is_seen_beside_the_shape_told_and_picked(tab):
    (piece,) = tab.state()["layers"]["pieces"]
    assert piece["label"] == "B"
    assert 100 < piece["area_cm2"] < 250
    expect(tab.page.locator("#recording")).to_contain_text("cm\u00b2 float in 1 piece")
    # It lies beside the shape and not metres away, with all of it on the canvas.
    x, y = tab.at(tab.place(0.5, 0.5, piece["grid"]))
    canvas = tab.page.locator("#canvas").bounding_box()
    assert canvas["x"] < x < canvas["x"] + canvas["width"]
    assert piece["grid"]["origin_uv_m"][0] < 0.6
    tab.page.mouse.click(x, y)
    tab.until("flatcloth.state.picks.length === 1")
    pick = tab.pick()
    assert pick["uv_m"]
    assert pick["miss_m"] == 0
    assert pick["position_held_m"][1] > 0.01  # on the lower half, below the band
    choose_the_piece(tab)
    doubts = tab.page.get_by_role("region", name="Doubts")
    expect(doubts).to_contain_text("Floating pieces: 1")
    expect(doubts).to_contain_text("Nothing seen connects it to the shape.")
    tab.shoot("piece-picked")
    tab.page.keyboard.press("Shift+Y")


OFF = (-0.05, 0.03)
CHOSEN = "flatcloth.doubts.list[flatcloth.doubts.chosen]?.kind === 'piece'"


def choose_the_piece(tab):
    """Open the doubts, and choose the piece that floats."""
    tab.page.keyboard.press("Shift+Y")
    tab.until("flatcloth.doubts.shown && flatcloth.doubts.list.some(({ kind }) => kind === 'piece')")
    if not tab.page.evaluate(CHOSEN):
        tab.page.locator("#doubts .doubt", has_text="floats").click()
    tab.until(CHOSEN)


def with_a_place(route):
    """Answer with the doubts; a made-up garment, as a cylinder is none, has a place for the piece."""
    response = route.fetch()
    found = response.json()
    place = {"theta_rad": 0.0, "u_m": OFF[0], "v_m": OFF[1]}
    for piece in (doubt for doubt in found["doubts"] if doubt["kind"] == "piece"):
        told = {"how": "place", "title": "By the garment", "decide": "Place it there", "std_mm": 314.0}
        piece["choices"].append({**told, "probability": 0.9, "placement": place})
        piece["weak"] = True
    route.fulfill(response=response, body=json.dumps(found))


def it_snaps_to_its_ghost(tab):
    """Dragged near the place that the garment has for it, the chosen piece lies exactly there."""
    tab.page.route("**/doubts/*.json", with_a_place)
    tab.page.reload()
    tab.ready()
    tab.page.keyboard.press("Shift+E")
    expect(tab.page.locator("#result p").first).to_contain_text("The garment has a place for piece B, ")
    choose_the_piece(tab)
    tab.until("flatcloth.doubts.held && flatcloth.handles.places !== null")
    canvas, mouse = tab.page.locator("#canvas").bounding_box(), tab.page.mouse
    middle = tab.page.evaluate("flatcloth.handles.places.middle")
    scale = tab.page.evaluate("flatcloth.canvas.transform.scale")
    x, y = canvas["x"] + middle["x"], canvas["y"] + middle["y"]
    mouse.move(x, y)
    mouse.down()
    mouse.move(x + scale * OFF[0] + 6, y + scale * OFF[1] - 6, steps=4)
    tab.until("flatcloth.handles.snapped?.startsWith('By the garment')")
    expect(tab.page.locator("[data-action=doubt_decide]")).to_have_text("Place it there A")
    expect(tab.page.locator("#doubt-fit")).to_have_text("This place of the garment is known to ± 314 mm.")
    mouse.up()
    tab.page.unroute("**/doubts/*.json")


def test_a_piece_is_seen_beside_the_shape_picked_and_dragged_onto_it_by_hand(open_tab):
    tab = open_tab().ready()
    a_piece_is_seen_beside_the_shape_told_and_picked(tab)
    tab.step()
    tab.accept()
    (piece,) = tab.state()["layers"]["pieces"]
    it_snaps_to_its_ghost(tab)
    tab.proposed()
    pending = tab.state()["pending"]
    assert abs(pending["nudge"]["u_mm"]) < 2000
    overlay = tab.state()["layers"]["overlay"]
    center = overlay["center_uv_m"]
    # Dragged to the middle of the shape, it is meant there.
    revision = overlay["revision"]
    x, y = tab.at(center)
    tab.drag((x, y), (x - 60, y + 40))
    tab.until(f"flatcloth.overlayRevision > {revision}")
    moved = tab.state()["layers"]["overlay"]["center_uv_m"]
    assert moved[0] < center[0] - 0.01
    assert moved[1] > center[1] + 0.005
    assert tab.state()["undo"].startswith("move")
    for _ in range(4):
        proposed = tab.page.evaluate(WHERE)
        tab.page.keyboard.press("u")
        tab.until(f"{WHERE} !== {json.dumps(proposed)}")
        if tab.state()["pending"] is None:
            break
    tab.until("flatcloth.state.pending === null && flatcloth.state.layers.overlay === null")
    tab.until("flatcloth.state.layers.pieces.length === 1")
    assert tab.state()["layers"]["pieces"][0]["area_cm2"] == pytest.approx(piece["area_cm2"])
    it_is_told_before_accept_whether_a_dropped_piece_joins(tab)


def it_is_told_before_accept_whether_a_dropped_piece_joins(tab):
    """The piece itself is dragged; where it touches nothing it floats on, as the page has said."""
    layers = tab.state()["layers"]
    at = tab.at(tab.place(0.5, 0.5, layers["pieces"][0]["grid"]))
    far = tab.at([layers["origin_uv_m"][0], layers["origin_uv_m"][1] - 0.1])
    tab.drag(at, far)
    tab.until("/does not (touch|join)/i.test(document.getElementById('joining')?.textContent)")
    tab.until("flatcloth.state.pending && flatcloth.state.pending.joins !== null")
    assert tab.state()["pending"]["joins"] is False
    expect(tab.page.locator("#joining")).to_contain_text("Does not join")
    expect(tab.page.locator("#proposal .score strong")).to_have_text("Look here")
    tab.page.keyboard.press("a")
    tab.page.locator(".toast.warning", has_text="does not join the shape").wait_for()
    tab.page.keyboard.press("a")
    tab.until("flatcloth.state.pending === null && !flatcloth.state.drawing")
    assert len(tab.state()["layers"]["pieces"]) == 1
