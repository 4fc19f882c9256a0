"""The grips that an operator chose are kept beside the session, and never lost to a bad file or disk."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from flatcloth.core.errors import FlatclothError
from flatcloth.grasping.grasps import Grip
from flatcloth.grasping.grips import GripStore, read_grips

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
        '{"format": "flatcloth-grips/1"}',
        '{"format": "flatcloth-grips/1", "grips": {"x": {"axis_held": null, "opening_m": 0.04}}}',
        '{"format": "flatcloth-grips/1", "grips": {"1": {"axis_held": null, "opening_m": 9}}}',
        '{"format": "flatcloth-grips/1", "grips": {"1": {"axis_held": [0, 0, 0], "opening_m": 0.04}}}',
        '{"format": "flatcloth-grips/1", "grips": {"1": {"axis_held": [NaN, 0, 1], "opening_m": 0.04}}}',
        '{"format": "flatcloth-grips/1", "grips": {"1": {"axis_held": [1, 0], "opening_m": 0.04}}}',
    ],
)
def test_a_damaged_file_is_one_clear_line(tmp_path: Path, text: str) -> None:
    (tmp_path / "grips.json").write_text(text)
    with pytest.raises(FlatclothError, match=r"grips\.json: damaged .*Delete it") as caught:
        GripStore(tmp_path)
    assert "\n" not in str(caught.value)
