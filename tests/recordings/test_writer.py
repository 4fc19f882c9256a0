"""Recording folders that the program writes: nothing kept is lost, nothing is overwritten."""

import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from full_disks import full
from tiny_recordings import HEIGHT, WIDTH, write_image, write_recording

from flatcloth.cli import main
from flatcloth.core.errors import RecordingError
from flatcloth.core.types import Intrinsics, RotationAxis
from flatcloth.recordings import open_recording
from flatcloth.recordings.writer import RecordingWriter

CAMERA = Intrinsics(width=WIDTH, height=HEIGHT, fx=20.0, fy=20.0, cx=7.5, cy=5.5)
AXIS = RotationAxis(point_m=np.array([0.01, -0.1, 0.85]), direction=np.array([0.0, -1.0, 0.0]))


def color(n: int) -> np.ndarray:
    pixels = np.zeros((HEIGHT, WIDTH, 3), dtype=np.uint8)
    pixels[...] = (200, 100, n)
    return pixels


def depth(n: int) -> np.ndarray:
    pixels = np.full((HEIGHT, WIDTH), 8000 + n, dtype=np.uint16)
    pixels[0, 0] = 0
    return pixels


def writing(folder: Path, **more: Any) -> RecordingWriter:
    about = {"name": "coat", "intrinsics": CAMERA, "depth_scale_m": 0.0001, **more}
    return RecordingWriter(folder, **about)


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    mask = np.zeros((HEIGHT, WIDTH), dtype=bool)
    mask[3:] = True
    about = {"description": "a coat", "rotation_axis": AXIS, "held_point_m": [0.0, -0.2, 0.8]}
    with writing(tmp_path / "a" / "b", **about) as made:
        assert [made.add(a, color(n), depth(n), mask) for n, a in enumerate((0.0, 12.5, -10.0))] == [0, 1, 2]
        assert made.angles_deg == (0.0, 12.5, -10.0)
    read = open_recording(made.folder)
    assert (read.name, read.description, read.intrinsics) == ("coat", "a coat", CAMERA)
    assert read.angles_deg == (0.0, 12.5, -10.0)
    np.testing.assert_array_equal(read.rotation_axis.point_m, AXIS.point_m)
    np.testing.assert_array_equal(read.held_point_m, [0.0, -0.2, 0.8])
    frame = read[1]
    np.testing.assert_array_equal(frame.color, color(1))
    np.testing.assert_array_equal(frame.depth_m, depth(1).astype(np.float32) * np.float32(0.0001))
    np.testing.assert_array_equal(frame.mask, mask)


def test_a_copy_of_masks_that_name_both_sides_names_both(tmp_path: Path) -> None:
    folder, out = write_recording(tmp_path / "tiny"), tmp_path / "copy"
    for n in range(3):
        write_image(folder / f"mask/{n}.png", np.repeat(np.uint8([[0], [128], [255]]), WIDTH, 1).repeat(4, 0))
    assert main(["import", str(folder), "--out", str(out)]) == 0
    for one, other in zip(open_recording(folder), open_recording(out), strict=True):  # type: ignore[call-overload]
        np.testing.assert_array_equal(other.mask, one.mask)
        np.testing.assert_array_equal(other.other_mask, one.other_mask)
        assert other.other_mask.any()


@pytest.mark.parametrize("at", range(9))
def test_a_crash_at_any_write_keeps_every_view_before_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, at: int
) -> None:
    """The process dies before, within or after the write of each file of the third view."""
    with writing(tmp_path) as made:
        made.add(0, color(0), depth(0))
        made.add(10, color(1), depth(1))

        class Killed(BaseException):
            pass

        steps = iter(range(100))

        def dying(real: Any) -> Any:
            def step(*arguments: Any) -> Any:
                if next(steps) == at:
                    raise Killed
                return real(*arguments)

            return step

        monkeypatch.setattr(os, "fsync", dying(os.fsync))
        monkeypatch.setattr(Path, "replace", dying(Path.replace))
        with pytest.raises(Killed):
            made.add(20, color(2), depth(2))
        monkeypatch.undo()
    read = open_recording(tmp_path)
    # After the header is in its place, and only then, the third view counts.
    assert read.angles_deg[:2] == (0.0, 10.0)
    assert len(read) == (3 if at == 8 else 2)
    for n in range(len(read)):
        np.testing.assert_array_equal(read[n].color, color(n))
    with writing(tmp_path, resume=True) as again:
        assert again.add(30, color(5), depth(5)) == len(read)
    np.testing.assert_array_equal(open_recording(tmp_path)[len(read)].color, color(5))


def test_a_full_disk_is_told_and_the_view_can_be_repeated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with writing(tmp_path) as made:
        made.add(0, color(0), depth(0))
        monkeypatch.setattr("flatcloth.recordings.writer.os.fsync", full)
        with pytest.raises(RecordingError, match=r"view 1 cannot be written .No space left on device.*saved"):
            made.add(10, color(1), depth(1))
        monkeypatch.undo()
        assert len(open_recording(tmp_path)) == len(made) == 1
        assert not list(tmp_path.rglob("*.partial"))
        assert made.add(10, color(1), depth(1)) == 1
    assert len(open_recording(tmp_path)) == 2


def test_a_folder_with_anything_in_it_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "holiday.txt").write_text("mine")
    for resume in (False, True):
        with pytest.raises(RecordingError, match="not empty"):
            writing(tmp_path, resume=resume)
    assert [p.name for p in tmp_path.iterdir()] == ["holiday.txt"]


def test_a_recording_is_gone_on_with_only_when_asked(tmp_path: Path) -> None:
    with writing(tmp_path, description="first") as made:
        made.add(0, color(0), depth(0))
    before = (tmp_path / "recording.json").read_bytes()
    with pytest.raises(RecordingError, match=r"contains a recording.*--resume"):
        writing(tmp_path)
    assert (tmp_path / "recording.json").read_bytes() == before
    with writing(tmp_path, description="second", resume=True) as made:
        assert made.angles_deg == (0.0,)
        made.add(10, color(1), depth(1))
    assert open_recording(tmp_path).description == "first"


def test_resuming_never_writes_over_a_listed_image(tmp_path: Path) -> None:
    with writing(tmp_path) as made:
        for n in range(3):
            made.add(10 * n, color(n), depth(n))
    header = json.loads((tmp_path / "recording.json").read_text())
    del header["views"][0]  # by hand: 001 and 002 are left, and there are two views
    (tmp_path / "recording.json").write_text(json.dumps(header))
    with writing(tmp_path, resume=True) as made:
        made.add(40, color(9), depth(9))
    read = open_recording(tmp_path)
    assert [int(read[n].color[0, 0, 2]) for n in range(3)] == [1, 2, 9]


@pytest.mark.parametrize("change", [{"intrinsics": replace(CAMERA, fx=21.0)}, {"depth_scale_m": 0.001}])
def test_another_camera_cannot_go_on(tmp_path: Path, change: dict[str, Any]) -> None:
    with writing(tmp_path) as made:
        made.add(0, color(0), depth(0))
    with pytest.raises(RecordingError, match="another camera or other settings"):
        writing(tmp_path, resume=True, **change)


def test_a_recording_with_lens_distortion_cannot_go_on(tmp_path: Path) -> None:
    write_recording(tmp_path)
    header = json.loads((tmp_path / "recording.json").read_text())
    header["intrinsics"] |= {"distortion_model": "brown_conrady", "distortion": [0.1, 0, 0, 0, 0]}
    (tmp_path / "recording.json").write_text(json.dumps(header))
    with pytest.raises(RecordingError, match="other settings"):
        writing(tmp_path, depth_scale_m=0.001, resume=True)


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"views": [], "format": 3}', "\xff", "[" * 100_000])
def test_a_damaged_header_is_not_gone_on_with(tmp_path: Path, text: str) -> None:
    (tmp_path / "recording.json").write_text(text, encoding="latin-1")
    with pytest.raises(RecordingError, match=r"recording.json: (not a recording that can|was recorded with)"):
        writing(tmp_path, resume=True)


def test_two_writers_do_not_share_a_folder_and_one_without_views_is_resumed(tmp_path: Path) -> None:
    with writing(tmp_path), pytest.raises(RecordingError, match="another flatcloth is writing"):
        writing(tmp_path, resume=True)
    with writing(tmp_path, resume=True) as made:
        assert made.add(0, color(0), depth(0)) == 0


def test_a_file_in_the_place_of_the_folder_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("x")
    with pytest.raises(RecordingError, match=r"out: cannot be written .File exists"):
        writing(tmp_path / "out")


def test_a_view_that_no_reader_would_take_is_refused(tmp_path: Path) -> None:
    with writing(tmp_path) as made:
        made.add(0, color(0), depth(0))
        bad: list[tuple[str, tuple[Any, ...]]] = [
            ("view 1 has the angle of view 0", (360.005, color(1), depth(1))),
            ("has the angle nan", (float("nan"), color(1), depth(1))),
            ("has the angle 4000", (4000.0, color(1), depth(1))),
            ("no depth, every pixel is 0", (10, color(1), depth(1) * 0)),
            ("color image of view 1 is float64", (10, color(1) / 255, depth(1))),
            (r"color image of view 1 is uint8 \(12, 16\)", (10, color(1)[..., 0], depth(1))),
            ("depth image of view 1 is float32", (10, color(1), depth(1).astype(np.float32))),
            ("depth image of view 1", (10, color(1), depth(1)[:-1])),
            ("has a mask, unlike view 0", (10, color(1), depth(1), depth(1) > 0)),
            ("mask image of view 1", (10, color(1), depth(1), depth(1)[1:] > 0)),
        ]
        for message, arguments in bad:
            with pytest.raises(RecordingError, match=message):
                made.add(*arguments)
        assert len(made) == 1
    with pytest.raises(RecordingError, match="is closed"):
        made.add(10, color(1), depth(1))
    assert len(open_recording(tmp_path)) == 1
