"""The hand-eye file: what it gives, and every way in which it can be wrong."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flatcloth.core.geometry import rotation_about
from flatcloth.grasping.hand_eye import HandEyeError, read_hand_eye

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
        (rows(1e-200 * TURN), "scales or shears"),
        (rows(TURN @ np.diag([1.0, 1.0, -1.0])), "mirrors"),
        (rows(shift=(400.0, -200.0, 900.0)), "Give metres"),
        (rows(shift=(1e300, 0.0, 0.0)), "Give metres"),
        (np.array(rows()).T.tolist(), "last row"),
        (rows()[:3], "4 rows of 4"),
        ([*rows()[:3], [0.0, 0.0, 1.0]], "4 rows of 4"),
        ([*rows()[:3], [0.0, 0.0, 0.0, None]], "4 rows of 4"),
        ([*rows()[:3], [False, False, False, True]], "4 rows of 4"),
        (rows(shift=(float("inf"), 0.0, 0.0)), "4 rows of 4"),
        ("identity", "4 rows of 4"),
        (None, "4 rows of 4"),
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
