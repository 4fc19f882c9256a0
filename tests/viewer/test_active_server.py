"""An active loop over HTTP and on the page: the example client, a cell, and views that are wrong."""

from __future__ import annotations

import base64
import contextlib
import functools
import importlib.util
import io
import json
import socket
import threading
from dataclasses import replace
from multiprocessing.context import ForkServerProcess
from pathlib import Path
from typing import Any

import cv2
import httpx
import numpy as np
import pytest
from cells import SHAPE, loop_in, seen, sheet_cell
from forked_program import forked
from garment_meshes import arc, write_obj
from page_tabs import Tab, get, post
from PIL import Image as PillowImage
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from flatcloth.active.eye import view_of_cell
from flatcloth.active.goal import Budget
from flatcloth.active.incoming import SeenView
from flatcloth.active.service import ActiveService
from flatcloth.core.geometry import camera_from_object
from flatcloth.engine.garment import KnownGarment
from flatcloth.garments.deciding import DecidedPieces
from flatcloth.garments.named_points import Point
from flatcloth.garments.recognition import Recognition
from flatcloth.recordings import open_recording
from flatcloth.viewer.modes.active import ActiveApplication, PageLoop, active_routes
from flatcloth.viewer.protocol.robot import Hello, Image, PointsChanged, PostedView, ShapeChanged
from flatcloth.viewer.routes.robot import Client
from flatcloth.viewer.server.active import loop_events
from flatcloth.viewer.server.app import PageServer
from flatcloth.viewer.server.workspace import Opened

ROOT = Path(__file__).parents[2]
TOKEN = "0123456789abcdef0123456789abcdef"


def free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def started(out: Path, mesh: Path, port: int) -> ForkServerProcess:
    """The program with a budget of three views, listening."""
    command = ["active", "--cell", str(mesh), "--panel", "1", "--sensor", "none", "--listen", str(port)]
    process, printed = forked([*command, "--out", str(out), "--budget", "3"], str(ROOT))
    listens = threading.Event()

    def read() -> None:
        with open(printed) as said:
            for line in said:
                if "Robots ask" in line:
                    listens.set()

    threading.Thread(target=read, daemon=True).start()
    assert listens.wait(60), "it does not listen"
    return process


def client() -> Any:
    """The example, as a module."""
    spec = importlib.util.spec_from_file_location("robot_active", ROOT / "examples" / "robot_active.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def sheet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A mesh; robot and program know the token."""
    monkeypatch.setenv("FLATCLOTH_TOKEN", TOKEN)
    return write_obj(tmp_path / "sheet.obj", *arc(300.0, columns=48))


def test_the_example_client_turns_until_the_end_and_what_becomes_known_is_pushed(
    tmp_path: Path, sheet: Path
) -> None:
    port, events = free_port(), list[dict[str, Any]]()
    process = started(tmp_path / "out", sheet, port)
    headers = {"Authorization": f"Bearer {TOKEN}"}
    with connect(f"ws://127.0.0.1:{port}/robot/events", additional_headers=headers) as pushed:
        end = client().run(f"http://127.0.0.1:{port}")
        with contextlib.suppress(ConnectionClosed):  # the program ends
            for text in pushed:
                events.append(json.loads(text))
    assert "budget of 3 views" in end["reason"]
    assert end["views"] == 3
    process.join(60)
    assert process.exitcode == 1
    assert len(open_recording(tmp_path / "out" / "recording")) == 3
    assert (tmp_path / "out" / "grasps.json").exists()
    assert (events[0]["type"], events[0]["recording"]) == ("hello", "out")
    shapes = [event for event in events if event["type"] == "shape"]
    revisions = [shape["revision"] for shape in shapes]  # of those that were learnt from before the next came
    assert revisions == sorted(set(revisions))
    assert shapes[-1] == {**shapes[-1], "revision": 3, "views": [0, 1, 2]}
    last = [event for event in events if event["type"] == "points"][-1]
    assert (last["kind"], last["revision"]) == ("towel", 3)
    names = {point["name"] for point in last["points"]}  # of one end: which is the first one, nothing tells
    assert names in ({"corner_0", "corner_1"}, {"corner_2", "corner_3"})


def test_poses_of_named_points_are_pushed_once_at_the_rotation_of_the_item(tmp_path: Path) -> None:
    cell, loop = sheet_cell(tmp_path / "cell"), loop_in(tmp_path / "out", SHAPE)
    events, told = loop_events(ActiveService(loop)), Client()
    assert [type(event) for event in events(told)] == [Hello]
    loop.take(seen(cell, 0.0))
    loop.take(seen(cell, 50.0, 1))
    loop.wait()
    assert ShapeChanged in [type(event) for event in events(told)]
    canonical = loop.integration.canonical(loop.document)
    pixel = tuple(np.argwhere(canonical.view.valid)[0].tolist())
    point = Point(uv_m=canonical.view.uv_from_rc(np.array(pixel)), std_m=0.01, pixel=pixel)
    found = Recognition(probabilities={"skirt": 1.0}, fits=(), dimensions={}, points={"waist_left": point})
    known = KnownGarment(
        canonical=canonical,
        evidence=(),
        by_evidence=found,
        found=found,
        pieces=DecidedPieces(shape_from_piece={}, refused=frozenset()),
    )
    loop._learnt = replace(loop._learnt, known=known, views=2)
    (points,) = events(told)
    assert isinstance(points, PointsChanged)
    assert points.rotation_deg == 50.0
    (grasp,) = points.points
    assert grasp.name == "waist_left"
    held, camera = np.array(grasp.position_m), grasp.poses["camera"].position_m
    assert camera == pytest.approx(camera_from_object(cell.axis, 50.0).apply(held[None])[0], abs=1e-4)
    assert list(events(told)) == []
    loop.close()


# --- views that a robot sends ------------------------------------------------------------------


class Served:
    """Asks the routes of a loop without a server."""

    def __init__(self, service: ActiveService) -> None:
        from route_client import RouteClient

        self._client = RouteClient(active_routes(service))

    def next(self, query: str = "") -> dict[str, Any]:
        return self._client.get(f"/robot/next{query}").json()

    def post(self, body: Any) -> httpx.Response:
        data = body if isinstance(body, bytes) else json.dumps(body).encode()
        return self._client.post("/robot/view", content=data)


def raw(values: np.ndarray) -> dict[str, Any]:
    values = np.ascontiguousarray(values)
    data = base64.b64encode(values.tobytes()).decode()
    return {"raw": data, "shape": list(values.shape), "dtype": str(values.dtype)}


def png(values: np.ndarray) -> dict[str, Any]:
    stored = values[..., ::-1] if values.ndim == 3 else values
    return {"png": base64.b64encode(cv2.imencode(".png", stored)[1].tobytes()).decode()}


def body_of(view: SeenView, pack: Any = raw) -> dict[str, Any]:
    k, axis = view.intrinsics, view.axis
    return {
        "angle_deg": view.angle_deg,
        "K": [[k.fx, 0, k.cx], [0, k.fy, k.cy], [0, 0, 1]],
        "color": pack(view.color),
        "depth": pack(np.rint(view.depth_m / 0.0001).astype(np.uint16)),
        "depth_scale_m": 0.0001,
        "mask": pack(view.mask.astype(np.uint8) * 255),
        "axis": {"point_m": axis.point_m.tolist(), "direction": axis.direction.tolist()},
        "held_point_m": view.held_point_m.tolist(),
    }


@pytest.fixture
def served(tmp_path: Path):
    loop = loop_in(tmp_path / "out", SHAPE)
    yield Served(ActiveService(loop))
    loop.close()


def test_sent_views_are_those_of_the_camera_raw_or_as_png(tmp_path: Path, served: Served) -> None:
    cell = sheet_cell(tmp_path / "cell")
    assert served.next()["angle_deg"] == 0.0
    for number, pack in enumerate((raw, png)):
        asked = served.next()
        view = seen(cell, asked["angle_deg"], number)
        answer = served.post({**body_of(view, pack), "number": asked["number"]})
        assert answer.status_code == 200, answer.text
        assert answer.json()["taken"] == {**answer.json()["taken"], "number": number, "told": []}
        stored = open_recording(tmp_path / "out" / "recording")[number]
        assert np.array_equal(stored.color, view.color)
        assert np.abs(stored.depth_m - view.depth_m).max() < 1e-4
        assert np.array_equal(stored.mask, view.mask)
    following = served.next("?rotation=30")
    assert following["rotation_deg"] == 30.0
    assert following["stands_deg"] == asked["angle_deg"]
    assert following["expected"]["new_cm2"] > 0


def test_a_sent_view_that_is_wrong_is_refused_in_words(tmp_path: Path, served: Served) -> None:
    good = body_of(seen(sheet_cell(tmp_path / "cell"), 0.0))
    wide = {**good["color"], "shape": [1, 1, 3]}
    cases: list[tuple[Any, str]] = [
        (b"{", "Input data was truncated"),
        ({**good, "angle_deg": 1e9}, "angle_deg"),
        ({**good, "angle": 3}, "unknown field"),
        ({**good, "color": None}, "belong together"),
        ({**good, "color": {"png": "AAAA"}}, "color is no whole PNG"),
        ({**good, "color": wide}, "its shape and dtype need 3"),
        ({**good, "depth": good["color"]}, "depth must be uint16"),
        ({**good, "color": good["mask"]}, "Give uint8 (H, W, 3), RGB"),
        ({**good, "depth": png(np.zeros((4, 4), np.uint8))}, "depth must be uint16"),
        ({**good, "K": [[200, 5, 0], [0, 200, 0], [0, 0, 1]]}, "is no camera matrix"),
        ({**good, "K": [[1e5, 0, 0], [0, 1e5, 0], [0, 0, 1]]}, "fx is 100000"),
        ({**good, "mask": png(np.zeros((4, 4), np.uint8))}, "masks[0]"),
    ]
    for body, why in cases:
        answer = served.post(body)
        assert answer.status_code == 400, why
        assert why in answer.json()["error"]
    alone = served.post({"angle_deg": 0.0})
    assert alone.status_code == 409
    assert "flatcloth has no camera here" in alone.json()["error"]
    assert served.post(good).status_code == 200
    again = served.post(good).json()  # the answer was lost, and the robot sends it again
    assert again["taken"]["number"] == 0
    assert "not taken twice" in again["taken"]["told"][0]
    assert again["views"] == 1


def test_the_transparency_of_a_sent_png_is_no_fourth_channel() -> None:
    values, file = np.arange(12, dtype=np.uint8).reshape(2, 2, 3), io.BytesIO()
    PillowImage.fromarray(values).save(file, "PNG", transparency=(0, 1, 2))
    depth = Image(raw=bytes([1, 0] * 4), shape=(2, 2), dtype="uint16")
    camera = ((2.0, 0.0, 1.0), (0.0, 2.0, 1.0), (0.0, 0.0, 1.0))
    posted = PostedView(angle_deg=0.0, color=Image(png=file.getvalue()), depth=depth, K=camera)
    assert np.array_equal(posted.view().color, values)


def test_views_sent_at_the_same_time_are_taken_one_after_the_other(tmp_path: Path, served: Served) -> None:
    cell = sheet_cell(tmp_path / "cell")
    served.post(body_of(seen(cell, 0.0)))
    bodies = [body_of(seen(cell, angle, n)) for n, angle in enumerate((50.0, 310.0), start=1)]
    codes: list[int] = []
    threads = [
        threading.Thread(target=lambda body=body: codes.append(served.post(body).status_code))
        for body in bodies
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert codes == [200, 200]
    assert sorted(open_recording(tmp_path / "out" / "recording").angles_deg) == [0.0, 50.0, 310.0]


# --- on the page: the cell turns at a click or by Auto, or a robot turns ---------------------------


SPOILED = 3
"""The number of the view that shows too little to be flattened."""


@pytest.fixture
def cell_page(tmp_path: Path):
    cell = sheet_cell(tmp_path / "cell")

    def eye(angle_deg: float, number: int) -> SeenView:
        view = view_of_cell(cell, angle_deg, number)
        if number == SPOILED:
            seen = np.argwhere(view.mask)[:3]
            view = replace(view, mask=np.zeros_like(view.mask))
            view.mask[tuple(seen.T)] = True
        return view

    loop = PageLoop(tmp_path / "out", SHAPE, Budget(views=5.0))
    loop.take(eye(0.0, 0))
    controller = functools.partial(ActiveApplication, loop, eye=eye)
    opened = Opened(loop.integration, loop.session, controller=controller, close=loop.close)
    with PageServer(opened) as server:
        yield server


def asking(state: dict) -> bool:
    return state["active"]["angle_deg"] is not None and not state["active"]["turning"]


def action(state: dict, name: str) -> str | None:
    return next(row["why_not"] for row in state["actions"] if row["name"] == name)


def test_another_goal_is_pursued_from_now_on(cell_page: PageServer) -> None:
    with Tab(cell_page) as tab:
        assert tab.state_where(asking)["active"]["goal"] == "shape"
        tab.say(type="aim", goal="kind")
        state = tab.state_where(lambda s: s["active"]["goal"] == "kind")
        assert state["active"]["knows"] == "no garment recognised"
        tab.say(type="aim", goal="weight")
        assert "give shape, kind, or points" in tab.note()["text"]
        assert cell_page.application.status().goal == "kind"  # type: ignore[attr-defined]


def test_a_click_or_a_robot_turns_the_cell_and_the_view_is_a_proposal_as_any_other(
    cell_page: PageServer, tmp_path: Path
) -> None:
    with Tab(cell_page) as tab:
        state = tab.state_where(asking)
        asked = state["active"]["angle_deg"]
        assert action(state, "step") is None
        tab.say(type="do", action="step")
        state = tab.state_where(lambda s: s["pending"] and s["layers"]["overlay"])
        assert state["pending"]["view_index"] == 1
        assert state["active"]["waiting"]
        assert action(state, "step") is not None
        assert open_recording(tmp_path / "out" / "recording").angles_deg == (0.0, asked)
        tab.say(type="do", action="accept", view_index=1)
        state = tab.state_where(lambda s: asking(s) and s["active"]["views"] == 2)
        assert [view["state"] for view in state["views"]] == ["start", "accepted"]
        assert state["active"]["angle_deg"] not in (0.0, asked)
        assert state["active"]["steps"][-1]["got"].endswith("cm2 new")
        # A robot announces to the page, and waits for the operator, who rejects: the next angle is asked.
        following = get(cell_page, "/robot/next").json()
        assert (following["waiting"], following["number"]) == (None, 2)
        answer = post(
            cell_page, "/robot/view", json={"angle_deg": following["angle_deg"], "number": 2}
        ).json()
        assert answer["taken"]["number"] == 2
        assert "its proposal is decided on the page" in answer["waiting"]
        tab.state_where(lambda s: s["pending"] and s["layers"]["overlay"])
        tab.say(type="do", action="reject", view_index=2)
        state = tab.state_where(lambda s: asking(s) and s["active"]["views"] == 3)
        assert [view["state"] for view in state["views"]] == ["start", "accepted", "rejected"]


def test_auto_goes_on_after_a_view_that_cannot_be_flattened_until_the_loop_ends_and_its_files_are_written(
    cell_page: PageServer, tmp_path: Path
) -> None:
    with Tab(cell_page) as tab:
        assert action(tab.state_where(asking), "auto") is None
        matrix = np.eye(4).tolist()
        file = {"format": "flatcloth-hand-eye/1", "base_from_camera": matrix}
        assert post(cell_page, "/hand-eye", content=json.dumps(file).encode()).status_code == 200
        tab.say(type="auto", running=True)
        state = tab.state_where(lambda s: s["active"]["end"] and not s["auto"]["running"])
        assert "budget of 5 views" in state["active"]["end"]
        assert (state["active"]["views"], state["step"]) == (5, 4)
    assert get(cell_page, "/robot/next").json()["done"]
    grasps = json.loads((tmp_path / "out" / "grasps.json").read_text())
    assert grasps["base_from_camera"] == matrix
    # Turns that the loop asked for are no fault of the recording.
    assert get(cell_page, "/check.json").json()["findings"] == []
