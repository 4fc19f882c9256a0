"""The offline page as a file: one script, its own data, nothing from elsewhere, no text that escapes."""

import base64
import hashlib
import io
import json
import re
import zlib
from html import unescape

import numpy as np
import pytest
from exported_sessions import NAME, PICKS
from PIL import Image

from flatcloth.core.parcel import unpack
from flatcloth.core.resources import static_folder
from flatcloth.export.page import POINT_STEP_M, page, whole
from flatcloth.export.session import OpenedSession


def inside(text: str, opening: str) -> str:
    """Return what the only element contains that begins so."""
    (found,) = re.findall(rf"<{opening}[^>]*>(.*?)</", text, re.DOTALL)
    return found


@pytest.fixture(scope="module")
def text(session: OpenedSession) -> str:
    return page(session)


@pytest.fixture(scope="module")
def history(text: str) -> dict:
    return json.loads(inside(text, 'script [^>]*id="history"'))


@pytest.fixture(scope="module")
def arrays(text: str) -> dict[str, np.ndarray]:
    """The arrays and the pictures of the page."""
    packed = zlib.decompress(base64.b64decode(inside(text, 'script [^>]*id="arrays"')), 31)
    return unpack(io.BytesIO(packed).read)[1]


def test_the_same_session_gives_the_same_page(session: OpenedSession, text: str) -> None:
    assert page(OpenedSession(session.history, session.integration)) == text


def test_the_policy_allows_the_pages_own_script_and_style_and_nothing_else(text: str) -> None:
    policy = unescape(re.findall(r'http-equiv="Content-Security-Policy"\s+content="([^"]+)"', text)[0])
    assert policy.startswith("default-src 'none'")

    def digest(content: str) -> str:
        return f"'sha256-{base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()}'"

    for kind, opening in (("script", 'script type="module"'), ("style", "style")):
        assert f"; {kind}-src {digest(inside(text, opening))};" in policy
    assert "unsafe" not in policy


def test_no_text_of_a_recording_or_an_operator_becomes_markup(text: str, history: dict) -> None:
    assert history["recording"]["name"] == NAME
    assert [p["name"] for p in history["picks"]] == list(PICKS)
    assert unescape(inside(text, "title")) == f"{NAME} \u00b7 flatcloth"
    assert "<b>" not in text
    assert text.count("<script") == 3


def restored(differences: np.ndarray, channels: int) -> np.ndarray:
    """Return the rows (N, channels), as the page sums them up."""
    columns = differences.reshape(channels, -1)
    return np.cumsum(columns, axis=1, dtype=columns.dtype).T


def test_the_cloth_comes_back_as_it_was(session: OpenedSession, history: dict, arrays: dict) -> None:
    growth = session.growth
    grid, view = history["grid"], growth.view
    first = arrays["first"].reshape(grid["rows"], grid["cols"])
    row, col = grid["corner_rc"]
    window = np.s_[row : row + grid["rows"], col : col + grid["cols"]]
    np.testing.assert_array_equal(first, growth.first_step[window])
    assert (first >= 0).sum() == view.valid.sum() == history["count"]
    cloth = first >= 0
    xyz = np.array(history["bounds"]["low"]) + history["bounds"]["step"] * restored(arrays["xyz"], 3)
    np.testing.assert_allclose(xyz, view.xyz_m[window][cloth], atol=POINT_STEP_M / 2 + 1e-6)
    normal = restored(arrays["normal"], 3).astype(np.float64)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    along = np.einsum("ij,ij->i", normal, view.normal[window][cloth])
    assert np.degrees(np.arccos(along.min())) < 2.0
    right, camera = np.array(history["axis"]["across"]) @ normal.T
    views = np.array([step["view_index"] for step in history["steps"]])[
        arrays["source"].reshape(first.shape)[cloth]
    ]
    z_angle_deg = np.degrees(np.arctan2(right, camera)) + np.array(history["recording"]["angles_deg"])[views]
    apart_deg = (z_angle_deg - view.z_angle_deg[window][cloth] + 180) % 360 - 180
    assert np.abs(apart_deg).max() < 2.0
    rc = restored(arrays["source_rc"], 2)
    np.testing.assert_allclose(rc, view.source_rc[window][cloth], atol=0.51)
    np.testing.assert_allclose(grid["origin_uv_m"], view.uv_from_rc(np.array([row, col])))
    around = restored(arrays["around_xyz"], 3)
    assert len(around) == sum(a["count"] for a in history["around"])
    assert arrays["around_rgb"].size == around.size
    image = np.asarray(Image.open(io.BytesIO(arrays["layer color"].tobytes())).convert("RGBA"))
    np.testing.assert_array_equal(image[..., :3][cloth], view.rgb[window][cloth])


def test_the_steps_and_decisions_are_those_of_the_session(session: OpenedSession, history: dict) -> None:
    assert [s["view_index"] for s in history["steps"]] == [0, 1, 2]
    assert history["steps"][0]["told"] == "the start view"
    assert sum(s["added_cm2"] for s in history["steps"]) == pytest.approx(history["steps"][-1]["area_cm2"])
    assert [(d["verdict"], d["stands"], d["step"]) for d in history["decisions"]] == [
        ("rejected", False, None), ("accepted", True, 1), ("accepted", True, 2),
    ]  # fmt: skip
    middle, edge, gone = history["picks"]
    assert middle["grip"]["opening_m"] == 0.06
    assert np.array(middle["grip"]["gripper_m"]).shape == (6, 2, 3)
    assert middle["uv_m"] is not None
    assert edge["grip"]["outline_distance_m"] < 0.004
    assert (gone["uv_m"], gone["rc"], gone["grip"]["axis_from"]) == (None, None, "level")


# --- the page's modules ---------------------------------------------------------------------------


@pytest.mark.parametrize("entry", ["main.js", "start/start.js", "offline/offline.js", "batch/report.js"])
def test_nothing_of_a_page_is_left_to_import_and_no_text_ends_its_element(entry: str) -> None:
    text = whole(static_folder(), entry)
    assert not re.search(r"^(import|export) ", text, re.MULTILINE)
    assert not re.search(r"</script|<!--", text)
    assert "@import" not in whole(static_folder(), entry.replace(".js", ".css"))
