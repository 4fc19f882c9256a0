"""Cameras: a file in the place of one, the real one over a played file, and what they may show wrong."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from realsense_files import HEIGHT, WALL_M, WIDTH, turning, write_realsense
from scenes import CAMERA, Cylinder, frame

from flatcloth.cameras import CameraEndedError, CameraError, open_camera, playback, realsense
from flatcloth.cameras.checks import check_frame
from flatcloth.cameras.playback import PlaybackCamera
from flatcloth.cameras.realsense import RealsenseCamera
from flatcloth.core.types import Bool, RgbdFrame
from flatcloth.recordings.files.libraries import load_realsense
from flatcloth.recordings.realsense.player import stop_playing


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("camera")
    return write_realsense(folder / "still.db3", turning(lambda _t: 0.0, 1.0))


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Seconds whose sum is the time that a played camera sees: a busy computer does not make it later."""
    passed_s = [100.0]
    time = SimpleNamespace(monotonic=lambda: sum(passed_s), sleep=passed_s.append)
    monkeypatch.setattr(playback, "time", time)
    return passed_s


def test_a_file_plays_in_the_place_of_a_camera(file: Path, clock: list[float]) -> None:
    camera = open_camera(str(file))
    assert isinstance(camera, PlaybackCamera)
    assert (camera.name, camera.intrinsics, camera.fps) == ("still.db3", CAMERA, 15.0)
    assert "in place of a camera" in camera.notes[0]
    frames = [camera.read() for _ in range(8)]
    assert sum(clock) == pytest.approx(100.0 + 7 / 15, abs=0.01)  # at its own pace: 7 periods of 1/15 s
    assert [f.time_s for f in frames] == sorted({f.time_s for f in frames})
    view = frames[0].rgbd(camera)
    assert view.depth_m[0, 0] == pytest.approx(WALL_M, abs=0.02)
    camera.close()
    with pytest.raises(CameraEndedError):
        camera.read()


def test_a_frame_is_filtered_while_it_is_measured(file: Path) -> None:
    true, _ = Cylinder(angles_deg=(0.0,)).surface(0)
    inner = np.isfinite(true) & (np.abs(np.arange(WIDTH) - 120) < 40)[None, :]
    noise = {}
    for on in (False, True):
        camera = PlaybackCamera(file, real_time=False)
        camera.read()
        camera.measure(on)
        for _ in range(4):
            seen = camera.read()
        values = seen.depth_units[inner & (seen.depth_units < 1200)]
        noise[on] = float(np.std(values - 1000 * true[inner & (seen.depth_units < 1200)]))
        camera.close()
    assert noise[True] < 0.8 * noise[False]


def test_a_slow_reader_misses_frames_instead_of_lagging_behind(file: Path, clock: list[float]) -> None:
    camera = PlaybackCamera(file)
    first = camera.read()
    clock.append(0.4)
    assert camera.read().time_s - first.time_s > 0.3
    camera.close()


class FakeDevice:
    def __init__(self, serial: str, usb: str) -> None:
        self._about = {"serial_number": serial, "name": "Intel RealSense D435", "usb_type_descriptor": usb}

    def supports(self, field: Any) -> bool:
        return str(field).rpartition(".")[2] in self._about

    def get_info(self, field: Any) -> str:
        return self._about[str(field).rpartition(".")[2]]


def library_with(monkeypatch: pytest.MonkeyPatch, devices: list[FakeDevice], file: Path | None) -> None:
    """The real library, but for which cameras are connected, and that a file plays for them."""
    real = load_realsense()

    class Config(real.config):  # type: ignore[misc, name-defined]
        def enable_device(self, _serial: str) -> None:
            real.config.enable_device_from_file(self, str(file), repeat_playback=False)

        def enable_stream(self, *_mode: object) -> None:
            pass  # a file plays in its own mode only

    class Pipeline(real.pipeline):  # type: ignore[misc, name-defined]
        def stop(self) -> None:
            playback = self.get_active_profile().get_device().as_playback()
            stop_playing(super(), playback)

    fake = SimpleNamespace(**{name: getattr(real, name) for name in dir(real) if not name.startswith("__")})
    fake.context = lambda: SimpleNamespace(devices=devices)
    fake.config, fake.pipeline = Config, Pipeline
    monkeypatch.setattr(realsense, "load_realsense", lambda: fake)


def all_of(camera: RealsenseCamera) -> None:
    while True:
        camera.read()


def test_without_a_camera_it_is_said_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    library_with(monkeypatch, [], None)  # starting one fails here otherwise than librealsense does after 15 s
    with pytest.raises(CameraError, match=r"No RealSense camera is connected.*--camera FILE\.db3"):
        open_camera()
    library_with(monkeypatch, [FakeDevice("1", "3.2"), FakeDevice("2", "3.2")], None)
    with pytest.raises(CameraError, match="No camera 9 is connected, but 1, 2"):
        open_camera("9")
    with pytest.raises(CameraError, match=r"2 cameras are connected: 1, 2\. Name one"):
        open_camera()


@pytest.mark.parametrize(("usb", "noted"), [("3.2", False), ("2.1", True)])
def test_a_camera_gives_registered_frames(
    file: Path, monkeypatch: pytest.MonkeyPatch, usb: str, noted: bool
) -> None:
    library_with(monkeypatch, [FakeDevice("1", "3.2"), FakeDevice("728612070259", usb)], file)
    monkeypatch.setattr(realsense, "_SILENCE_S", 0.5)
    camera = RealsenseCamera("728612070259")
    assert camera.name == "Intel RealSense D435 728612070259"
    assert camera.intrinsics == CAMERA
    assert [("USB 2.1" in note) for note in camera.notes] == [True] * noted
    camera.measure(True)
    seen = camera.read()
    assert seen.color.shape == (HEIGHT, WIDTH, 3)
    assert seen.depth_units.dtype == np.uint16
    with pytest.raises(CameraError, match=r"728612070259: delivers no images any more\. Check its cable"):
        all_of(camera)
    camera.close()
    camera.close()


def test_a_camera_that_another_program_uses_is_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    broken = tmp_path / "broken.db3"
    broken.write_bytes(b"x" * 1000)
    library_with(monkeypatch, [FakeDevice("1", "3.2")], broken)
    with pytest.raises(CameraError, match=r"D435 1: cannot be started .*Close other programs"):
        RealsenseCamera()


def board(half_px: tuple[int, int], depth_m: float, center: tuple[int, int] = (120, 120)) -> RgbdFrame:
    """A flat board before a far wall; half its width and height in pixels."""
    rows, cols = np.mgrid[0:HEIGHT, 0:WIDTH]
    on: Bool = (abs(cols - center[0]) <= half_px[0]) & (abs(rows - center[1]) <= half_px[1])
    return frame(np.where(on, depth_m, 3.0), None)


@pytest.mark.parametrize(
    ("seen", "warnings"),
    [
        (board((50, 70), 0.8), ()),
        (board((50, 140), 0.8, (120, 0)), ()),  # what holds it comes from above
        (board((100, 100), 0.32), ("Too near: 0.32 m",)),
        (board((90, 90), 1.5), ("Too far: 1.50 m",)),
        (board((140, 70), 0.8), ("The garment is cut by the left and right borders",)),
        (board((50, 140), 0.8), ("The garment is cut by the lower border",)),
        (board((50, 70), 0.8, (220, 120)), ("The garment is cut by the right border",)),
        (frame(np.zeros((HEIGHT, WIDTH)), None), ("No depth is measured",)),
    ],
)
def test_what_is_wrong_with_a_view_is_said(seen: RgbdFrame, warnings: tuple[str, ...]) -> None:
    checked = check_frame(seen)
    assert len(checked.warnings) == len(warnings)
    for said, expected in zip(checked.warnings, warnings, strict=True):
        assert said.startswith(expected)
    assert checked.item.any() == (not warnings or "No depth" not in warnings[0])
