"""The guided capture, as a state machine and with a folder; no camera, no clock."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from realsense_files import Shot, shot
from scenes import CAMERA, Cylinder

from flatcloth.cameras import CameraFrame, capture
from flatcloth.cameras.capture import Capture, Phase
from flatcloth.cameras.guided_capture import GuidedCapture, writer_for
from flatcloth.core.errors import IllegalDecisionError, RecordingError
from flatcloth.core.types import Intrinsics
from flatcloth.recordings import open_recording
from flatcloth.recordings.writer import RecordingWriter

FPS = 10.0


def seen(state: Capture, speeds: Iterable[float | None]) -> Capture:
    for speed in speeds:
        state = capture.see(state, state.time_s + 1 / FPS, speed)
    return state


STILL, TURNED = [0.0] * 30, [40.0] * 5


def reviewed(state: Capture) -> Capture:
    """Let it hang still until a view is taken."""
    state = seen(state, STILL)
    assert state.phase is Phase.REVIEW
    return state


def test_a_turn_in_steps_is_led_from_the_first_view_to_the_last() -> None:
    state = capture.begin(90.0)
    told = []
    while state.phase is not Phase.DONE:
        if state.phase is Phase.TURN:
            told.append((state.turn_by_deg, state.target_deg))
            assert seen(state, STILL).phase is Phase.TURN  # nobody has turned it yet
            state = seen(state, TURNED)
        assert state.phase is Phase.SETTLE
        state = capture.keep(reviewed(state))
    assert state.kept_deg == (0.0, 90.0, 180.0, 270.0)
    assert told == [(90.0, 90.0), (90.0, 180.0), (90.0, 270.0)]


def test_frames_are_taken_only_after_it_has_hung_still_for_a_while() -> None:
    state = capture.begin(10.0)
    state = seen(state, [None, None, 30.0, 5.0, 0.0, 0.0, 0.0])
    assert state.phase is Phase.SETTLE
    assert state.still_s == pytest.approx(0.2)
    # At the end of a swing cloth stands still for a moment.
    state = seen(state, [5.0] + [0.0] * 7)
    assert (state.phase, state.taken) == (Phase.SETTLE, 0)
    state = seen(state, [0.0] * 5)
    assert state.phase is Phase.TAKE
    assert state.taken in (3, 4)


def test_who_turns_before_keeping_need_not_turn_again() -> None:
    state = seen(reviewed(capture.begin(10.0)), TURNED)
    state = capture.keep(state)
    assert (state.phase, state.target_deg) == (Phase.SETTLE, 10.0)


def test_swinging_during_a_view_is_no_turn_for_the_next_one() -> None:
    state = seen(capture.begin(10.0), TURNED)
    assert capture.keep(reviewed(state)).phase is Phase.TURN


def test_a_turn_that_was_not_seen_can_be_told() -> None:
    state = capture.keep(reviewed(capture.begin(10.0)))
    assert capture.turned(state).phase is Phase.SETTLE
    assert seen(state, [40.0]).phase is Phase.TURN  # one frame is no turn


def test_a_turntable_announces_the_angles() -> None:
    state = capture.announce(capture.begin(10.0), 0.0, keeps_itself=True)
    for angle in (0.0, 33.0, -20.0):
        if angle:
            state = capture.announce(state, angle, keeps_itself=True)
        assert (state.phase, state.target_deg, state.keeps_itself) == (Phase.SETTLE, angle, True)
        state = capture.keep(reviewed(seen(state, TURNED)))
        assert state.phase is Phase.TURN
        assert seen(state, [*TURNED, *STILL]).phase is Phase.TURN  # only an announcement counts now
    assert state.kept_deg == (0.0, 33.0, -20.0)
    assert capture.finish(state).phase is Phase.DONE


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (lambda s: capture.keep(s), "no view to keep"),
        (lambda s: capture.repeat(s), "no view to repeat"),
        (lambda s: capture.turned(s), "No turn is expected"),
        (lambda s: capture.aim(s, 360.2), "view at 360.2 degrees already"),
        (lambda s: capture.aim(s, float("nan")), "is not an angle"),
        (lambda s: capture.announce(s, 1e9, False), "is not an angle"),
        (lambda s: capture.announce(reviewed(s), 50.0, False), "awaits a decision: keep or repeat"),
        (lambda s: capture.aim(capture.finish(s), 50.0), "has ended"),
        (lambda s: capture.keep(capture.finish(reviewed(s))), "no view to keep"),
        (lambda s: capture.begin(0.0), "step of 0"),
        (lambda s: capture.begin(float("inf")), "step of inf"),
        (lambda s: capture.begin(10.0, frames=7), "7 frames"),
    ],
)
def test_what_makes_no_sense_is_refused(command: capture.Command, message: str) -> None:
    state = capture.turned(capture.keep(reviewed(capture.begin(10.0))))
    with pytest.raises(IllegalDecisionError, match=message):
        command(state)


@given(
    st.lists(
        st.sampled_from([None, 0.0, 1.0, 4.0, 40.0, "keep", "repeat", "turned", "announce"]), max_size=120
    )
)
def test_no_order_of_events_takes_moving_frames_or_repeats_an_angle(events: list[float | str | None]) -> None:
    state = capture.begin(45.0)
    moved_in_view = False
    for event in events * 3:
        before = state
        try:
            if event == "announce":
                state = capture.announce(state, 5.0 * len(state.kept_deg) + 3.0, keeps_itself=False)
            elif isinstance(event, str):
                state = getattr(capture, event)(state)
            else:
                state = capture.see(state, state.time_s + 1 / FPS, event)
        except IllegalDecisionError:
            assert state is before
            continue
        if state.taken > before.taken:
            moved_in_view |= event not in (0.0, 1.0)
        if state.taken == 0:
            moved_in_view = False
        assert not moved_in_view
        rounded = [round(a % 360, 3) for a in state.kept_deg]
        assert len(set(rounded)) == len(rounded)


class StillCamera:
    """Only what the guided capture asks of a camera; it is told when to filter."""

    name = "test camera"
    notes = ()
    intrinsics: Intrinsics = CAMERA
    depth_scale_m = 0.001
    fps = FPS

    def __init__(self) -> None:
        self.measured: list[bool] = []

    def read(self) -> CameraFrame:
        raise AssertionError("the guided capture is given its frames")

    def measure(self, on: bool) -> None:
        self.measured.append(on)

    def close(self) -> None:
        pass


class Rig:
    """A guided capture of the turned cylinder, frame by frame."""

    def __init__(self, folder: Path, resume: bool = False) -> None:
        self.camera, self.angle_deg, self.time_s = StillCamera(), 0.0, 0.0
        self.noise = np.random.default_rng(5)
        self.folder = folder
        self.guided = GuidedCapture(self.camera, lambda: self.writer(resume), 10.0)

    def writer(self, resume: bool) -> RecordingWriter:
        return writer_for(self.camera, str(self.folder), "coat", resume)

    def see(self, count: int, speed_deg_s: float = 0.0) -> None:
        for _ in range(count):
            self.time_s += 1 / FPS
            self.angle_deg += speed_deg_s / FPS
            s: Shot = shot(self.time_s, self.angle_deg, self.noise)
            assert s.color is not None
            assert s.depth_mm is not None
            self.guided.see(CameraFrame(time_s=s.time_s, color=s.color, depth_units=s.depth_mm))


def test_kept_views_are_on_disk_before_the_next(tmp_path: Path) -> None:
    rig = Rig(tmp_path / "out")
    for n in range(3):
        rig.see(30)
        assert rig.guided.state.phase is Phase.REVIEW
        taken = rig.guided.taken
        assert (taken.frames, taken.warnings) == (10, ())
        assert 0.5 < taken.noise_mm < 1.5  # the scene's noise is 1.1 mm
        rig.guided.keep()
        assert len(open_recording(rig.folder)) == n + 1  # while the capture goes on
        rig.see(10, speed_deg_s=10.0)
    rig.guided.close()
    read = open_recording(rig.folder)
    assert read.angles_deg == (0.0, 10.0, 20.0)
    for n in range(3):
        true, _ = Cylinder(angles_deg=(10.0 * n,)).surface(0)
        error = 1000 * (read[n].depth_m - true)[np.isfinite(true) & (read[n].depth_m < 1.2)]
        assert np.median(np.abs(error)) < 0.5
    # Filtered afresh for each view, and only while its frames are taken.
    assert rig.camera.measured == [True, False] * 3


def test_a_view_that_cannot_be_written_still_waits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(tmp_path)
    rig.see(30)

    def full(*_: object) -> int:
        raise RecordingError("no room")

    monkeypatch.setattr(RecordingWriter, "add", full)
    with pytest.raises(RecordingError, match="no room"):
        rig.guided.keep()
    assert rig.guided.state.phase is Phase.REVIEW
    monkeypatch.undo()
    rig.guided.keep()
    assert len(open_recording(tmp_path)) == 1


def test_a_repeated_view_has_its_own_frames_only(tmp_path: Path) -> None:
    rig = Rig(tmp_path)
    rig.see(30)
    rig.guided.do(capture.repeat)
    rig.see(10, speed_deg_s=20.0)  # it was not where it should be
    rig.see(30)
    taken = rig.guided.taken
    assert taken.frames == 10
    true, _ = Cylinder(angles_deg=(20.0,)).surface(0)
    cloth = np.isfinite(true) & (taken.depth_m < 1.2)
    expected = Cylinder(angles_deg=(20.0,))[0].color.astype(int)
    assert np.median(np.abs(taken.color.astype(int) - expected)[cloth]) < 3
