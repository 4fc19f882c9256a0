"""Source images on the page's server, headless: color, mask, and the views that saw a pick."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import httpx
import numpy as np
import pytest
from page_tabs import get
from scenes import Cylinder

from flatcloth.engine.integration import Integration
from flatcloth.session.store import SessionFolder
from flatcloth.viewer.routes.sources import crop
from flatcloth.viewer.server.app import PageServer
from flatcloth.viewer.server.workspace import Opened

ANGLES_DEG = (0.0, 30.0, 60.0, 120.0, 180.0, 330.0)


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PageServer]:
    integration = Integration(Cylinder(angles_deg=ANGLES_DEG), method="paper")
    place = tmp_path_factory.mktemp("sources") / "s"
    folder = SessionFolder.open(place, integration.recording, integration.config, "paper")
    with PageServer(Opened(integration, folder), port=0) as running:
        yield running
    folder.close()


def decoded(answer: httpx.Response) -> np.ndarray:
    assert answer.status_code == 200, answer.text
    image = cv2.imdecode(np.frombuffer(answer.content, np.uint8), cv2.IMREAD_UNCHANGED)
    assert image is not None
    return image


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


def test_a_crop_at_the_border_is_filled_up() -> None:
    color = np.full((20, 30, 3), 200, dtype=np.uint8)
    part = crop(color, 0.2, 29.4, size_px=8)
    assert part.shape == (8, 8, 3)
    assert (part[4:, :5] == 200).all()
    assert (part[:4] == 128).all()
    assert (part[:, 5:] == 128).all()
