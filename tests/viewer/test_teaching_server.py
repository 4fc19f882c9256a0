"""What the teaching mode of a page is sent: whole lessons, and nothing once it hangs up."""

from __future__ import annotations

import asyncio
import threading
from concurrent.futures import ThreadPoolExecutor
from io import BytesIO
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
from flatcloth.core.parcel import unpack
from flatcloth.core.types import RgbdFrame
from flatcloth.engine.integration import Integration
from flatcloth.engine.teaching import Teaching
from flatcloth.viewer.http import REFUSALS
from flatcloth.viewer.modes.teaching import TeachingRoutes
from flatcloth.viewer.worker import Executor

CLOTH = {"angles_deg": tuple(10.0 * n for n in range(36)), "span_deg": (-150.0, 60.0)}
WAIT_S = 30
TOLD: list[Any] = []  # how far a lesson is, as the state of the page tells it


class Page:
    """Asks the teaching mode as a page does that knows no garment."""

    def __init__(self, integration):
        known = {"garments": SimpleNamespace(last=None), "tell_lesson": TOLD.append}
        own = SimpleNamespace(integration=integration, executor=Executor(lambda job: job()), **known)
        routes = [Route("/teaching/{part}", TeachingRoutes(cast("Any", own)).serve)]
        self.app, self.stop = Starlette(routes=routes, exception_handlers=REFUSALS), own.executor.stop
        self._client = RouteClient(app=self.app)

    def get(self, address, **query):
        answer = self._client.get(address, **({"params": query} if query else {}))
        return answer.status_code, answer.content

    def lesson(self, part, **query):
        """A lesson with its arrays."""
        TOLD.clear()
        status, data = self.get(f"/teaching/{part}", **query)
        assert status == 200, data
        values, arrays = unpack(BytesIO(data).read)
        *progress, end = TOLD
        assert end is None
        assert all(0 <= each.share <= 1 for each in progress)
        assert part != "alignment" or len(progress) > 5, "progress is told before the lesson"
        return values, arrays


@pytest.fixture(scope="module")
def integration():
    return Integration(Cylinder(**CLOTH))


@pytest.fixture(scope="module")
def page(integration):
    asking = Page(integration)
    yield asking
    asking.stop()


def test_the_choice_of_the_start_view_and_the_rotation_are_told(page, integration):
    values, arrays = page.lesson("start")
    assert arrays["area_cm2"] == pytest.approx(1e4 * integration.views.observed_areas_m2(), rel=1e-5)
    parts = {each["view"]: each["part_cm2"] for each in values["tried"]}
    assert max(parts, key=parts.get) == values["view_index"] == Teaching(integration).start_view()
    assert arrays["area_cm2"][next(iter(parts))] == arrays["area_cm2"].max()
    planning, arrays = page.lesson("planning", start_view=0)
    for side in planning["plan"]["sides"]:  # a cylinder turns away on both sides
        assert side["occluding_edge_m"] > 0
        assert len(arrays[f"edge_{side['side']}"]) > 10
    left, right = (arrays[f"edge_{side}"][:, 0].mean() for side in ("left", "right"))
    assert left < right


def test_the_flattening_is_told_as_it_is(page, integration):
    values, arrays = page.lesson("flattening", start_view=0)
    lessons = Teaching(integration)
    flattening = lessons.paper(lessons.defaults).views.flattening(0)
    for n, level in enumerate(flattening.levels):
        assert arrays[f"states_{n}"] == pytest.approx(np.array(level.states), abs=1e-6)
        assert arrays[f"energy_mm2_{n}"] == pytest.approx(1e6 * np.array(level.energy))
        # The energy is that of the pairs that are drawn.
        last, (first, second) = arrays[f"states_{n}"][-1], arrays[f"state_pairs_{n}"].T
        length = np.linalg.norm(last[first] - last[second], axis=1) - arrays[f"state_length_{n}"]
        assert (length**2).sum() == pytest.approx(level.energy[-1], rel=1e-3, abs=1e-10)
    # A flattened pixel leads, by the corners of its triangle, to the image pixel that shows the same cloth.
    view, corners = flattening.view, arrays["triangles"]
    (row, col), (top, left) = np.argwhere(view.valid)[1000], flattening.surface.frame.offset_rc
    a, b, c = np.moveaxis(arrays["corners_uv"][corners], 1, 0)
    uv = view.uv_from_rc(np.array([row, col]))
    weight = np.linalg.solve(np.stack([b - a, c - a], axis=-1), (uv - a)[..., None])[..., 0]
    (inside,) = np.flatnonzero((weight >= 0).all(axis=1) & (weight.sum(axis=1) <= 1))[:1]
    shares = np.array([1 - weight[inside].sum(), *weight[inside]])
    x, y = shares @ arrays["corners_xy"][corners[inside]]
    assert (y, x) == pytest.approx(view.source_rc[row, col] - (top, left), abs=0.01)
    assert values["defaults"] == {
        "sampling_interval_px": 12,
        "z_angle_limit_deg": 50.0,
        "overlap_cm2": round(2000 * float(integration.views.observed_areas_m2().max())),
    }


@pytest.mark.parametrize(
    ("address", "status", "told"),
    [
        (
            "/teaching/magic",
            404,
            "Unknown part 'magic'; choose one of flattening, planning, alignment, start, ",
        ),
        ("/teaching/planning?color=1", 400, "color is no field that is known"),
        ("/teaching/planning?start_view=one", 400, "start_view is text; expected a whole number"),
        ("/teaching/planning?z_angle_limit_deg=nan", 400, "z_angle_limit_deg is 'nan'; expected a number"),
        ("/teaching/planning?start_view=36", 400, "The recording has 36 views, none numbered 36"),
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
    rotation_axis, angles_deg, has_masks, is_growing, intrinsics = AXIS, EVERY_20, False, False, CAMERA

    def __init__(self) -> None:
        self._views = plate(gripper=True)

    def __len__(self) -> int:
        return len(self._views)

    def __getitem__(self, view_index: int) -> RgbdFrame:
        return self._views[view_index].frame


def test_the_sides_without_masks_are_shown_with_their_evidence():
    values, arrays = Page(Integration(Plate())).lesson("sides")
    place, opposite = arrays["section_mm"], arrays["opposite"]
    side, normal = arrays["section_side"], arrays["section_normal"]
    assert len(opposite) > 10
    assert (side[opposite[:, 0]] * side[opposite[:, 1]] == -1).all()
    # The side of interest looks at the camera of the start view, 2 mm before the other; v points to it.
    front, back = (place[(side == sign) & (np.abs(normal[:, 1]) > 0.9), 1] for sign in (1, -1))
    assert np.median(front) - np.median(back) == pytest.approx(1e3 * THICKNESS_M, abs=0.3)
    assert normal[(side == 1) & (np.abs(normal[:, 1]) > 0.9), 1].min() > 0.9
    assert arrays["first_side"].shape == (values["first"]["rows"], values["first"]["cols"])
    assert set(np.unique(arrays["first_side"])) == {1, 2}


def test_the_garment_is_explained_by_an_example_until_there_is_a_shape(page):
    values, arrays = page.lesson("garment", revision=3)
    assert values["flat"] is None
    assert values["kinds"][0]["name"] == "tshirt"
    assert sum(kind["probability"] for kind in values["kinds"]) + values["none"] == pytest.approx(1.0)
    states, energy = arrays["states"], np.array(values["energy"])
    assert list(states.shape[:2]) == list(energy.shape)
    best = energy[-1].argmin()
    assert energy[-1, best] < 0.3 * energy[0, best]
    # The best start ends on the true edges.
    assert dist_to(arrays["edge_uv"], states[-1, best]) < 0.01 < dist_to(arrays["edge_uv"], states[0, best])


def dist_to(places: np.ndarray, outline: np.ndarray) -> float:
    """Return the median distance of places from a closed outline."""
    off = [cv2.pointPolygonTest(outline, (float(u), float(v)), True) for u, v in places]
    return float(np.median(np.abs(off)))


def test_what_goes_wrong_is_told_and_the_next_question_is_answered(page, monkeypatch, caplog):
    def fail(*_):
        raise error

    error: Exception = SurfaceError("View 4: nothing to see; use another view.")
    monkeypatch.setattr(Teaching, "alignment", fail)
    assert page.get("/teaching/alignment", start_view=0) == (409, str(error).encode())
    error = ZeroDivisionError("oh")
    told = b"Unexpected error while computing: ZeroDivisionError('oh'). See the terminal."
    assert page.get("/teaching/alignment", start_view=0) == (409, told)
    assert "unexpected error while computing" in caplog.text
    monkeypatch.undo()
    page.lesson("planning", start_view=0)


def test_hanging_up_gives_the_computation_up(page, monkeypatch):
    began, stopped, sent = threading.Event(), threading.Event(), []

    def endless(_self, _view, _parameters, progress):
        began.set()
        try:
            while True:
                progress(0.5, "still at it")
                stopped.wait(0.001)
        finally:
            stopped.set()

    async def receive():
        while not began.is_set():
            await asyncio.sleep(0.01)
        return {"type": "http.disconnect"}

    async def send(message):
        sent.append(message)

    monkeypatch.setattr(Teaching, "alignment", endless)
    about = {"path": "/teaching/alignment", "query_string": b"start_view=0", "headers": []}
    asked = page.app({"type": "http", "method": "GET", **about}, receive, send)
    with ThreadPoolExecutor(1) as pool:  # Playwright keeps a loop running in this thread
        pool.submit(asyncio.run, asyncio.wait_for(asked, WAIT_S)).result()
    assert stopped.wait(WAIT_S)
    assert sent[0]["status"] == 499
