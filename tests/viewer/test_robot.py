"""What robots are told: the example client against a running server, and a wrong token."""

import ast
import base64
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import httpx
import jsonschema
import numpy as np
import pytest
from exported_sessions import Operator, serving, write_cylinder, write_session
from page_tabs import WAIT_S, open_socket, post
from scipy.spatial.transform import Rotation

from flatcloth.core.geometry import Rigid3
from flatcloth.engine.integration import Integration
from flatcloth.export.garment import pick_at
from flatcloth.recordings import open_recording
from flatcloth.session.machine import Start
from flatcloth.session.store import SessionFolder
from flatcloth.viewer.protocol.messages import parsed
from flatcloth.viewer.server.app import PageServer
from flatcloth.viewer.server.workspace import Opened

ROOT = Path(__file__).parents[2]
DOCS = (ROOT / "docs" / "robots.md").read_text()
CLIENTS = dict(re.findall(r"<!-- client (\S+) -->\n```python\n(.*?)```", DOCS, re.DOTALL))


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory):
    place = tmp_path_factory.mktemp("robot")
    recording = write_cylinder(place / "recording")
    session = write_session(place / "session", recording)
    base_from_camera = Rigid3(np.eye(3), np.array([1.0, 2.0, 3.0]))
    with serving(session, recording, base_from_camera=base_from_camera) as running:
        for _ in range(200):
            if ask(running, "/robot/grasps").status_code == 200:
                break
        yield running


def ask(server: PageServer, path: str, token: str | None = None) -> httpx.Response:
    headers = {"Authorization": f"Bearer {server.token if token is None else token}"}
    return httpx.get(f"http://127.0.0.1:{server.port}{path}", headers=headers, timeout=30)


def test_a_robot_that_speaks_still_hears_what_changes(server: PageServer) -> None:
    with open_socket(server, "/robot/events", origin=None) as robot:
        grasp = first_pick(server)
        robot.send("are you there?")
        robot.send("and now?")
        rename = {"type": "rename_pick", "id": grasp["id"], "name": "seam"}
        server.application.receive(0, parsed(json.dumps(rename)))
        while grasp["name"] != "seam":
            grasp = json.loads(robot.recv(timeout=WAIT_S)).get("grasp", grasp)
        server.application.receive(0, parsed(json.dumps({**rename, "name": "Pick 1"})))


@pytest.mark.parametrize("name", ["robot_http.py", "robot_websocket.py", "robot_rosbridge.py"])
def test_the_docs_have_each_client_in_thirty_lines(name: str) -> None:
    assert CLIENTS[name] == (ROOT / "examples" / name).read_text()
    assert CLIENTS[name].count("\n") <= 30


def test_the_example_of_http_gets_poses_at_its_rotation_and_a_pick(server: PageServer) -> None:
    told = ask(server, "/robot/grasps?rotation=90").json()["grasps"][0]
    lines = example(server, "robot_http.py", "http", "90")
    assert f"{told['name']} {told['poses']['camera']['position_m']}" in lines
    number = int(next(line for line in lines if line.startswith("proposed:")).split()[1])
    made = {grasp["id"]: grasp for grasp in ask(server, "/robot/grasps").json()["grasps"]}[number]
    assert made["name"] == "again"
    assert made["position_m"] == told["position_m"]
    forget(server, number)


def test_the_example_of_events_hears_the_shape_and_the_picks(server: PageServer) -> None:
    lines = example(server, "robot_websocket.py", "ws", "3")
    assert any(line.startswith("shape") for line in lines)
    assert any(line.startswith(f"pick {first_pick(server)['name']}") for line in lines)


def test_the_example_of_ros_gets_the_same_numbers(server: PageServer) -> None:
    told = first_pick(server)
    lines = example(server, "robot_rosbridge.py", "ws")
    said = {line.partition(": ")[0]: line.partition(": ")[2] for line in lines}
    x, y, z = told["position_m"]
    assert ast.literal_eval(said["picks"])[0] == {"x": x, "y": y, "z": z}
    assert {"object", "camera", f"pick/{told['id']}"} <= set(ast.literal_eval(said["frames"]))
    assert int(said["points"]) == int(server.application.picture.sheet.canonical.view.valid.sum())
    forget(server, int(said["proposed"]))


def test_transforms_and_picks_of_ros_are_those_of_http(server: PageServer) -> None:
    with open_socket(server, "/robot/rosbridge?rotation=30", origin=None) as robot:
        for topic in ("/tf", "/flatcloth/grasps", "/flatcloth/image"):
            robot.send(json.dumps({"op": "subscribe", "topic": topic}))
        heard: dict[str, Any] = {}
        while len(heard) < 3:
            message = json.loads(robot.recv(timeout=WAIT_S))
            heard[message["topic"]] = message["msg"]
    document = ask(server, "/robot/grasps?rotation=30").json()
    assert json.loads(heard["/flatcloth/grasps"]["data"])["grasps"] == document["grasps"]
    grasp = document["grasps"][0]
    frames = {each["child_frame_id"]: each for each in heard["/tf"]["transforms"]}
    pose = np.eye(4)
    name = f"pick/{grasp['id']}"
    while name in frames:  # up the tree, to the base of the robot
        pose = matrix(frames[name]["transform"]) @ pose
        name = frames[name]["header"]["frame_id"]
    assert name == "base"
    assert pose == pytest.approx(np.array(grasp["poses"]["base"]["matrix"]), abs=1e-6)
    image = cv2.imdecode(np.frombuffer(base64.b64decode(heard["/flatcloth/image"]["data"]), np.uint8), -1)
    assert image.shape[:2] == server.application.picture.sheet.canonical.view.valid.shape


@pytest.mark.parametrize(
    ("said", "reason"),
    [
        ({"op": "subscribe", "topic": "/elsewhere"}, "No topic"),
        ({"op": "call_service", "service": "/reboot"}, "No service"),
        ({"op": "call_service", "service": "/flatcloth/propose_pick", "args": {"uv_m": [9, 9]}}, "mm away"),
        ({"op": "call_service", "service": "/flatcloth/propose_pick", "args": {"uv_m": "x"}}, "array"),
        ({"op": 3}, "not one of rosbridge"),
    ],
)
def test_what_ros_cannot_have_is_refused_in_words(server: PageServer, said: Any, reason: str) -> None:
    with open_socket(server, "/robot/rosbridge", origin=None) as robot:
        robot.send(json.dumps(said))
        answer = json.loads(robot.recv(timeout=WAIT_S))
        assert reason in str(answer.get("msg") or answer.get("values"))
        assert answer.get("result") is not True


@pytest.mark.parametrize(
    ("body", "status", "reason"),
    [
        ({}, 409, "one of point"),
        ({"uv_m": [0, 0], "position_m": [0, 0, 0]}, 409, "one of point"),
        ({"uv_m": [500.0, 0.0]}, 409, "mm away"),
        ({"position_m": [0.0, 0.0, 0.0]}, 409, "mm away"),
        ({"point": "third_sleeve"}, 409, "third_sleeve"),
        ({"uv_m": [0.0, 0.0], "revision": 99999}, 409, "revision 99999"),
        ({"uv_m": [0.0, 0.0], "speed": 1}, 400, "speed"),
        ({"uv_m": [1e9, 0.0]}, 400, "1000"),
    ],
)
def test_a_pick_without_a_place_on_the_shown_shape_is_refused(
    server: PageServer, body: Any, status: int, reason: str
) -> None:
    before = len(ask(server, "/robot/grasps").json()["grasps"])
    answer = post(server, "/robot/pick", json=body)
    assert answer.status_code == status
    assert reason in answer.json()["error"]
    assert len(ask(server, "/robot/grasps").json()["grasps"]) == before


@pytest.mark.parametrize("path", ["/robot/grasps", "/robot/pick", "/export/grasps.json"])
def test_a_rotation_that_is_none_is_refused(server: PageServer, path: str) -> None:
    for rotation in ("left", "nan", "1e9"):
        address = f"{path}?rotation={rotation}"
        answer = post(server, address, json={}) if path.endswith("pick") else ask(server, address)
        assert answer.status_code == 400
        assert "number of degrees" in answer.text
    if path != "/robot/pick":
        assert ask(server, f"{path}?rotation=12.5").json()["rotation_deg"] == 12.5


def test_every_message_is_one_of_the_schema(server: PageServer) -> None:
    valid = jsonschema.Draft202012Validator(ask(server, "/robot/schema.json").json())
    with open_socket(server, "/robot/events", origin=None) as robot:
        for kind in ("hello", "shape", "pick"):
            event = json.loads(robot.recv(timeout=WAIT_S))
            assert event["type"] == kind
            assert valid.is_valid(event)
    event["grasp"]["id"] = "one"
    assert not valid.is_valid(event)


def test_a_deleted_pick_is_told(server: PageServer) -> None:
    with open_socket(server, "/robot/events", origin=None) as robot:
        place = first_pick(server)["flattened"]["uv_m"]
        number = post(server, "/robot/pick", json={"uv_m": place}).json()["grasp"]["id"]
        event: dict[str, Any] = {}
        while event.get("grasp", {}).get("id") != number:
            event = json.loads(robot.recv(timeout=WAIT_S))
        forget(server, number)
        while (event["type"], event.get("id")) != ("pick_deleted", number):  # else of an earlier pick
            event = json.loads(robot.recv(timeout=WAIT_S))


def first_pick(server: PageServer) -> dict[str, Any]:
    return ask(server, "/robot/grasps").json()["grasps"][0]


def forget(server: PageServer, number: int) -> None:
    server.application.receive(0, parsed(json.dumps({"type": "delete_pick", "id": number})))
    server.application.answered(lambda: None)  # the page's thread has done it


def matrix(transform: dict[str, Any]) -> np.ndarray:
    turn, shift = transform["rotation"], transform["translation"]
    made = np.eye(4)
    made[:3, :3] = Rotation.from_quat([turn[key] for key in "xyzw"]).as_matrix()
    made[:3, 3] = [shift[key] for key in "xyz"]
    return made


def example(server: PageServer, name: str, scheme: str, *more: str) -> list[str]:
    """Run a client as the docs have it, and return its lines."""
    command = [sys.executable, "-c", CLIENTS[name], f"{scheme}://127.0.0.1:{server.port}", *more]
    environment = {**os.environ, "FLATCLOTH_TOKEN": str(server.token)}
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, env=environment)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_a_pick_on_a_floating_piece_has_its_pixel_there_and_the_piece_is_not_in_the_area(
    tmp_path: Path,
) -> None:
    # A band across the middle is never seen: the upper half floats.
    opened = open_recording(write_cylinder(tmp_path / "cut", "cut", slice(112, 128)))
    integration = Integration(opened)
    folder = SessionFolder.open(tmp_path / "session", opened, integration.config, integration.method)
    try:
        Operator(integration, folder).do(Start(0))
        shape = integration.canonical(folder.state.document)
        (piece,) = shape.floating
        row, col = (int(n.mean()) for n in np.nonzero(piece.valid))
        pick = pick_at(piece, (row, col), 1, "upper")
        folder.add_pick("upper", pick.position_held_m, pick.normal_held, pick.view_index, pick.source_rc)
        with PageServer(Opened(integration, folder)) as running:
            while (answer := ask(running, "/robot/grasps")).status_code != 200:
                pass
            (told,) = answer.json()["grasps"]
            area_cm2 = ask(running, "/robot/shape").json()["area_cm2"]
    finally:
        folder.close()
    at = told["flattened"]
    assert (at["file"], at["row"], at["col"]) == ("floating-1.npz", row, col)
    assert area_cm2 == pytest.approx(1e4 * shape.view.area_m2, abs=0.1)
