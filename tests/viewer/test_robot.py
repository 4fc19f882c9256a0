"""What robots are told: the example client against a running server, and a wrong token."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import httpx
import numpy as np
import pytest
from exported_sessions import Operator, write_cylinder, write_session
from page_tabs import WAIT_S, open_socket

from flatcloth.core.geometry import Rigid3
from flatcloth.engine.integration import Integration
from flatcloth.grasping.grasps import grasp_at
from flatcloth.recordings import open_recording
from flatcloth.session.machine import Document, Start
from flatcloth.session.store import SessionFolder
from flatcloth.viewer import PageServer
from flatcloth.viewer.routes.robot import RobotRoutes

CLIENT = Path(__file__).parents[2] / "examples" / "robot_client.py"


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory):
    place = tmp_path_factory.mktemp("robot")
    recording = write_cylinder(place / "recording")
    session = write_session(place / "session", recording)
    opened = open_recording(recording)
    integration = Integration(opened, method="paper")
    folder = SessionFolder.open(session, opened, integration.config, "paper")
    base_from_camera = Rigid3(np.eye(3), np.array([1.0, 2.0, 3.0]))
    try:
        with PageServer(integration, folder, port=0, base_from_camera=base_from_camera) as running:
            for _ in range(200):
                if ask(running, "/robot/grasps").status_code == 200:
                    break
            yield running
    finally:
        folder.close()


def ask(server: PageServer, path: str, token: str | None = None) -> httpx.Response:
    headers = {"Authorization": f"Bearer {server.token if token is None else token}"}
    return httpx.get(f"http://127.0.0.1:{server.port}{path}", headers=headers, timeout=30)


def test_a_wrong_token_is_refused(server: PageServer) -> None:
    for path in ("/robot/shape", "/robot/grasps"):
        assert ask(server, path, "wrong").status_code == 403


def test_the_shape_is_told_with_its_garment_or_why_there_is_none(server: PageServer) -> None:
    told = ask(server, "/robot/shape").json()
    assert told["area_cm2"] > 0
    assert told["garment"] is not None or told["reason"]


def test_picks_are_given_in_the_robots_frame(server: PageServer) -> None:
    grasp = ask(server, "/robot/grasps").json()["grasps"][0]
    camera, base = (grasp["poses"][frame]["position_m"] for frame in ("camera", "base"))
    assert base == pytest.approx([camera[0] + 1, camera[1] + 2, camera[2] + 3], abs=1e-5)


def test_a_robot_that_speaks_still_hears_what_changes(server: PageServer) -> None:
    with open_socket(server, "/robot/picks") as robot:
        grasp = json.loads(robot.recv(timeout=WAIT_S))["grasp"]
        robot.send("are you there?")
        robot.send("and now?")
        rename = {"type": "rename_pick", "id": grasp["id"], "name": "seam"}
        server.application.receive(0, json.dumps(rename))
        while grasp["name"] != "seam":
            grasp = json.loads(robot.recv(timeout=WAIT_S))["grasp"]
        server.application.receive(0, json.dumps({**rename, "name": "Pick 1"}))


class Page:
    """Counts how often its grasps are computed."""

    def __init__(self) -> None:
        self.picture: Any = SimpleNamespace(document=Document(start_view=0))
        self.picks: tuple[Any, ...] = ()
        self.grips: dict[int, Any] = {}
        self.computed = 0

    def grasps(self, _base_from_camera: Any, *, with_garment: bool) -> dict[str, Any]:
        assert not with_garment
        self.computed += 1
        return {"grasps": [{"id": pick} for pick in self.picks], "base_from_camera": None}


def test_poses_are_computed_for_robots_only_when_something_has_changed() -> None:
    page, integration = Page(), SimpleNamespace(axis=object())
    routes = RobotRoutes(cast("Any", page), cast("Any", integration))
    another = SimpleNamespace(document=page.picture.document)
    changes: tuple[dict[str, Any], ...]
    changes = {"picks": (1,)}, {"picks": (1, 2)}, {"grips": {1: "narrow"}}, {"picture": another}
    for count, change in enumerate(changes, start=1):
        vars(page).update(change)
        for _ in range(3):
            assert set(routes._texts()) == set(page.picks)
        assert page.computed == count
    integration.axis = object()
    assert set(routes._texts()) == {1, 2}
    assert page.computed == 5


def test_the_example_client_hears_the_picks(server: PageServer) -> None:
    page = f"http://127.0.0.1:{server.port}"
    name = ask(server, "/robot/grasps").json()["grasps"][0]["name"]
    command = [sys.executable, str(CLIENT), page, str(server.token), "1"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert name in done.stdout
    refused = subprocess.run([*command[:3], "wrong", "1"], capture_output=True, text=True, timeout=60)
    assert refused.returncode != 0
    assert "403" in refused.stderr


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
        u_m, v_m = piece.uv_from_rc(np.array([row, col]))
        grasp = grasp_at(piece, (float(u_m), float(v_m)), integration.axis, 0.0)
        folder.add_pick("upper", grasp.position_held_m, grasp.normal_held, grasp.view_index, grasp.source_rc)
        with PageServer(integration, folder, port=0) as running:
            while (answer := ask(running, "/robot/grasps")).status_code != 200:
                pass
            (told,) = answer.json()["grasps"]
            area_cm2 = ask(running, "/robot/shape").json()["area_cm2"]
    finally:
        folder.close()
    at = told["flattened"]
    assert (at["file"], at["row"], at["col"]) == ("floating-1.npz", row, col)
    assert area_cm2 == pytest.approx(1e4 * shape.view.area_m2, abs=0.1)
