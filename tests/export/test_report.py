"""The report to print, and the animation of the growth."""

import re
from dataclasses import replace
from html import unescape
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest
from exported_sessions import NAME, PICKS
from scenes import AXIS

from flatcloth.core.config import Config, PlanningConfig
from flatcloth.core.errors import FlatclothError
from flatcloth.core.geometry import camera_from_object, project
from flatcloth.core.types import Intrinsics, Rigid2
from flatcloth.export.animation import frames, mp4_of
from flatcloth.export.by_name import made
from flatcloth.export.history import BELOW, BY_HAND, LOW, OVERRIDDEN, flags_of, overridden
from flatcloth.export.report import report
from flatcloth.export.session import OpenedSession
from flatcloth.rendering.pictures import camera_around, paint_points
from flatcloth.session.document import Accepted, Document
from flatcloth.session.header import Header, differences


def words(text: str) -> str:
    """The text that a reader sees."""
    body = re.sub(r"<(style|svg)\b.*?</\1>", "", text, flags=re.DOTALL)
    return re.sub(r"\s+", " ", unescape(re.sub(r"<[^>]+>", " ", body)))


# --- the report -----------------------------------------------------------------------------------


def test_the_report_tells_recording_decisions_and_picks(session: OpenedSession, text: str) -> None:
    seen = words(text)
    assert f"{1e4 * session.growth.view.area_m2:.0f} cm\u00b2 from 3 views" in seen
    assert "0 (0\u00b0), 1 (30\u00b0), 2 (60\u00b0)" in seen
    assert "2 accepted, 1 rejected, 1 of them taken back" in seen
    assert re.search(r"1\. View 1 \(30\u00b0\): rejected , bad depth, score 0\.\d\d, taken back", seen)
    assert re.search(r"2\. View 1 \(30\u00b0\): accepted , score 0\.\d\d chosen by hand", seen)
    assert re.search(r"3\. View 2 \(60\u00b0\): accepted , score 0\.\d\d left: A = \d+ deg", seen)
    assert "Not finished" in seen
    for name in PICKS:
        assert name in seen
    assert "(outline) 60 mm" in seen
    assert "(level)" in seen
    assert "By the evidence:" in seen
    assert "named point how known to" in seen
    assert text.count('<section class="decision') == 3
    assert text.count('<section class="decision gone">') == 1
    assert text.count('<img class="picture"') == 3


def test_texts_stay_texts_and_nothing_is_loaded(text: str) -> None:
    assert NAME in words(text)
    assert not re.search(r"<b>|<i>|</script", text.replace('<b class="', ""))
    addresses = re.findall(r'(?:src|href)="([^"]{0,30})', text)
    assert addresses
    assert all(re.match(r"data:image/(png|svg\+xml);base64,", address) for address in addresses)
    assert "<script" not in text


def test_it_is_laid_out_for_paper_and_the_same_each_time(session: OpenedSession, text: str) -> None:
    assert "@page { size: A4" in text
    assert "break-inside: avoid" in text
    again = OpenedSession(session.history, session.integration)
    assert made(again, "report.html").decode() == text


def with_config(session: OpenedSession, config: Config) -> Header:
    return msgspec.structs.replace(session.history.header, config=config.to_dict())


def test_settings_that_differ_are_listed_and_a_wrong_recording_is_told(
    session: OpenedSession, text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert differences(Config(), Config()) == []
    changed = Config(planning=PlanningConfig(overlap_area_m2=0.05))
    assert differences(changed, Config()) == [("planning.overlap_area_m2", 0.05, 0.0)]
    assert "Something about this recording" not in text
    monkeypatch.setattr(session.integration, "wrong", lambda _: ["View 3 contradicts the others"])
    history = replace(session.history, header=with_config(session, changed))
    seen = words(report(OpenedSession(history, session.integration)))
    assert "planning.overlap_area_m2 0.05 0.0" in seen
    said = "Something about this recording is wrong: View 3 contradicts the others. Nothing of the result"
    assert said in seen


def test_a_session_of_one_view_has_a_report_too(session: OpenedSession) -> None:
    document = Document(start_view=0, finished="One view <only>.")
    header = with_config(session, Config())
    history = replace(session.history, document=document, decisions=(), picks=(), header=header)
    seen = words(report(OpenedSession(history, session.integration)))
    assert "There are no decisions" in seen
    assert "There are no picks" in seen
    assert "One view <only>." in seen
    assert "All settings have their default values." in seen


# --- painting points ------------------------------------------------------------------------------


CAMERA = Intrinsics(width=100, height=80, fx=100.0, fy=100.0, cx=50.0, cy=40.0)


def test_the_nearest_point_is_on_top_unless_it_is_set_back() -> None:
    points = np.array([[0.0, 0, 0.8], [0.0, 0, 0.9]])
    colors = np.array([[200, 0, 0], [0, 200, 0]], dtype=np.uint8)
    for behind_m, expected in ((np.zeros(2), colors[0]), (np.array([0.2, 0.0]), colors[1])):
        image = np.zeros((80, 100, 3), dtype=np.uint8)
        paint_points(image, CAMERA, points, colors, behind_m, size_m=0.01)
        np.testing.assert_array_equal(image[40, 50], expected)
    image = np.zeros((80, 100, 3), dtype=np.uint8)
    unseen = np.array([[np.nan, 0, 0.8], [0, 0, -0.8], [9.0, 9.0, 0.8]])
    paint_points(image, CAMERA, unseen, np.full((3, 3), 255, np.uint8), np.zeros(3), size_m=0.01)
    assert not image.any()


def test_the_item_is_seen_whole_at_every_rotation() -> None:
    points = np.random.default_rng(0).uniform([-0.2, -0.5, 0.7], [0.2, 0.3, 1.0], (500, 3))
    around = camera_around(points, AXIS, 300, 400)
    for angle in np.arange(0.0, 360.0, 30.0):
        places = project(camera_from_object(AXIS, angle).apply(points), around)
        assert ((places > -8) & (places < (408, 308))).all()


# --- the animation --------------------------------------------------------------------------------


def test_what_a_step_adds_is_tinted_while_it_is_held(session: OpenedSession) -> None:
    shown = list(frames(session))
    held = [image for image, count in shown if count > 1]
    assert len(held) == 4  # three steps, and the whole at the end

    def orange(image: np.ndarray) -> int:
        rgb = image.astype(int)[:430, 410:]  # the flattened side
        return int(((rgb[..., 0] - rgb[..., 2]) > 50).sum())

    assert orange(held[0]) > 10_000  # all of the start view
    assert 500 < orange(held[1]) < orange(held[0])
    assert orange(held[-1]) < 100  # the cylinder is grey


def test_an_mp4_has_every_frame(
    session: OpenedSession, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = OpenedSession(replace(session.history, document=Document(start_view=0)), session.integration)
    path = tmp_path / "growth.mp4"
    path.write_bytes(made(session, "growth.mp4"))
    video = cv2.VideoCapture(str(path))
    count = 0
    while video.read()[0]:
        count += 1
    video.release()
    assert count == sum(count for _, count in frames(session))
    monkeypatch.setattr(cv2, "CAP_FFMPEG", cv2.CAP_IMAGES)  # an OpenCV without FFmpeg
    with pytest.raises(FlatclothError, match="pip install --force-reinstall opencv-python-headless"):
        mp4_of(session)


# --- flags: what a reviewer looks at first ---------------------------------------------------------


@pytest.mark.parametrize(
    ("score", "fixed", "flags"),
    [
        (0.99, False, ()),
        (0.99, True, (BY_HAND,)),
        (0.74, False, (LOW,)),
        (0.75, False, ()),
        (0.5, False, (LOW,)),
        (0.49, True, (BY_HAND, BELOW)),
        (None, False, ()),
        (float("nan"), False, ()),
    ],
)
def test_a_view_is_flagged_by_its_score_and_its_hand(
    score: float | None, fixed: bool, flags: tuple[str, ...]
) -> None:
    assert flags_of(Accepted(3, Rigid2(), fixed=fixed, score=score), 0.5, frozenset()) == flags


def test_an_accepted_place_below_the_limit_stays_flagged_and_the_report_says_so(
    session: OpenedSession, text: str
) -> None:
    decisions = session.history.decisions
    standing = next(d for d in decisions if d.stands and d.verdict == "accepted")
    bad = tuple(replace(d, score=0.01) if d is standing else d for d in decisions)
    history = replace(session.history, decisions=bad)
    limit = session.integration.accept_score
    assert overridden(history, limit) == {standing.view_index}
    assert overridden(session.history, limit) == frozenset()
    risen = Accepted(standing.view_index, Rigid2(), score=0.99)
    assert flags_of(risen, limit, overridden(history, limit)) == (OVERRIDDEN,)
    told = report(replace(session, history=history))
    assert f"\u2691 View {standing.view_index}" in told
    assert "accepted against the check of the score" in told
    assert "\u2691" not in text
