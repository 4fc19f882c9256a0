"""The active loop: a recording grows on disk, it ends for a reason, goes on after a kill, tells faults."""

import json
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cells import SHAPE, led, loop_in, seen, sheet_cell
from garment_evidence import blank_view

from flatcloth.active.choosing import (
    End,
    Learnt,
    Next,
    OtherSide,
    choose_next,
    end_of,
    expected_std_m,
    free_angles_deg,
)
from flatcloth.active.goal import (
    Budget,
    Goal,
    GoalError,
    Knowledge,
    PointKnown,
    doubt_of_kind_m,
    knowledge_of,
    parse_budget,
    parse_goal,
)
from flatcloth.active.incoming import ViewError
from flatcloth.active.log import ActiveLog
from flatcloth.api.integrating import open_session
from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import Rigid2
from flatcloth.engine.garment import GarmentService, KnownGarment
from flatcloth.engine.integration import Integration
from flatcloth.garments.deciding import DecidedPieces
from flatcloth.garments.fit import OUTLINE_STD_M, Fit
from flatcloth.garments.kinds import known_kinds
from flatcloth.garments.model import Kind
from flatcloth.garments.named_points import Point
from flatcloth.garments.recognition import Recognition
from flatcloth.methods.answers import Canonical, JoinedSides
from flatcloth.recordings import open_recording
from flatcloth.recordings.writer import GrowingRecording, RecordingWriter
from flatcloth.session.document import Document


def test_a_shape_is_known_when_no_view_adds_enough_and_each_turn_says_what_it_got(tmp_path: Path) -> None:
    loop = led(loop_in(tmp_path / "out"), sheet_cell(tmp_path / "cell"))
    files = loop.write()
    loop.close()
    assert isinstance(loop.asked, End)
    assert loop.asked.reached, loop.asked
    assert "is expected to add only" in loop.asked.reason
    assert {file.name for file in files} >= {"flattened.npz", "grasps.json", "outcome.json"}
    assert "other_side" in json.loads((tmp_path / "out" / "outcome.json").read_text())  # as ``run`` writes it
    recording = open_recording(tmp_path / "out" / "recording")
    assert 3 <= len(recording) < 12
    lines = [json.loads(line) for line in (tmp_path / "out" / "active.jsonl").read_text().splitlines()]
    asked = [line for line in lines if line["event"] == "ask"]
    got = [line for line in lines if line["event"] == "view"]
    assert [line["number"] for line in asked] == list(range(1, len(recording)))
    assert asked[0]["expected"]["new_cm2"] > 0
    assert "cm2 new" in got[1]["got"]
    # 300 degrees of a cylinder of 0.1 m radius and 0.3 m height
    area_m2 = open_session(tmp_path / "out").view.area_m2
    assert area_m2 == pytest.approx(np.radians(300) * 0.1 * 0.3, rel=0.1)


def test_a_loop_that_was_killed_goes_on_with_the_next_angle(tmp_path: Path) -> None:
    cell = sheet_cell(tmp_path / "cell")
    whole = led(loop_in(tmp_path / "whole"), cell, most=4)
    killed = led(loop_in(tmp_path / "killed"), cell, most=2)
    killed.close()
    again = loop_in(tmp_path / "killed")
    assert again.views == 2
    led(again, cell, most=2)
    assert again.integration.recording.angles_deg == whole.integration.recording.angles_deg
    assert again.document.accepted == whole.document.accepted
    assert again.asked == whole.asked
    again.close()
    whole.close()


def test_a_view_that_was_written_but_not_integrated_before_a_kill_is_integrated(tmp_path: Path) -> None:
    cell = sheet_cell(tmp_path / "cell")
    loop = led(loop_in(tmp_path / "out"), cell, most=1)
    angle_deg, folder = loop.asked.angle_deg, loop.folder / "recording"
    loop.close()
    known = open_recording(folder)
    view = cell.look(angle_deg, 1)
    with RecordingWriter(
        folder, name="", intrinsics=known.intrinsics, depth_scale_m=0.0001, resume=True
    ) as writer:
        units = np.rint(view.depth_units * (cell.depth_scale_m / 0.0001)).astype(np.uint16)
        GrowingRecording(writer).add(angle_deg, view.color, units, view.mask)
    again = loop_in(tmp_path / "out")
    assert again.views == 2
    assert 1 in again.document.used_views
    again.close()


# --- what is wrong with a view ---------------------------------------------------------------


def test_right_angles_are_believed_and_a_wrong_one_is_found_by_registration_and_told(tmp_path: Path) -> None:
    cell = sheet_cell(tmp_path / "cell", span_deg=200.0)
    loop = led(loop_in(tmp_path / "out"), cell, most=2)
    angle_deg = loop.asked.angle_deg
    assert not any("announced" in text for text in loop.take(seen(cell, angle_deg, 2)).told)
    assert loop.stands_deg == angle_deg
    true_deg = loop.asked.angle_deg if isinstance(loop.asked, Next) else 77.0
    taken = loop.take(replace(seen(cell, true_deg, 3), angle_deg=(true_deg + 40.0) % 360.0))
    assert "agrees with the others at" in taken.told[0]
    assert loop.integration.recording.angles_deg[-1] == pytest.approx(true_deg, abs=3.0)
    loop.close()


def test_a_doubled_view_is_taken_once_a_late_one_at_its_angle_and_one_that_is_wrong_not(
    tmp_path: Path,
) -> None:
    cell = sheet_cell(tmp_path / "cell")
    loop = led(loop_in(tmp_path / "out"), cell, most=2)
    asked = loop.asked
    taken = loop.take(seen(cell, loop.stands_deg, 1))
    assert taken.number == 1
    assert "is view 1 already" in taken.told[0]
    assert loop.asked == asked
    assert loop.views == 2
    view = seen(cell, 200.0, 2)
    narrow = view.cropped(slice(None), slice(64))
    with pytest.raises(ViewError, match="64x176 pixels, the views before it 128x176"):
        loop.take(narrow)
    with pytest.raises(ViewError, match="no depth"):
        loop.take(replace(view, depth_m=np.zeros_like(view.depth_m)))
    with pytest.raises(ViewError, match="registered to each other"):
        loop.take(replace(view, color=view.color[:-2]))
    with pytest.raises(ViewError, match="have masks"):
        loop.take(replace(view, mask=None))
    with pytest.raises(ViewError, match="is not an angle"):
        loop.take(replace(view, angle_deg=float("nan")))
    assert loop.views == 2
    taken = loop.take(view, answers=1)
    assert taken.number == 2
    assert "it comes late" in taken.told[0]
    assert loop.stands_deg == 200.0
    loop.close()


def test_the_folder_of_another_session_is_refused(tmp_path: Path) -> None:
    (tmp_path / "session.json").write_text("{}")
    with pytest.raises(FlatclothError, match="holds the session of another recording"):
        loop_in(tmp_path)


def test_a_torn_last_line_of_the_log_is_dropped_and_a_damaged_one_named(tmp_path: Path) -> None:
    loop_in(tmp_path / "out").close()
    log = tmp_path / "out" / "active.jsonl"
    whole = log.read_bytes()
    log.write_bytes(whole + b'{"event": "vi')
    again = loop_in(tmp_path / "out")
    with pytest.raises(FlatclothError, match="another active loop takes its views"):
        loop_in(tmp_path / "out")
    again.close()
    assert log.read_bytes().startswith(whole)
    log.write_bytes(b"nonsense\n" + whole)
    with pytest.raises(FlatclothError, match=r"active\.jsonl: line 1 is damaged"):
        loop_in(tmp_path / "out")


# --- goals -------------------------------------------------------------------------------------


def test_no_angle_near_a_recorded_one_is_free() -> None:
    free = np.array(free_angles_deg([0.0, 358.0]))
    assert len(free_angles_deg([])) == 120
    assert free.min() >= 5.0
    assert free.max() <= 353.0


NEXT = Next(angle_deg=60.0, turn_deg=60.0, why="", most_new_m2=0.01)
LEAST_M2 = 0.002


@pytest.mark.parametrize(
    ("about", "following", "exhausted", "said"),
    [
        ("points:shoulder_left", NEXT, False, None),
        ("points:shoulder_left", NEXT, True, "shoulder_left cannot be known: no angle shows"),
        ("points:shoulder_left", None, False, "shoulder_left cannot be known: no angle shows"),
        ("points:shoulder_left", replace(NEXT, hidden=("shoulder_left",)), False, "hidden in a fold"),
        ("kind", replace(NEXT, most_new_m2=0.001), False, "The kind cannot be known"),
        ("shape", replace(NEXT, most_new_m2=0.001), False, "expected to add only 10 cm2"),
        ("shape", replace(NEXT, most_new_m2=float("nan")), False, None),
        ("shape", NEXT, True, "Views stand all round, and the last ones added less than 20 cm2"),
    ],
)  # fmt: skip
def test_a_loop_ends_when_nothing_is_worth_a_turn_and_says_why(
    about: str, following: Next | None, exhausted: bool, said: str | None
) -> None:
    goal = parse_goal(about)
    end = end_of(following, Learnt(), goal, LEAST_M2, is_exhausted=exhausted)
    assert (end is None) == (said is None)
    if end is not None:
        assert (said or "") in end.reason
        assert end.reached == (about == "shape")
        assert end.hidden == goal.points


def test_a_point_is_as_unsure_as_the_kinds_that_lay_it_elsewhere() -> None:
    shorts, skirt, towel = (kind_named(name) for name in ("shorts", "skirt", "towel"))
    place = shorts.named(shorts.mean[:, None])["waist_left"][:, 0]
    there = skirt.named(skirt.mean[:, None])["waist_left"][:, 0]
    off = Rigid2(0.0, *(there - place - (0.3, 0.0)).tolist())  # lays the skirt's point 0.3 m beside
    fits = (fit_of(shorts, Rigid2()), fit_of(skirt, off), fit_of(towel, Rigid2()))
    point = Point(uv_m=place, std_m=0.014, pixel=(0, 0))

    def doubt_m(probabilities: tuple[float, float, float]) -> float:
        found = Recognition(
            probabilities=dict(zip(("shorts", "skirt", "towel"), probabilities, strict=True)),
            fits=fits,
            dimensions={},
            points={"waist_left": point},
        )
        return doubt_of_kind_m("waist_left", found)

    assert doubt_m((0.5, 0.5, 0.0)) == pytest.approx(0.3 * np.sqrt(0.5 / 2))
    assert doubt_m((0.25, 0.25, 0.5)) == pytest.approx(0.3 * np.sqrt(0.5 / 2))  # a towel has no waist
    assert doubt_m((0.95, 0.05, 0.0)) == 0.0


def known_by_the_other_side(name: str) -> KnownGarment:
    """Return a skirt whose named point is not seen on this side, but on the other."""
    skirt = kind_named("skirt")
    uv = np.array([-0.01, 0.01])  # mirrored, it is a pixel of the view
    at = skirt.named(skirt.mean[:, None])[name][:, 0]
    found = Recognition(
        probabilities={"skirt": 0.95, "none of these": 0.05},
        fits=(fit_of(skirt, Rigid2(0.0, *(at - uv).tolist())),),
        dimensions={},
        points={name: Point(uv_m=uv, std_m=0.014, pixel=None)},
    )
    sheet = Canonical(view=blank_view(np.ones((10, 10), dtype=np.bool_)), current_from_view={})
    return KnownGarment(
        canonical=sheet,
        evidence=(),
        by_evidence=found,
        found=found,
        pieces=DecidedPieces(shape_from_piece={}, refused=frozenset()),
        sides=JoinedSides(other=sheet, seams=(), is_related=True),
    )


def test_a_point_is_known_if_the_other_side_shows_it() -> None:
    goal, known = parse_goal("points:waist_left"), known_by_the_other_side("waist_left")
    assert knowledge_of(0.1, known).is_reached(goal)
    assert knowledge_of(0.1, replace(known, sides=None)).missing(goal) == ("waist_left",)


def test_both_sides_are_asked_while_the_item_turns_until_enough_is_known(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked, turned = list[int](), threading.Event()
    sure = known_by_the_other_side("waist_left")

    def by_both(integration: Integration, document: Document) -> tuple[GarmentService, KnownGarment | None]:
        turned.wait()
        asked.append(len(integration.views.angles_deg))
        return GarmentService(integration), sure if len(asked) == 2 else None

    monkeypatch.setattr("flatcloth.active.loop.known_by_both", by_both)
    cell, loop = sheet_cell(tmp_path / "cell"), loop_in(tmp_path / "out", parse_goal("points:waist_left"))
    for number, angle_deg in enumerate((0.0, 60.0)):
        loop.take(seen(cell, angle_deg, number))
    assert isinstance(loop.asked, Next), "the next angle is known before both sides are"
    assert asked == []
    turned.set()
    loop.take(seen(cell, 120.0, 2))
    loop.wait()
    assert asked == [2, 3]
    assert isinstance(loop.asked, End)
    assert loop.knowledge.is_reached(loop.goal)
    loop.close()


def test_an_angle_that_shows_a_seam_of_what_floats_is_chosen(tmp_path: Path) -> None:
    cell, loop = sheet_cell(tmp_path / "cell"), loop_in(tmp_path / "out", parse_goal("kind"))
    for number, angle_deg in enumerate((0.0, 60.0)):
        loop.take(seen(cell, angle_deg, number))
    loop.wait()
    seams_m2 = np.zeros(120)
    seams_m2[67] = 1.0  # at 201 degrees
    other = OtherSide(area_m2=0.1, new_m2=np.zeros(120), seams_m2=seams_m2, shares={})
    learnt = Learnt(known=loop.known, knowledge=loop.knowledge, other=other)
    found = choose_next(loop.integration, loop.document, learnt, loop.goal, 60.0)
    assert found.angle_deg == 201.0
    assert "10000 cm2 of the other side" in found.why
    loop.close()


def kind_named(name: str) -> Kind:
    return next(kind for kind in known_kinds() if kind.name == name)


def fit_of(kind: Kind, pose: Rigid2) -> Fit:
    return Fit(
        kind=kind,
        parameters=kind.mean,
        garment_from_piece=(pose,),
        energy=0.0,
        log_evidence=0.0,
        covariance=np.eye(len(kind.mean) + 3),
    )


def test_a_point_is_expected_to_be_surer_by_new_cloth_by_cloth_seen_again_and_by_more_outline() -> None:
    nothing, one = np.zeros(1), np.ones(1)
    assert expected_std_m(0.05, nothing, nothing, one) == pytest.approx(0.05)
    assert expected_std_m(0.05, one, nothing, one) == pytest.approx(OUTLINE_STD_M)
    again = expected_std_m(0.05, nothing, one, one)  # the edges were seen once: 1/2 becomes 2/3
    assert again**2 - OUTLINE_STD_M**2 == pytest.approx(0.75 * (0.05**2 - OUTLINE_STD_M**2))
    twice_the_cloth = expected_std_m(0.05, nothing, nothing, 2.0 * one)
    assert twice_the_cloth**2 - OUTLINE_STD_M**2 == pytest.approx(0.5 * (0.05**2 - OUTLINE_STD_M**2))


def test_views_that_brought_nothing_end_a_loop_only_all_round(tmp_path: Path) -> None:
    log = ActiveLog(tmp_path)
    for number in range(6):
        log.add("view", number=number, new_m2=0.0, news=False)
    sixths = [0.0, 60.0, 120.0, 180.0, 240.0, 300.0]
    assert log.is_exhausted(sixths, 0.002, SHAPE)
    assert not log.is_exhausted([*sixths[:5], 290.0], 0.002, SHAPE)  # 70 degrees are open
    # that nothing shows it is said later than that the rest is small
    assert not log.is_exhausted(sixths, 0.002, Goal(about="kind"))
    assert log.is_exhausted([*sixths, *(angle + 30.0 for angle in sixths)], 0.002, Goal(about="kind"))
    log.add("view", number=6, new_m2=0.0, news=True)
    assert not log.is_exhausted([*sixths, 30.0], 0.002, SHAPE)
    log.close()


@pytest.mark.parametrize("knows_axis", [True, False])
def test_views_without_masks_keep_the_side_that_was_seen_first(tmp_path: Path, knows_axis: bool) -> None:
    cell = sheet_cell(tmp_path / "cell")
    loop = loop_in(tmp_path / "out", views=4)
    while isinstance(loop.asked, Next):
        view = replace(seen(cell, loop.asked.angle_deg, loop.views), mask=None)
        if not knows_axis:
            view = replace(view, axis=None, held_point_m=None)
        told = loop.take(view).told
        assert not any("announced" in text for text in told)
    assert loop.views == 4
    assert len(loop.document.strokes) == 1
    least_m2 = 0.08 if knows_axis else 0.05  # one view shows 0.07 m2; an axis of a cylinder is hardly known
    assert loop.knowledge.area_m2 > least_m2
    assert loop.write()
    loop.close()


# --- goals that are said ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("points:nose", "no known garment has these points"),
        ("points:waist_left,cuff", "no known garment has these points"),
        ("size", "give shape, kind, or points"),
    ],
)
def test_a_goal_that_cannot_be_is_refused_with_what_can(text: str, why: str) -> None:
    with pytest.raises(GoalError, match=why):
        parse_goal(text)


def test_goals_and_budgets_are_read() -> None:
    goal = parse_goal("points:shoulder_left, shoulder_right", 15.0)
    assert goal == Goal(about="points", points=("shoulder_left", "shoulder_right"), within_m=0.015)
    assert parse_budget("7") == Budget(views=7.0)
    assert parse_budget("90s").seconds == 90.0
    for text in ("", "s", "-3", "0", "1.5", "12 views"):
        with pytest.raises(GoalError, match="--budget"):
            parse_budget(text)


def test_points_are_known_when_seen_and_sure_and_the_kind_when_probable() -> None:
    goal = Goal(about="points", points=("a", "b"), within_m=0.02)
    seen_point, sure = PointKnown(std_m=0.015, seen=True), PointKnown(std_m=0.015)
    assert Knowledge(points={"a": seen_point, "b": seen_point}).is_reached(goal)
    assert Knowledge(points={"a": seen_point, "b": sure}).missing(goal) == ("b",)
    assert Knowledge(points={"a": seen_point}).missing(goal) == ("b",)
    kind = Goal(about="kind")
    assert Knowledge(kind="tshirt", probability=0.95).is_reached(kind)
    assert not Knowledge(kind="tshirt", probability=0.85).is_reached(kind)
    assert not Knowledge(kind=None, probability=0.95).is_reached(kind)


def test_a_kind_that_contradicts_that_of_a_view_less_is_less_sure() -> None:
    before = Knowledge(kind="trousers", probability=0.65)
    now = Knowledge(kind="long_sleeved_shirt", probability=0.98)
    assert now.sobered(before).probability == pytest.approx((0.98 + 0.35) / 2)
    assert not now.sobered(before).is_reached(Goal(about="kind"))
    assert now.sobered(replace(before, kind=now.kind)) == now
    assert (
        now.sobered(Knowledge(probability=0.9)) == now
    )  # that it fitted no garment says nothing for another
    unsure = replace(now, probability=0.3)
    assert unsure.sobered(replace(before, probability=0.1)) == unsure  # never surer by a contradiction
    assert now.is_news(before, Goal(about="kind"))
    assert not now.is_news(now, Goal(about="kind"))
