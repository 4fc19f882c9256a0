"""Formats of other packages, cameras that the user gives, and options in tables."""

import importlib.metadata
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from foreign_folders import HEIGHT, WIDTH, write_open3d
from tiny_recordings import MemoryRecording, write_recording

from flatcloth.core.errors import RecordingError
from flatcloth.recordings import SourceOptions, open_recording, registry
from flatcloth.recordings.base import Format


def recognises(path: Path) -> bool:
    if path.suffix == ".trip":
        raise OSError("stumbles")
    return path.suffix == ".mine"


def opens(path: Path, options: SourceOptions) -> Any:
    if path.stem == "bad":
        raise KeyError("no such thing")
    return MemoryRecording(name=path.stem, location=str(path))


FORMAT = Format(name="mine", what="a file of mine", recognises=recognises, open=opens)
TUM = Format(name="tum", what="another of that name", recognises=recognises, open=opens)


@pytest.fixture
def added(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Formats that another package adds: a good one, none, one of a name that is taken, a missing one."""
    names = {"mine": "FORMAT", "number": "HEIGHT", "again": "TUM", "missing": "nothing"}
    entries = importlib.metadata.EntryPoints(
        importlib.metadata.EntryPoint(name, f"test_formats:{value}", registry.ENTRY_POINTS)
        for name, value in names.items()
    )
    monkeypatch.setattr(importlib.metadata, "entry_points", lambda group: entries.select(group=group))
    registry._added.cache_clear()
    yield
    registry._added.cache_clear()


def test_a_format_of_another_package_is_found_by_its_entry_point(
    added: None, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "shirt.mine").touch()
    assert open_recording(tmp_path / "shirt.mine").name == "shirt"
    told = "\n".join(caplog.messages)
    assert "number" in told
    assert "has the name of another" in told
    assert "missing" in told
    with pytest.raises(RecordingError, match="a file of mine"):
        open_recording(tmp_path / "nothing")


def test_a_format_of_another_package_may_fail_but_not_the_program(added: None, tmp_path: Path) -> None:
    for name in ("bad.mine", "x.trip"):
        (tmp_path / name).touch()
    with pytest.raises(RecordingError, match="the format mine failed") as caught:
        open_recording(tmp_path / "bad.mine")
    assert "\n" not in str(caught.value)
    with pytest.raises(RecordingError, match="not a recording"):
        open_recording(tmp_path / "x.trip")


def test_a_format_can_be_named(added: None, tmp_path: Path) -> None:
    folder = write_recording(tmp_path / "in")
    assert open_recording(folder, SourceOptions(format="mine")).name == "in"
    with pytest.raises(RecordingError, match="unknown format"):
        open_recording(folder, SourceOptions(format="nobody's"))


def test_a_field_of_view_makes_a_rough_camera_and_says_so(tmp_path: Path) -> None:
    folder = write_open3d(tmp_path / "scan")
    (folder / "intrinsic.json").unlink()
    made = open_recording(folder, SourceOptions(step_deg=10, fov_deg=(60, 50)))
    k = made.intrinsics
    # The rays through the borders of the image enclose the field of view.
    assert math.degrees(math.atan((WIDTH - 0.5 - k.cx) / k.fx) + math.atan((k.cx + 0.5) / k.fx)) == (
        pytest.approx(60)
    )
    assert math.degrees(2 * math.atan(HEIGHT / 2 / k.fy)) == pytest.approx(50)
    assert "approximate" in made.notes[0]  # type: ignore[attr-defined]
    with pytest.raises(RecordingError, match="together with --fov"):
        open_recording(folder, SourceOptions(step_deg=10, fov_deg=(60, 45), camera_file=Path("a.json")))
    with pytest.raises(RecordingError, match="not a field of view"):
        open_recording(folder, SourceOptions(step_deg=10, fov_deg=(0, 200)))


def test_options_survive_a_table(tmp_path: Path) -> None:
    said = SourceOptions(angles=tmp_path / "a.csv", fov_deg=(60.0, 40.0), turning_deg=-90.0, sweep="back")
    assert SourceOptions.from_dict(json.loads(json.dumps(said.to_dict())), "row 1") == said
    row = {"fov_deg": "60, 40", "turning_deg": "-90", "sweep": "back", "angles": "a.csv", "step_deg": ""}
    assert SourceOptions.from_dict(row, "row 1", base=tmp_path) == said


@pytest.mark.parametrize(
    ("row", "cause"),
    [
        ({"speed": 1}, "unknown option 'speed'"),
        ({"step_deg": "fast"}, "step_deg is 'fast'. Give a number"),
        ({"fov_deg": "60"}, "fov_deg is '60'. Give two angles"),
        ({"sweep": "up"}, "sweep is 'up'. Give forth or back"),
        ({"angles": 3}, "angles is 3. Give the name of a file"),
    ],
)
def test_a_row_that_does_not_fit_is_told(row: dict[str, Any], cause: str) -> None:
    with pytest.raises(RecordingError, match=cause) as caught:
        SourceOptions.from_dict(row, "list.csv: line 3")
    assert str(caught.value).startswith("list.csv: line 3")
