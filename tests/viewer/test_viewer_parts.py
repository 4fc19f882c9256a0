"""The viewer's pure parts: actions, colours, layers and the pictures of them that the page fetches."""

from __future__ import annotations

from dataclasses import replace
from functools import reduce
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from route_client import RouteClient
from viewer_fakes import CENTER_M, PIXEL_M, CylinderIntegration, CylinderRecording, cylinder_view

from flatcloth.api.integrating import flatten
from flatcloth.core.types import Rigid2
from flatcloth.recordings import open_recording
from flatcloth.rendering.colormaps import color_table
from flatcloth.rendering.layers import LAYERS, QUALITY_LAYERS, difference_rgba, legend, legends, rgba
from flatcloth.session.machine import (
    Accept,
    NothingMore,
    Propose,
    Proposed,
    Reject,
    SessionState,
    Start,
    Started,
    apply,
)
from flatcloth.viewer.protocol.actions import ACTIONS, action_table
from flatcloth.viewer.protocol.picture import values_at, with_errors
from flatcloth.viewer.routes.layers import layer_routes

AXIS = CylinderRecording().rotation_axis
# Keys that browsers keep for themselves, or that move the focus.
RESERVED = {
    "Tab",
    " ",
    *(f"F{n}" for n in (1, 3, 5, 6, 11, 12)),
    *(f"Ctrl+{key}" for key in "twnrlf"),
}


@pytest.mark.parametrize("mode", ["session", "capture", "teaching"])
def test_every_key_means_one_action_in_a_mode_and_none_is_the_browsers(mode):
    keys = [key for action in ACTIONS if action.mode in ("", mode) for key in action.keys]
    assert len(keys) == len(set(keys))
    assert not RESERVED & set(keys)


def test_each_mode_says_that_the_others_actions_are_not_its_own():
    session = {a.name: a for a in action_table(SessionState(n_views=3))}
    camera = {a.name: a for a in action_table(None)}
    assert "--camera" in session["capture_pause"].why_not
    assert camera["capture_pause"].why_not is None
    for name in ("step", "accept", "auto", "left", "blink"):
        assert "open a recording to decide" in camera[name].why_not
        assert camera[name].mode == "session"
    assert camera["layer_stretch"].why_not is None


STARTED = (Start(), Started(1, 0))
PENDING = (*STARTED, Propose(), Proposed(2, 1, Rigid2()))
TWO = (*PENDING, Accept(1), Propose(), Proposed(3, 2, Rigid2()), Accept(2))


def state_after(*steps):
    return reduce(apply, steps, SessionState(n_views=3))


@pytest.mark.parametrize(
    ("steps", "name", "said"),
    [
        ((), "restart", None),
        ((), "capture_keep", "--camera"),
        ((), "left", "step first"),
        (PENDING, "left", None),
        (PENDING, "reopen", "There is no decision to reopen."),
        ((*PENDING, Reject(1)), "reopen", None),
        ((*PENDING, Accept(1), Propose()), "reopen", "computation is running"),
        (PENDING, "auto", None),
        ((*STARTED, Propose(), NothingMore(2, "No view is left.")), "auto", "No view is left."),
        (TWO, "undo", None),
        (TWO, "redo", "nothing to redo"),
    ],
)
def test_the_table_says_why_an_action_is_not_allowed_now(steps, name, said):
    why_not = next(a.why_not for a in action_table(state_after(*steps)) if a.name == name)
    assert why_not is None if said is None else said in why_not


@pytest.mark.parametrize("layer", LAYERS)
def test_layers_are_transparent_off_the_cloth(layer):
    view = cylinder_view({0: 0.0, 2: 120.0})
    image = rgba(view, layer, AXIS, 12)
    np.testing.assert_array_equal(image[..., 3] == 255, view.valid)
    assert not view.valid.all()


@pytest.mark.parametrize("layer", QUALITY_LAYERS)
def test_quality_that_is_not_known_is_grey_and_has_no_scale(layer):
    view = replace(cylinder_view({0: 0.0}), quality=None)
    image = rgba(view, layer, AXIS, 12)
    np.testing.assert_array_equal(np.unique(image[view.valid][:, :3]), [128])
    assert legends(view, AXIS, (0.0,))[layer]["title"] == "Not measured"
    view = cylinder_view({0: 0.0})
    view.quality[10, 10] = np.nan
    np.testing.assert_array_equal(rgba(view, layer, AXIS, 12)[10, 10], [128, 128, 128, 255])


def test_legends_have_units_and_name_the_views_used():
    legend = legends(cylinder_view({0: 0.0, 2: 60.0}), AXIS, CylinderRecording().angles_deg)
    assert legend["height"]["title"] == "Height z (mm)"
    assert legend["height"]["high"] == pytest.approx(150, abs=6)
    assert [c["label"] for c in legend["source"]["classes"]] == ["0 (0°)", "2 (60°)"]


def test_attributes_are_those_of_the_pixel_under_the_pointer():
    view = cylinder_view({0: 0.0})
    u, v = view.uv_from_rc(np.array([3, 5]))
    found = values_at(view, u + 0.49 * view.pixel_size_m, v - 0.49 * view.pixel_size_m, AXIS)
    assert found.rc == (3, 5)
    np.testing.assert_allclose(found.xyz_mm, 1000 * view.xyz_m[3, 5], rtol=1e-6)
    assert found.height_mm == pytest.approx(1000 * (CENTER_M[1] - view.xyz_m[3, 5, 1]), abs=1e-3)
    assert values_at(view, u, v - 1.0, AXIS) is None
    assert values_at(view, float(view.origin_uv_m[0]) - view.pixel_size_m, v, AXIS) is None


VIEW = cylinder_view({0: 0.0})


@pytest.fixture
def shown():
    overlay = SimpleNamespace(revision=7, view=cylinder_view({1: -30.0}))
    picture = SimpleNamespace(revision=3, view=VIEW, overlay=overlay, other=None)
    return SimpleNamespace(picture=picture, integration=CylinderIntegration())


@pytest.fixture
def client(shown):
    return RouteClient(layer_routes(shown))


def image_of(answer):
    assert answer.status_code == 200, answer.text
    image = cv2.imdecode(np.frombuffer(answer.content, np.uint8), cv2.IMREAD_UNCHANGED)
    return cv2.cvtColor(image, cv2.COLOR_BGRA2RGBA)


def test_a_recording_with_a_kit_shows_the_error_of_each_pixel():
    recording = open_recording("tshirt-kit")
    axis, view = recording.rotation_axis, with_errors(flatten(recording, 0).view, recording)
    assert np.nanmedian(view.error_m[view.valid]) < 0.003
    assert np.isfinite(view.error_m[view.valid]).mean() > 0.3
    assert legend(view, "truth", axis, ())["title"] == "Error by the kit (mm)"
    assert legend(VIEW, "truth", axis, ())["title"] == "No kit was recorded"
    assert with_errors(VIEW, open_recording("shirt-sleeve-clean")) is VIEW


def test_the_proposal_is_shown_in_the_colours_of_the_shape(client, shown):
    overlay = shown.picture.overlay.view
    image = image_of(client.get("/overlay/7.png?layer=height"))
    shape = image_of(client.get("/layers/3/height.png"))
    # The same height has the same colour in both, whatever range each of them spans.
    row = 20
    assert shape[row, VIEW.valid[row]][0].tolist() == image[row, overlay.valid[row]][0].tolist()
    assert image_of(client.get("/overlay/7.png"))[overlay.valid][0, 1] == 120


def test_differences_are_mapped_over_the_common_cloth_only(client, shown):
    overlay = shown.picture.overlay.view
    image = image_of(client.get("/difference/3-7/position.png"))
    u = overlay.origin_uv_m[0] + PIXEL_M * np.arange(overlay.shape[1])
    low, high = VIEW.origin_uv_m[0], VIEW.origin_uv_m[0] + PIXEL_M * (VIEW.shape[1] - 1)
    inside = (u > low + PIXEL_M) & (u < high - PIXEL_M)
    assert image[5, inside & overlay.valid[5], 3].min() == 255
    assert image[5, (u < low - PIXEL_M) | (u > high + PIXEL_M), 3].max() == 0
    # Both are the same cylinder, so it is the first colour of the map throughout.
    first = color_table("loss")[0].astype(int)
    assert np.abs(image[5, inside & overlay.valid[5], :3].astype(int) - first).max() <= 3


def test_a_heat_map_saturates_at_its_legend():
    color = np.array([[0.0, 32.0, 64.0, 200.0]], np.float32)
    far = {"color": color, "position": np.zeros((1, 4), np.float32)}
    image = difference_rgba(far, "color")[0, :, :3]
    table = color_table("loss")
    np.testing.assert_array_equal(image[[0, 2, 3]], table[[0, 255, 255]])
    assert image[1].tolist() in table[126:130].tolist()
