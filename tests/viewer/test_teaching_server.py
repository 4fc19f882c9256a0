"""What the teaching mode of a page is sent: whole lessons, and nothing once it hangs up."""

from __future__ import annotations

import asyncio
import json
import struct
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import cv2
import numpy as np
import pytest
from plates import EVERY_20, THICKNESS_M, TOP_M, plate
from route_client import RouteClient
from scenes import AXIS, CAMERA, Cylinder
from starlette.applications import Starlette
from starlette.routing import Route

from flatcloth.core.errors import SurfaceError
from flatcloth.core.types import RgbdFrame
from flatcloth.engine.integration import Integration
from flatcloth.engine.teaching import Teaching
from flatcloth.viewer.http import REFUSALS
from flatcloth.viewer.modes.teaching import PARTS, TeachingRoutes
from flatcloth.viewer.worker import Executor

CLOTH = {"angles_deg": tuple(10.0 * n for n in range(36)), "span_deg": (-150.0, 60.0)}
DTYPES = {"int8": 1, "uint8": 1, "int16": 2, "int32": 4, "float32": 4}


WAIT_S = 30
TOLD: list[Any] = []  # how far a lesson is, as the state of the page tells it


@pytest.fixture(scope="module")
def integration():
    return Integration(Cylinder(**CLOTH))


def teaching(integration, executor=None) -> TeachingRoutes:
    """The teaching mode of a page that knows neither a garment nor another side."""
    executor = executor or Executor(lambda job: job())
    known = {"garments": SimpleNamespace(last=None), "other_sheet": None, "tell_lesson": TOLD.append}
    page = SimpleNamespace(integration=integration, executor=executor, **known)
    return TeachingRoutes(cast("Any", page))


@pytest.fixture(scope="module")
def routes(integration):
    executor = Executor(lambda job: job())
    yield teaching(integration, executor)
    executor.stop()


class Page:
    """Asks the routes as a page does."""

    def __init__(self, routes):
        self.app = Starlette(routes=[Route("/teaching/{part}", routes.serve)], exception_handlers=REFUSALS)
        self._client = RouteClient(app=self.app)

    def get(self, address, **query):
        answer = self._client.get(address, **({"params": query} if query else {}))
        return answer.status_code, answer.content


def sent_until(page, path, left: threading.Event) -> list[Any]:
    """What a page is sent that hangs up when ``left`` is set."""
    sent: list[Any] = []

    async def receive():
        while not left.is_set():
            await asyncio.sleep(0.01)
        return {"type": "http.disconnect"}

    async def send(message):
        sent.append(message)

    scope = {"type": "http", "method": "GET", "path": path, "query_string": b"start_view=0", "headers": []}
    with ThreadPoolExecutor(1) as pool:  # Playwright keeps a loop running in this thread
        pool.submit(asyncio.run, asyncio.wait_for(page.app(scope, receive, send), WAIT_S)).result()
    return sent


@pytest.fixture(scope="module")
def page(routes):
    return Page(routes)


def lesson(page, part, **query):
    TOLD.clear()
    status, data = page.get(f"/teaching/{part}", **query)
    assert status == 200, data
    text, body = struct.unpack_from("<II", data)
    values = json.loads(data[8 : 8 + text], parse_constant=lambda word: pytest.fail(f"{word} in JSON"))
    assert len(data) == 8 + text + body
    assert values["kind"] == part
    *progress, end = TOLD
    assert end is None
    assert all(0 <= each.share <= 1 for each in progress)
    assert part != "alignment" or len(progress) > 5, "progress is told before the lesson"
    return values, data[8 + text :]


def array(values, body, name):
    part = values["parts"][name]
    data = body[part["at"] : part["at"] + part["bytes"]]
    return np.frombuffer(data, dtype=part["kind"]).reshape(part["shape"])


ALL_VIEWS = ("start", "sides", "garment", "seams", "check")


@pytest.mark.parametrize("part", [part for part in PARTS if part not in ALL_VIEWS])
def test_arrays_and_pictures_are_whole(page, part):
    assert_whole(*lesson(page, part, start_view=0))


def assert_whole(values, body):
    end = 0
    for name, piece in values["parts"].items():
        assert piece["at"] == end + -end % 8, name  # an array may be read where it lies
        end = piece["at"] + piece["bytes"]
        if piece["kind"] == "png":
            data = np.frombuffer(body[piece["at"] : end], np.uint8)
            image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
            assert image.shape == (*piece["shape"], 4), name
        else:
            assert piece["bytes"] == DTYPES[piece["kind"]] * int(np.prod(piece["shape"])), name
    assert end == len(body)


def test_the_choice_of_the_start_view_and_the_occluding_edges_are_told(page, integration):
    values, body = lesson(page, "start", start_view=1)
    assert_whole(values, body)
    areas = array(values, body, "area_cm2")
    assert areas == pytest.approx(1e4 * integration.views.observed_areas_m2(), rel=1e-5)
    parts = {each["view"]: each["part_cm2"] for each in values["tried"]}
    assert max(parts, key=parts.get) == values["view_index"] == Teaching(integration).start_view()
    assert areas[next(iter(parts))] == areas.max()
    assert values["session_view"] == 1
    planning, body = lesson(page, "planning", start_view=0)
    for side in planning["sides"]:  # a cylinder turns away on both sides
        edge = array(planning, body, f"edge_{side['side']}")
        assert side["occluding_edge_mm"] > 0
        assert len(edge) > 10
    left, right = (array(planning, body, f"edge_{side}")[:, 0].mean() for side in ("left", "right"))
    assert left < right


def test_the_flattening_is_told_as_it_is(page, integration):
    values, body = lesson(page, "flattening", start_view=0)
    lessons = Teaching(integration)
    flattening = lessons.flattening(0, lessons.defaults).flattening
    for told, level in zip(values["levels"], flattening.levels, strict=True):
        assert told["interval_px"] == level.sampling_interval_px
        assert told["points"] == len(level.points_rc)
        assert told["energy_mm2"] == pytest.approx([1e6 * h for h in level.energy])
        states = array(values, body, f"{told['name']}_states")
        assert states == pytest.approx(np.array(level.states), abs=1e-6)
        assert len(told["state_iterations"]) == len(states)
    view = flattening.view
    source = array(values, body, "source_rc")
    top, left = flattening.surface.frame.offset_rc
    assert source[~view.valid].max() == -1
    # A flattened pixel leads to the image pixel that shows the same cloth.
    expected = view.source_rc[view.valid] - (top, left)
    assert np.abs(source[view.valid] - expected).max() <= 0.5
    assert values["defaults"] == {
        "sampling_interval_px": 12,
        "z_angle_limit_deg": 50.0,
        "overlap_cm2": round(2000 * float(integration.views.observed_areas_m2().max())),
    }


def test_the_sliders_reach_the_sessions_own_values():
    config = Integration(Cylinder(**CLOTH)).config
    config = replace(config, planning=replace(config.planning, z_angle_limit_deg=80.0, overlap_area_m2=0.004))
    routes = teaching(Integration(Cylinder(**CLOTH), config))
    values, _ = lesson(Page(routes), "flattening", start_view=0)
    assert values["sliders"]["z_angle_limit_deg"]["high"] == 80.0
    assert values["sliders"]["overlap_cm2"]["low"] == 40.0


@pytest.mark.parametrize(
    ("address", "status", "told"),
    [
        (
            "/teaching/magic",
            404,
            "Unknown part 'magic'; choose one of flattening, start, planning, alignment, sides, garment, "
            "seams, check.",
        ),
        ("/teaching/planning?color=1", 400, "color is no field that is known"),
        ("/teaching/planning?start_view=one", 400, "start_view is text; expected a whole number"),
        ("/teaching/planning?z_angle_limit_deg=nan", 400, "z_angle_limit_deg is 'nan'; expected a number"),
        ("/teaching/planning?start_view=36", 400, "the recording has 36 views, none numbered 36"),
        ("/teaching/planning?start_view=-1", 400, "none numbered -1"),
    ],
)
def test_a_question_that_means_nothing_is_refused(page, address, status, told):
    answered, text = page.get(address)
    assert answered == status
    assert told in text.decode()


class Plate:
    """Two layers, 2 mm apart, without masks."""

    name, description, location, held_point_m = "plate", "", "plate", TOP_M
    rotation_axis, angles_deg, has_masks, intrinsics = AXIS, EVERY_20, False, CAMERA

    def __init__(self) -> None:
        self._views = plate(gripper=True)

    def __len__(self) -> int:
        return len(self._views)

    def __getitem__(self, view_index: int) -> RgbdFrame:
        return self._views[view_index].frame


def test_the_sides_without_masks_are_shown_with_their_evidence():
    routes = teaching(Integration(Plate()))
    values, body = lesson(Page(routes), "sides")
    assert values["kind"] == "sides"
    assert_whole(values, body)
    place, opposite = array(values, body, "section_mm"), array(values, body, "opposite")
    side, normal = array(values, body, "section_side"), array(values, body, "section_normal")
    assert len(opposite) > 10
    assert (side[opposite[:, 0]] * side[opposite[:, 1]] == -1).all()
    # The side of interest looks at the camera of the start view, 2 mm before the other; v points to it.
    front, back = (place[(side == sign) & (np.abs(normal[:, 1]) > 0.9), 1] for sign in (1, -1))
    assert np.median(front) - np.median(back) == pytest.approx(1e3 * THICKNESS_M, abs=0.3)
    assert normal[(side == 1) & (np.abs(normal[:, 1]) > 0.9), 1].min() > 0.9
    first = array(values, body, "first_side")
    assert first.shape == (values["first"]["rows"], values["first"]["cols"])
    assert set(np.unique(first)) == {1, 2}


def test_the_garment_is_explained_by_an_example_until_there_is_a_shape(integration):
    routes = teaching(integration)
    values, body = lesson(Page(routes), "garment", revision=3)
    assert_whole(values, body)
    assert values["flat"] is None
    assert values["kinds"][0]["name"] == "tshirt"
    assert sum(kind["probability"] for kind in values["kinds"]) + values["none"] == pytest.approx(1.0)
    states, energy = array(values, body, "states"), np.array(values["energy"])
    assert list(states.shape[:2]) == list(energy.shape)
    best = energy[-1].argmin()
    assert energy[-1, best] < 0.3 * energy[0, best]
    # The best start ends on the true edges.
    edges, outline = array(values, body, "edge_uv"), array(values, body, "outline_tshirt")
    assert dist_to(edges, outline) < 0.01
    assert dist_to(edges, states[-1, best]) < 0.01 < dist_to(edges, states[0, best])


def dist_to(places: np.ndarray, outline: np.ndarray) -> float:
    """Return the median distance of places from a closed outline."""
    a, b = outline[None], np.roll(outline, -1, axis=0)[None]
    along = b - a
    share = ((places[:, None] - a) * along).sum(axis=2) / np.maximum((along**2).sum(axis=2), 1e-12)
    off = places[:, None] - a - np.clip(share, 0, 1)[..., None] * along
    return float(np.median(np.linalg.norm(off, axis=2).min(axis=1)))


def test_what_goes_wrong_is_told_and_the_next_question_is_answered(page, routes, monkeypatch, caplog):
    def fail(*_):
        raise error

    error: Exception = SurfaceError("View 4: nothing to see; use another view.")
    monkeypatch.setattr(Teaching, "flattening", fail)
    assert page.get("/teaching/flattening", start_view=0) == (409, str(error).encode())
    error = ZeroDivisionError("oh")
    told = b"Unexpected error while computing: ZeroDivisionError('oh'). See the terminal."
    assert page.get("/teaching/flattening", start_view=0) == (409, told)
    assert "unexpected error while computing" in caplog.text
    monkeypatch.undo()
    lesson(page, "flattening", start_view=0)


def test_hanging_up_gives_the_computation_up(page, monkeypatch):
    began, stopped = threading.Event(), threading.Event()

    def endless(_self, _view, _parameters, progress):
        began.set()
        try:
            while True:
                progress(0.5, "still at it")
                stopped.wait(0.001)
        finally:
            stopped.set()

    monkeypatch.setattr(Teaching, "alignment", endless)
    sent = sent_until(page, "/teaching/alignment", began)
    assert stopped.wait(WAIT_S)
    assert sent[0]["status"] == 499
