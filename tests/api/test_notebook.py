"""A shape in a notebook: the picture of a cell, and the widget, by what it says to the browser."""

import base64
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from exported_sessions import write_cylinder, write_session

import flatcloth


@pytest.fixture(scope="module")
def shape(tmp_path_factory: pytest.TempPathFactory) -> flatcloth.Shape:
    folder = tmp_path_factory.mktemp("notebook")
    return flatcloth.open_session(write_session(folder / "session", write_cylinder(folder / "recording")))


def picture(url: str) -> np.ndarray:
    data = base64.b64decode(url.removeprefix("data:image/png;base64,"))
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    assert image is not None
    return image


def test_a_cell_shows_the_flat_image_the_picks_and_the_summary(shape: flatcloth.Shape) -> None:
    html = shape._repr_html_()
    (url,) = re.findall(r'href="([^"]+)"', html)
    shown = picture(url)
    np.testing.assert_array_equal(shown[..., 3] > 0, shape.valid)
    assert html.count("<circle") == 2  # the third pick is no longer on the cloth
    assert "edge &lt;b&gt;" in html
    assert "<b>" not in html
    assert "</script>" not in html
    assert "4 views" in html or "3 views" in html


def test_a_click_on_the_widget_is_a_grasp_pose_and_beside_the_cloth_a_reason(shape: flatcloth.Shape) -> None:
    widget = shape.widget()
    row, col = map(int, np.argwhere(shape.valid).mean(axis=0))
    widget.asked = [row, col, 1]
    (pose,) = widget.poses.values()
    expected = shape.grasp(row, col).object_from_grasp
    np.testing.assert_allclose(pose.object_from_grasp.translation_m, expected.translation_m)
    assert widget.picks == [{"name": "Pick 1", "row": row, "col": col, "by_hand": True}]
    assert f"({row}, {col})" in widget.told
    widget.asked = [0, 0, 2]
    assert "no cloth there" in widget.told
    assert len(widget.poses) == 1
    assert widget.size == list(shape.valid.shape)
    assert Path(str(widget._esm)).suffix == ".js" or "render" in str(widget._esm)
