"""``view --camera`` on the command line: what is refused, and what the session keeps."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scene_camera import SceneCamera

from flatcloth import cameras
from flatcloth.cli import main
from flatcloth.engine.integration import Integration
from flatcloth.viewer.server import app


@pytest.fixture
def served(monkeypatch: pytest.MonkeyPatch) -> list[Integration]:
    """Serve nothing, but keep what would have been served."""
    shown: list[Integration] = []

    def serve(first: Any, **_options: Any) -> None:
        opened = first()
        shown.append(opened.integration)
        opened.close()

    monkeypatch.setattr(cameras, "open_camera", lambda _serial, _align: SceneCamera())
    monkeypatch.setattr(app, "serve", serve)
    return shown


def test_a_session_of_a_camera_goes_on_with_the_axis_that_was_set_by_hand(
    served: list[Integration], tmp_path: Path
) -> None:
    command = ["view", "--camera", "--out", str(tmp_path / "coat"), "--session", str(tmp_path / "session")]
    assert main(command) == 0
    file = tmp_path / "session" / "axis.json"
    kept = json.loads(file.read_text())
    np.testing.assert_allclose(kept["point_m"], served[0].axis.point_m)
    file.write_text(json.dumps({**kept, "point_m": [0.01, 0.0, 0.83], "estimated": False}))
    assert main(command) == 0
    np.testing.assert_allclose(served[1].axis.point_m, [0.01, 0.0, 0.83])
    assert served[1].axis.estimated is False
