"""The viewer's pure parts: actions, colours, layers, read-outs, rotations."""

from dataclasses import replace
from functools import reduce

import numpy as np
import pytest
from viewer_fakes import CENTER_M, CylinderRecording, cylinder_view

from flatcloth.core.types import Rigid2
from flatcloth.rendering.layers import LAYERS, QUALITY_LAYERS, legends, rgba
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
from flatcloth.viewer.protocol.picture import values_at

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
