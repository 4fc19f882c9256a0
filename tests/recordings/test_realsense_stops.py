"""Where an item stood still, and what becomes of the frames of a stop: on arrays, without any file."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
from realsense_files import Shot, stop_and_go, turning

from flatcloth.core.errors import RecordingError
from flatcloth.recordings.film.angles import read_turning
from flatcloth.recordings.film.recording import average_color, average_depth
from flatcloth.recordings.film.stillness import STILL_PX_S, MotionMeter, Stop, find_stops, glance


def speeds(shots: Iterable[Shot]) -> list[float]:
    meter = MotionMeter()
    told = [meter.add(glance(s.time_s, s.color, s.depth_mm / 1000)) for s in shots]
    return [speed for speed in told if speed is not None]


def stops_of(shots: Iterable[Shot]) -> list[Stop]:
    return find_stops(glance(s.time_s, s.color, s.depth_mm / 1000) for s in shots)


@pytest.mark.parametrize("fps", [6.0, 30.0])
def test_the_stops_of_an_item_that_is_turned_are_found(fps: float) -> None:
    stops = stops_of(turning(stop_and_go(4, 10.0, 1.5, 1.0), 10.0, fps=fps))
    assert len(stops) == 4
    for n, stop in enumerate(stops):
        # The cloth swings after each turn: a stop begins when that is over.
        assert 2.5 * n <= stop.start_s + 0.3 <= 2.5 * n + 0.6
        assert stop.end_s <= 2.5 * n + 1.5 + 0.2 or n == 3


@pytest.mark.parametrize("speed_deg_s", [2.0, 200.0])
def test_a_turn_is_never_taken_for_rest(speed_deg_s: float) -> None:
    """Not a slow one, and not one so fast that the pictures have nothing in common."""
    shots = turning(lambda t: speed_deg_s * t, 2.0)
    assert min(speeds(shots)) > STILL_PX_S
    assert stops_of(shots) == []


def test_noise_is_rest() -> None:
    told = speeds(turning(lambda _t: 0.0, 2.0))
    assert max(told) < STILL_PX_S
    (stop,) = stops_of(turning(lambda _t: 0.0, 2.0))
    assert stop.end_s - stop.start_s > 1.8


def test_flickering_light_is_rest() -> None:
    flicker = [0.97, 1.0, 1.03]
    shots = [
        Shot(s.time_s, (s.color * flicker[n % 3] * 0.9).astype(np.uint8), s.depth_mm)
        for n, s in enumerate(turning(lambda _t: 0.0, 2.0))
    ]
    assert np.median(speeds(shots)) < STILL_PX_S


def test_what_moves_behind_the_item_does_not_matter() -> None:
    rng = np.random.default_rng(3)
    shots = []
    for n, s in enumerate(turning(lambda _t: 0.0, 2.0)):
        color = s.color.copy()
        passer = (
            (s.depth_mm > 1300) & (np.arange(240)[None, :] > 206) & (np.arange(240)[:, None] > 20 * n % 240)
        )
        color[passer] = rng.integers(0, 255)
        shots.append(Shot(s.time_s, color, s.depth_mm))
    assert max(speeds(shots)) < STILL_PX_S


def test_the_speed_is_in_pixels_a_second() -> None:
    def sliding(px_s: float) -> list[float]:
        rows, cols = np.mgrid[0:240, 0:240]
        shots = []
        for n in range(20):
            x = cols - px_s * n / 15
            grey = 128 + 50 * np.sin(x / 12) + 40 * np.cos(rows / 15)
            color = np.repeat(grey[..., None], 3, axis=2).astype(np.uint8)
            shots.append(Shot(n / 15, color, np.full((240, 240), 800, np.uint16)))
        return speeds(shots)

    assert np.median(sliding(8.0)) == pytest.approx(8.0, rel=0.35)
    assert np.median(sliding(16.0)) == pytest.approx(2 * np.median(sliding(8.0)), rel=0.25)


def test_a_bump_at_a_stop_does_not_make_two_stops_of_it() -> None:
    def bumped(t: float) -> float:
        turn = 10.0 if t > 5 else 0.0
        return turn + (3.0 * np.sin(12 * t) if 1.0 < t < 1.9 else 0.0)

    stops = stops_of(turning(bumped, 7.0))
    assert len(stops) == 2
    assert stops[0].start_s > 1.9  # of the two phases, the longer one


def test_a_pause_too_short_to_average_is_no_stop() -> None:
    assert len(stops_of(turning(stop_and_go(3, 10.0, 0.2, 0.8), 2.0))) == 0


def test_missing_frames_are_no_motion() -> None:
    shots = turning(lambda _t: 0.0, 1.2)
    later = [Shot(s.time_s + 30, s.color, s.depth_mm) for s in shots]
    assert max(speeds(shots + later)) < STILL_PX_S


def test_averaging_is_right_to_a_fraction_of_a_unit() -> None:
    rng = np.random.default_rng(0)
    true = 850.3
    frames = [np.round(rng.normal(true, 4.0, (60, 80))).astype(np.uint16) for _ in range(16)]
    assert abs(float(average_depth(frames).mean()) - true) < 0.1
    assert average_depth(frames).std() < 1.15  # 4 / sqrt(16), and what the robustness costs


def test_a_pixel_between_two_layers_stays_on_one() -> None:
    frames = [np.full((8, 8), v, np.uint16) for v in (800, 801, 799, 800, 830, 829, 800, 831)]
    np.testing.assert_allclose(average_depth(frames), 800.0)
    halves = [np.full((8, 8), v, np.uint16) for v in (800, 800, 900, 900)]
    np.testing.assert_allclose(average_depth(halves), 800.0)


def test_what_was_measured_in_few_frames_was_not_measured() -> None:
    frames = [np.full((8, 8), v, np.uint16) for v in (0, 0, 0, 0, 0, 800, 800, 800)]
    assert not average_depth(frames).any()
    frames[4] = np.full((8, 8), 801, np.uint16)
    np.testing.assert_allclose(average_depth(frames), 800.25)
    np.testing.assert_allclose(average_depth([np.full((8, 8), 7, np.uint16)]), 7.0)


def test_black_does_not_darken_the_average_color() -> None:
    frames = [np.full((4, 4, 3), v, np.uint8) for v in (100, 102, 0)]
    assert (average_color(frames) == 101).all()


@pytest.mark.parametrize(
    "text",
    [
        "time_s,angle_deg\n0,0\n2,20\n",
        "0 0\n2 20\n",
        "# turntable\n\n0;0\n2;20,0",
        "1000,0\n1002,20\n",
    ],
)
def test_a_table_of_times_and_angles_is_read(tmp_path: Path, text: str) -> None:
    file = tmp_path / "a.csv"
    file.write_text(text, encoding="utf-8")
    turning_ = read_turning(file, first_clock_s=1000.0, seconds=3.0)
    assert np.interp((0.0, 0.5, 2.0, 3.0), *turning_) == pytest.approx([0, 5, 20, 20])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "has no angles"),
        ("time,angle\n", "has no angles"),
        ("0,0\nx,1\n", "line 2 is x 1"),
        ("0,0,0\n1,1,1\n", "line 2"),
        ("0,0\n1\n", "line 2"),
        ("0,0\n0,1\n", "line 2 is not later"),
        ("0,0\n1,nan\n", "line 2 has a number out of range"),
        ("inf,0\n", "line 1 has a number out of range"),
        ("100,0\n102,20\n", "do not match the recording"),
    ],
)
def test_a_table_that_is_none_is_refused(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "a.csv"
    file.write_text(text)
    with pytest.raises(RecordingError, match=message):
        read_turning(file, first_clock_s=1000.0, seconds=3.0)
    with pytest.raises(RecordingError, match=r"none\.csv"):
        read_turning(tmp_path / "none.csv", 0.0, 3.0)
