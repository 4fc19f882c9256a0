"""Source images on the page's server, headless: color, mask, and the views that saw a pick."""

from collections.abc import Iterator

import cv2
import httpx
import numpy as np
import pytest
from page_tabs import Tab, get
from scenes import CAMERA, Cylinder

from flatcloth.engine.integration import Integration
from flatcloth.session.store import SessionFolder
from flatcloth.viewer.server.app import PageServer
from flatcloth.viewer.server.workspace import Opened

ANGLES_DEG = (0.0, 30.0, 60.0, 120.0, 180.0, 330.0)


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PageServer]:
    integration = Integration(Cylinder(angles_deg=ANGLES_DEG), method="paper")
    place = tmp_path_factory.mktemp("sources") / "s"
    folder = SessionFolder.open(place, integration.recording, integration.config, "paper")
    with PageServer(Opened(integration, folder)) as running:
        yield running
    folder.close()


def decoded(answer: httpx.Response) -> np.ndarray:
    assert answer.status_code == 200, answer.text
    image = cv2.imdecode(np.frombuffer(answer.content, np.uint8), cv2.IMREAD_UNCHANGED)
    assert image is not None
    return image


def test_the_color_of_a_view_is_what_the_recording_has(server: PageServer) -> None:
    shown = decoded(get(server, "/source/1/color.jpg"))[..., ::-1].astype(float)
    true = Cylinder(angles_deg=ANGLES_DEG)[1].color
    assert shown.shape == true.shape
    assert np.median(np.abs(shown - true)) < 4


def test_the_mask_shades_what_is_not_the_item(server: PageServer) -> None:
    cover = decoded(get(server, "/source/0/mask.png"))
    mask = Cylinder(angles_deg=ANGLES_DEG)[0].mask
    assert mask is not None
    assert (cover[mask, 3] == 0).all()
    assert (cover[~mask, 3] > 100).all()
    rows, cols = np.nonzero(mask)
    assert (cover[int(rows.mean()), cols.min() - 1, :3] == (60, 210, 255)).all()  # its outline, B G R


def test_a_view_or_a_pick_that_does_not_exist_is_said(server: PageServer) -> None:
    answer = get(server, "/source/6/color.jpg")
    assert (answer.status_code, answer.text) == (404, "View 6 does not exist.")
    assert get(server, "/source/-1/color.jpg").status_code == 404
    assert get(server, "/source/seen/9.json").status_code == 404


def test_hovering_tells_the_pixel_in_the_view_that_is_shown(server: PageServer) -> None:
    with Tab(server) as tab:
        grid = tab.ready()["layers"]
        size, (u, v) = grid["pixel_size_m"], grid["origin_uv_m"]
        place = {"u_m": u + size * grid["cols"] / 2, "v_m": v + size * grid["rows"] / 2}
        for number, view in enumerate((0, 1, 4, 99)):
            tab.say(type="hover", id=number, view=view, **place)
            answer = tab.until(lambda m, n=number: m["type"] == "hover" and m["id"] == n)
            source, shape = answer["source"], answer["shape"]
            if view == shape["view_index"]:
                assert source == {"view_index": view, "rc": shape["source_rc"]}
            elif view == 1:
                x, _, z = np.array(shape["xyz_mm"]) / 1000
                a = np.arctan2(x, 0.85 - z) + np.radians(30.0)
                place_m = np.array([0.12 * np.sin(a), 0.85 - 0.12 * np.cos(a)])
                assert source["rc"][1] == pytest.approx(
                    CAMERA.fx * place_m[0] / place_m[1] + CAMERA.cx, abs=1.5
                )
            else:
                assert source is None  # on the far side; no such view
