"""The pictures that the page fetches, how they are looked at, and the result."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from route_client import RouteClient
from viewer_fakes import PIXEL_M, CylinderIntegration, cylinder_view

from flatcloth.api.integrating import flatten
from flatcloth.recordings import open_recording
from flatcloth.rendering.colormaps import color_table
from flatcloth.rendering.layers import difference_rgba, legend
from flatcloth.viewer.protocol.picture import truth_of
from flatcloth.viewer.routes.layers import layer_routes

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
    truth, axis = truth_of(recording), recording.rotation_axis
    view = truth.with_errors(flatten(recording, 0).view)
    assert np.nanmedian(view.error_m[view.valid]) < 0.003
    assert np.isfinite(view.error_m[view.valid]).mean() > 0.3
    assert legend(view, "truth", axis, ())["title"] == "Error by the kit (mm)"
    assert legend(VIEW, "truth", axis, ())["title"] == "No kit was recorded"
    assert truth_of(open_recording("shirt-sleeve-clean")) is None


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
    far = SimpleNamespace(
        color=np.array([[0.0, 32.0, 64.0, 200.0]]),
        height_m=np.zeros((1, 4)),
        distance_m=np.zeros((1, 4)),
        common=np.ones((1, 4), dtype=bool),
    )
    image = difference_rgba(far, "color")[0, :, :3]
    table = color_table("loss")
    np.testing.assert_array_equal(image[[0, 2, 3]], table[[0, 255, 255]])
    assert image[1].tolist() in table[126:130].tolist()
