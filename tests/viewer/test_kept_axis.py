"""Another turning axis: what is derived again, and what a resumed session has."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import AXIS, Cylinder

from flatcloth.core.errors import JournalError
from flatcloth.core.types import RotationAxis
from flatcloth.engine.integration import Integration
from flatcloth.session.kept import AXIS_FILE, read_axis, settle_axis, write_axis
from flatcloth.session.store import SessionFolder

SHIFTED = RotationAxis(
    point_m=np.add(AXIS.point_m, (0.01, 0.0, -0.02)), direction=np.array([0.0, -0.8, 0.6]), estimated=True
)


def same(a: RotationAxis | None, b: RotationAxis) -> bool:
    return bool(
        np.allclose(a.point_m, b.point_m)
        and np.allclose(a.direction, b.direction)
        and a.estimated == b.estimated
    )


# --- what is derived -------------------------------------------------------------------------


def test_another_axis_derives_everything_again() -> None:
    made = Integration(Cylinder(angles_deg=(0.0, 20.0, 40.0)))
    before = made.views.flattening(1), made.views.cloud(1)
    made.views.turn_about(SHIFTED)
    assert made.axis is SHIFTED
    after = made.views.flattening(1), made.views.cloud(1)
    assert after[0] is not before[0]
    assert not np.allclose(after[1].xyz_m, before[1].xyz_m)
    made.views.turn_about(AXIS)
    np.testing.assert_array_equal(made.views.cloud(1).xyz_m, before[1].xyz_m)


# --- the session -----------------------------------------------------------------------------


def test_an_estimated_axis_belongs_to_the_session(tmp_path: Path) -> None:
    bare = Cylinder(angles_deg=(0.0,), rotation_axis=None, held_point_m=None)
    made = Integration(bare)
    folder = SessionFolder.open(tmp_path / "session", bare, made.config, made.method)
    assert settle_axis(folder.folder, made.axis) is made.axis
    assert same(read_axis(folder.folder), made.axis)
    folder.close()
    write_axis(tmp_path / "session", SHIFTED)
    assert same(settle_axis(tmp_path / "session", made.axis), SHIFTED)


def test_a_recorded_axis_is_not_written_beside_the_session(tmp_path: Path) -> None:
    settle_axis(tmp_path, AXIS)
    assert not (tmp_path / AXIS_FILE).exists()


@pytest.mark.parametrize(
    "change",
    [
        {"format": "flatcloth-axis/2"},
        {"direction": [0.0, -2.0, 0.0]},
        {"direction": [0.0, float("nan"), 0.0]},
        None,
    ],
)
def test_a_damaged_axis_is_one_line(tmp_path: Path, change: dict[str, Any] | None) -> None:
    write_axis(tmp_path, AXIS)
    path = tmp_path / AXIS_FILE
    path.write_text("{" if change is None else json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(JournalError, match="damaged") as caught:
        read_axis(tmp_path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_an_axis_that_cannot_be_written_or_read_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(JournalError, match="cannot be written"):
        write_axis(tmp_path / "nowhere", AXIS)
    (tmp_path / AXIS_FILE).mkdir()
    with pytest.raises(JournalError, match="cannot be read"):
        read_axis(tmp_path)
