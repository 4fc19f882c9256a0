"""RealSense files through the real code: written by librealsense itself, played, damaged, imported."""

import os
import re
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Generator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from realsense_files import HEIGHT, WALL_M, WIDTH, Shot, stop_and_go, turning, write_realsense
from scenes import CAMERA, Cylinder

from flatcloth.cli import main
from flatcloth.core.errors import RecordingError
from flatcloth.recordings import Recording, open_recording
from flatcloth.recordings.files import libraries as realsense_library
from flatcloth.recordings.options import SourceOptions
from flatcloth.recordings.realsense.player import RealsensePlayer, is_realsense
from flatcloth.recordings.realsense.turned import open_realsense

STOPS = 3
STEP_DEG = 10.0


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with ``stops.db3``, an item turned in steps, and ``turning.db3``, turned all the time."""
    folder = tmp_path_factory.mktemp("realsense")
    write_realsense(folder / "stops.db3", turning(stop_and_go(STOPS, STEP_DEG, 0.9, 0.8), 4.6))
    write_realsense(folder / "turning.db3", turning(lambda t: 12.0 * t, 4.0))
    return folder


def depth_error_mm(recording: Recording, view_index: int, angle_deg: float) -> np.ndarray:
    true, _ = Cylinder(angles_deg=(angle_deg,)).surface(0)
    frame = recording[view_index]
    cloth = (frame.depth_m > 0) & (frame.depth_m < 1.2) & np.isfinite(true)
    assert cloth.mean() > 0.15
    return 1000 * (frame.depth_m - true)[cloth]


def test_the_stops_of_a_file_become_views(files: Path) -> None:
    read = open_realsense(files / "stops.db3")
    assert read.angles_deg == (0.0, 10.0, 20.0)
    assert read.intrinsics == CAMERA
    assert (read.name, read.has_masks, read.rotation_axis) == ("stops", False, None)
    assert read.notes == ("3 stops were found in 4.5 s, assumed 10 degrees apart.",)
    for n in range(STOPS):
        error = depth_error_mm(read, n, n * STEP_DEG)
        # Frames have 1 mm units and 1.1 mm of noise; the average of the stop's frames is better.
        assert np.median(np.abs(error)) < 0.5
        assert abs(np.median(error)) < 0.2
        color = Cylinder(angles_deg=(n * STEP_DEG,))[0].color.astype(int)
        shown = read[n].color.astype(int)
        assert np.median(np.abs(shown - color)[color.any(axis=2)]) < 2
    with pytest.raises(IndexError):
        read[STOPS]


def test_each_stop_has_a_filter_of_its_own(tmp_path: Path) -> None:
    """What a carried temporal filter would mix in: the place of the cloth at the stop before."""

    def wall(depth_mm: int, at: float) -> list[Shot]:
        rng = np.random.default_rng(depth_mm)
        texture = np.repeat(rng.integers(40, 200, (HEIGHT // 8, WIDTH // 8), dtype=np.uint8), 8, 0).repeat(
            8, 1
        )
        color = np.repeat(texture[..., None], 3, axis=2)
        return [Shot(at + n / 15, color, np.full((HEIGHT, WIDTH), depth_mm, np.uint16)) for n in range(11)]

    file = write_realsense(tmp_path / "walls.db3", [*wall(850, 0.0), *wall(858, 11 / 15)])
    read = open_realsense(file)
    assert [float(np.median(read[n].depth_m)) for n in range(2)] == pytest.approx([0.850, 0.858], abs=2e-4)


def test_a_camera_that_is_no_stereo_camera_is_not_biased(tmp_path: Path) -> None:
    """librealsense's filters round whole millimetres down at each step, 4 mm in all."""
    file = write_realsense(tmp_path / "tof.db3", turning(lambda _t: 0.0, 1.0), stereo=False)
    assert abs(np.median(depth_error_mm(open_realsense(file), 0, 0.0))) < 0.3


def test_steps_may_be_negative_and_what_comes_after_a_whole_turn_is_left_out(files: Path) -> None:
    assert open_realsense(files / "stops.db3", SourceOptions(step_deg=-10)).angles_deg == (0.0, -10.0, -20.0)
    read = open_realsense(files / "stops.db3", SourceOptions(step_deg=180))
    assert read.angles_deg == (0.0, 180.0)
    assert "1 that repeat an angle are left out" in read.description


def test_a_table_gives_the_angles_of_the_stops(files: Path, tmp_path: Path) -> None:
    table = tmp_path / "a.csv"
    table.write_text("time_s,angle_deg\n0.5,4\n2.3,13.5\n4.2,26\n")  # a line for each stop
    assert open_realsense(files / "stops.db3", SourceOptions(angles=table)).angles_deg == (0.0, 9.5, 22.0)
    angle = stop_and_go(STOPS, -15.0, 0.9, 0.8)
    table.write_text("".join(f"{t:.2f},{angle(t):.3f}\n" for t in np.arange(0, 4.6, 0.05)))  # an encoder's
    assert open_realsense(files / "stops.db3", SourceOptions(angles=table)).angles_deg == pytest.approx(
        (0.0, -15.0, -30.0), abs=0.05
    )


def test_an_item_that_turns_all_the_time_is_taken_at_each_step(files: Path, tmp_path: Path) -> None:
    table = tmp_path / "a.csv"
    table.write_text("0 0\n10 120\n")
    read = open_realsense(files / "turning.db3", SourceOptions(angles=table))
    assert len(read) == 5
    for n, angle in enumerate(read.angles_deg):
        assert angle == pytest.approx(10 * n, abs=0.45)  # the frame nearest to it, at 15 frames/s
        assert np.median(np.abs(depth_error_mm(read, n, angle))) < 1.5
    table.write_text("1.0 5\n5.0 53\n")  # by the camera's clock, which begins at 1 s
    again = open_realsense(files / "turning.db3", SourceOptions(angles=table))
    assert again.angles_deg == pytest.approx(read.angles_deg, abs=0.5)
    table.write_text("0 0\n10 -120\n")
    back = open_realsense(files / "turning.db3", SourceOptions(angles=table, step_deg=20))
    assert back.angles_deg == pytest.approx((0, -20, -40), abs=0.5)


def test_an_item_that_never_rests_needs_to_be_told_how_it_turned(files: Path) -> None:
    with pytest.raises(RecordingError, match=r"never stands still.*--angles"):
        open_realsense(files / "turning.db3")


def test_both_cameras_may_be_the_one_whose_pixels_are_kept(tmp_path: Path) -> None:
    """The color camera sits 15 mm to the right: 0.73 m away that is 8.7 px."""
    file = write_realsense(tmp_path / "a.db3", turning(lambda _t: 0.0, 1.0, seed=None), color_right_m=0.015)
    reference = Cylinder(angles_deg=(0.0,))[0]
    centers = {}
    for align in ("depth", "color"):
        frame = open_realsense(file, align=align)[0]
        cloth = np.flatnonzero(((frame.depth_m > 0) & (frame.depth_m < 1.0))[120])
        centers[align] = float(cloth.mean())
    cloth = np.flatnonzero(reference.mask[120])
    assert centers["depth"] == pytest.approx(float(cloth.mean()), abs=0.6)
    assert centers["depth"] - centers["color"] == pytest.approx(0.015 * 425 / 0.78, abs=1.5)


def test_color_that_comes_late_is_paired_with_its_own_depth(tmp_path: Path) -> None:
    """The syncer pairs each depth frame with the color before it as well."""
    shots = turning(lambda t: 20.0 * t, 1.5, seed=None)
    file = write_realsense(tmp_path / "late.db3", shots, color_late_s=0.02)
    pairs = list(RealsensePlayer(file).play())
    assert len(pairs) == len(shots)
    for pair in pairs:
        shown = shots[round(pair.time_s * 15)]
        np.testing.assert_array_equal(pair.depth_units, shown.depth_mm)
        # A few pixels at depth edges change in registering; of all frames this one is the nearest.
        apart = [float(np.mean(np.abs(pair.color.astype(int) - other.color))) for other in shots]
        assert int(np.argmin(apart)) == round(pair.time_s * 15)


class StandIn:
    """A pipeline that gives nothing for a while after six frames, and its playback; both tell their end."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, player: RealsensePlayer, **playback: Any) -> None:
        self.frames, self.waits, self.done = 6, 0, list[str]()
        self._opened, self._playback = player._open, playback
        monkeypatch.setattr(player, "_open", self._open)

    def _open(self, *, starting: bool) -> tuple[Any, Any, Any]:
        config, self._pipeline, real = self._opened(starting=starting)
        told = {name: getattr(real, name) for name in ("current_status", "get_position", "resume")}
        told["pause"] = lambda: (real.pause(), self.done.append("idle"))  # type: ignore[func-returns-value]
        return config, self, SimpleNamespace(**told | self._playback)

    def try_wait_for_frames(self, timeout_ms: int) -> tuple[bool, Any]:
        self.frames -= 1
        if self.frames >= 0 or self.waits <= 0:
            return self._pipeline.try_wait_for_frames(timeout_ms)
        self.waits -= 1
        return False, None

    def stop(self) -> None:
        self._pipeline.stop()
        self.done.append("stopped")


def test_frames_that_are_late_on_a_busy_machine_are_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    player = RealsensePlayer(write_realsense(tmp_path / "late.db3", turning(lambda _t: 0.0, 1.0)))
    stopped = player._library.playback_status.stopped
    starved = StandIn(monkeypatch, player, current_status=lambda: stopped, get_position=lambda: 0)
    starved.waits = 10
    assert len(list(player.play())) == 15
    assert starved.waits == 0


def test_a_film_that_is_left_early_is_stopped_before_its_device_goes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # librealsense's reader works on after the stop; freed meanwhile, it takes the process with it.
    player = RealsensePlayer(write_realsense(tmp_path / "left.db3", turning(lambda _t: 0.0, 1.0)))
    watched = StandIn(monkeypatch, player)
    playing = player.play()
    next(playing)
    cast("Generator[object, None, None]", playing).close()
    assert watched.done == ["stopped", "idle"]


def test_color_of_another_time_is_used_only_if_there_is_no_other(tmp_path: Path) -> None:
    shots = turning(lambda _t: 0.0, 0.4)
    shots = [Shot(s.time_s, s.color if n == 5 else None, s.depth_mm) for n, s in enumerate(shots)]
    file = write_realsense(tmp_path / "apart.db3", shots, color_late_s=0.1)
    read = open_realsense(file)
    assert len(read) == 1
    assert "not taken at the same time" in read.description


def test_a_few_frames_are_one_view(tmp_path: Path) -> None:
    read = open_realsense(write_realsense(tmp_path / "few.db3", turning(lambda _t: 0.0, 0.3)))
    assert read.angles_deg == (0.0,)
    assert "Only 4 frames" in read.description


def test_a_file_killed_while_it_was_recorded_keeps_what_was_written(tmp_path: Path) -> None:
    file = tmp_path / "killed.db3"
    script = (
        "import os, signal, sys\n"
        f"sys.path[:0] = [{str(Path(__file__).parents[1])!r}]\n"
        "from pathlib import Path\n"
        "from realsense_files import turning, write_realsense\n"
        "kill = lambda n: os.kill(os.getpid(), signal.SIGKILL) if n == 25 else None\n"
        f"write_realsense(Path({str(file)!r}), turning(lambda t: 0.0, 4.0), on_frame=kill)\n"
    )
    for attempt in range(4):  # killed while it writes a page of the database, nothing of it can be read
        file.unlink(missing_ok=True)
        killed = subprocess.run([sys.executable, "-c", script], check=False)
        assert killed.returncode == -signal.SIGKILL
        try:
            read = open_realsense(file)
            break
        except RecordingError:
            if attempt == 3:
                raise
    assert len(read) == 1
    assert np.median(np.abs(depth_error_mm(read, 0, 0.0))) < 0.5


def test_a_damage_in_the_middle_is_told(files: Path, tmp_path: Path) -> None:
    whole = RealsensePlayer(files / "stops.db3")
    count = len(list(whole.play()))
    assert not whole.is_short
    data = (files / "stops.db3").read_bytes()
    page = int.from_bytes(data[16:18], "big")
    damaged = tmp_path / "damaged.db3"
    for at in range(len(data) // 2 // page * page, len(data) * 3 // 4, page):
        damaged.write_bytes(data[:at] + os.urandom(page) + data[at + page :])
        try:
            player = RealsensePlayer(damaged)
        except RecordingError:
            continue  # that was a page of the index, without which nothing can be read
        found = len(list(player.play()))
        if found < count:
            break
    assert 0.3 * count < found < 0.9 * count
    # The tests' files are written about ten times as fast as a camera's.
    player.duration_s, player.read_s = 10 * player.duration_s, 10 * player.read_s
    assert player.is_short


def test_how_much_of_a_damaged_file_was_read_stands_in_its_notes(
    files: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(RealsensePlayer, "is_short", True)
    read = open_realsense(files / "stops.db3")
    # The position depends on how fast the file was written.
    assert re.match(r"Only \d+\.\d of \d+\.\d s could be read: the file is damaged there", read.notes[0])


def damaged_files(folder: Path, whole: bytes) -> dict[Path, str]:
    """Every kind of bad file, and what must be said of it."""
    database = folder / "database.db3"
    with sqlite3.connect(database) as base:
        base.execute("CREATE TABLE topics (id INTEGER, name TEXT)")
        base.execute("INSERT INTO topics VALUES (1, '/device_0/x')")
    base.close()
    contents = {
        "empty.db3": (b"", "empty"),
        "empty.bag": (b"", "empty"),
        "text.db3": (b"hello\n" * 500, "its content is not .db3 or .bag"),
        "random.bag": (os.urandom(5000), "its content is not .db3 or .bag"),
        "capital.DB3": (whole, "Rename it to capital.db3"),
        "named.bag": (whole, "its content is that of a .db3 file. Rename it to named.db3"),
        "truncated.db3": (whole[: len(whole) * 2 // 3], "truncated or damaged"),
        "index.db3": (whole[:4096] + os.urandom(8192) + whole[12288:], "truncated or damaged"),
        "cut.bag": (
            b"#ROSBAG V2.0\n" + b"\x45\x00\x00\x00/device_0/" + bytes(60),
            "incomplete|cannot be played",
        ),
    }
    for name, (content, _) in contents.items():
        (folder / name).write_bytes(content)
    (folder / "folder.db3").mkdir()
    return {
        **{folder / name: message for name, (_, message) in contents.items()},
        folder / "folder.db3": "a folder, not a file",
        folder / "none.db3": "No such file",
        database: "not a RealSense recording",
    }


def test_every_bad_file_is_one_line(files: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole = (files / "stops.db3").read_bytes()
    for path, message in damaged_files(tmp_path, whole).items():
        with pytest.raises(RecordingError, match=message) as caught:
            RealsensePlayer(path)
        assert str(caught.value).startswith(str(path))
        assert "\n" not in str(caught.value)
    path = tmp_path / "truncated.db3"
    assert main(["import", str(path), "--out", str(tmp_path / "out")]) == 2
    assert re.fullmatch(rf"flatcloth: {path}: truncated or damaged.*\n", capsys.readouterr().err)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("missing", ["depth", "color"])
def test_a_file_without_depth_or_color_is_refused(tmp_path: Path, missing: str) -> None:
    file = write_realsense(
        tmp_path / "half.db3",
        turning(lambda _t: 0.0, 0.5),
        with_depth=missing != "depth",
        with_color=missing != "color",
    )
    with pytest.raises(RecordingError, match=rf"half\.db3: has no {missing} stream"):
        RealsensePlayer(file)


def test_a_recording_of_nothing_is_refused(tmp_path: Path) -> None:
    shots = [
        Shot(n / 15, np.zeros((HEIGHT, WIDTH, 3), np.uint8), np.zeros((HEIGHT, WIDTH), np.uint16))
        for n in range(15)
    ]
    file = write_realsense(tmp_path / "dark.db3", shots)
    with pytest.raises(RecordingError, match="no depth was measured"):
        open_realsense(file)


def test_the_kind_of_a_file_is_told_by_its_content(files: Path, tmp_path: Path) -> None:
    assert is_realsense(files / "stops.db3")
    other = tmp_path / "ros.db3"
    with sqlite3.connect(other) as base:
        base.execute("CREATE TABLE topics (id INTEGER, name TEXT)")
        base.execute("INSERT INTO topics VALUES (1, '/camera/depth')")
    base.close()
    (tmp_path / "ros.bag").write_bytes(b"#ROSBAG V2.0\n topic=/camera/depth")
    for file in (other, tmp_path / "ros.bag", tmp_path / "none.db3", tmp_path):
        assert not is_realsense(file)


def test_a_missing_library_is_told_with_the_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("pyrealsense2", "libusb_package"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(RecordingError, match="pip install pyrealsense2"):
        realsense_library.load_realsense()


def test_import_writes_a_folder_that_opens_as_the_file_does(
    files: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["import", str(files / "stops.db3"), "--out", str(out), "--name", "Coat"]) == 0
    said = capsys.readouterr().out
    assert "3 stops were found" in said
    assert "3 views, 0 to 20 degrees, written to" in said
    folder, direct = open_recording(out), open_realsense(files / "stops.db3")
    assert (folder.name, folder.angles_deg) == ("Coat", (0.0, 10.0, 20.0))
    np.testing.assert_allclose(folder[1].depth_m, direct[1].depth_m, atol=6e-5)
    np.testing.assert_array_equal(folder[1].color, direct[1].color)
    assert folder[1].depth_m[0, 0] == pytest.approx(WALL_M, abs=0.01)
    assert main(["import", str(files / "stops.db3"), "--out", str(out)]) == 2
    assert "contains a recording" in capsys.readouterr().err
