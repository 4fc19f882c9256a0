"""The grips that an operator chose are kept beside the session, and never lost to a bad file or disk."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flatcloth.core.errors import FlatclothError
from flatcloth.core.geometry import rotation_about
from flatcloth.grasping.grasps import Grip
from flatcloth.grasping.grips import GripStore, read_grips
from flatcloth.grasping.hand_eye import HandEyeError, read_hand_eye

SIDEWAYS = Grip(axis_held=(0.6, 0.8, 0.0), opening_m=0.05)


def test_a_grip_comes_back_with_the_session(tmp_path: Path) -> None:
    book = GripStore(tmp_path)
    assert book.get(3) == Grip()
    book.set(10, Grip(opening_m=0.02))
    book.set(3, SIDEWAYS)
    content = json.loads((tmp_path / "grips.json").read_text())
    assert content["format"] == "flatcloth-grips/1"
    assert list(content["grips"]) == ["3", "10"]
    again = GripStore(tmp_path)
    assert dict(again.grips) == {3: SIDEWAYS, 10: Grip(opening_m=0.02)}
    again.forget(3)
    again.forget(99)  # of a pick that never had one
    assert read_grips(tmp_path) == {10: Grip(opening_m=0.02)}


def test_a_disk_that_fails_leaves_the_grip_as_it_was(tmp_path: Path) -> None:
    book = GripStore(tmp_path)
    book.set(1, SIDEWAYS)
    (tmp_path / ".grips.json.partial").mkdir()  # where the draft would be written
    with pytest.raises(FlatclothError, match=r"grips\.json: cannot be written"):
        book.set(1, Grip())
    assert book.get(1) == SIDEWAYS
    assert read_grips(tmp_path) == {1: SIDEWAYS}


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "[" * 99999,
        '{"format": "flatcloth-grips/9", "grips": {}}',
        '{"format": "flatcloth-grips/1", "grips": {"1": {"axis_held": null, "opening_m": 9}}}',
        '{"format": "flatcloth-grips/1", "grips": {"1": {"axis_held": [0, 0, 0], "opening_m": 0.04}}}',
    ],
)
def test_a_damaged_file_is_one_clear_line(tmp_path: Path, text: str) -> None:
    (tmp_path / "grips.json").write_text(text)
    with pytest.raises(FlatclothError, match=r"grips\.json: damaged .*Delete it") as caught:
        GripStore(tmp_path)
    assert "\n" not in str(caught.value)


# --- the hand-eye file -----------------------------------------------------------------------------


TURN = rotation_about(np.array([0.0, 0.6, 0.8]), 1.1)


def written(folder: Path, matrix: Any, **more: Any) -> Path:
    path = folder / "camera.json"
    path.write_text(json.dumps({"format": "flatcloth-hand-eye/1", "base_from_camera": matrix, **more}))
    return path


def rows(turn: np.ndarray = TURN, shift: tuple[float, ...] = (0.4, -0.2, 0.9)) -> list[list[float]]:
    return [*([*map(float, row), x] for row, x in zip(turn, shift, strict=True)), [0.0, 0.0, 0.0, 1.0]]


def test_the_transform_is_read(tmp_path: Path) -> None:
    base_from_camera = read_hand_eye(written(tmp_path, rows(), note="measured in May"))
    np.testing.assert_allclose(base_from_camera.rotation, TURN, atol=1e-12)
    np.testing.assert_allclose(base_from_camera.translation_m, [0.4, -0.2, 0.9])


def test_a_rotation_of_few_digits_is_mended(tmp_path: Path) -> None:
    turn = read_hand_eye(written(tmp_path, rows(np.round(TURN, 4)))).rotation
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(turn, TURN, atol=1e-3)


@pytest.mark.parametrize(
    ("matrix", "cause"),
    [
        (rows(1.01 * TURN), "scales or shears"),
        (rows(1e200 * TURN), "scales or shears"),
        (rows(TURN @ np.diag([1.0, 1.0, -1.0])), "mirrors"),
        (rows(shift=(400.0, -200.0, 900.0)), "Give metres"),
        (np.array(rows()).T.tolist(), "last row"),
        (rows()[:3], "4 rows of 4"),
        ([*rows()[:3], [False, False, False, True]], "4 rows of 4"),
        ("identity", "4 rows of 4"),
    ],
)
def test_a_matrix_that_is_no_rigid_motion_is_one_clear_line(tmp_path: Path, matrix: Any, cause: str) -> None:
    with pytest.raises(HandEyeError, match=rf"camera\.json: .*{cause}") as caught:
        read_hand_eye(written(tmp_path, matrix))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["", "[]", "null", "[" * 99999, '{"format": "flatcloth-hand-eye/2"}'])
def test_a_file_of_another_kind_is_one_clear_line(tmp_path: Path, text: str) -> None:
    path = tmp_path / "camera.json"
    path.write_text(text)
    with pytest.raises(HandEyeError, match=r"camera\.json: .*flatcloth-hand-eye/1"):
        read_hand_eye(path)
