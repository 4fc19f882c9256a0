"""The page of a camera, headless: which frames are flattened, and picks on them."""

import time
from concurrent.futures import ThreadPoolExecutor

import pytest
from viewer_fakes import CylinderCamera, CylinderIntegration

from flatcloth.core.errors import FlatteningError
from flatcloth.viewer.modes.capture import LiveFrames, Shown

# --- the frames -------------------------------------------------------------------------------------


@pytest.fixture
def camera() -> CylinderCamera:
    return CylinderCamera(CylinderIntegration())


@pytest.fixture
def frames(camera: CylinderCamera) -> LiveFrames:
    return LiveFrames(camera.newest)


def after(frames: LiveFrames, sequence: int) -> Shown:
    shown = frames.after(sequence)
    assert shown is not None
    return shown


def test_a_frame_is_flattened_when_somebody_wants_a_newer_one(
    frames: LiveFrames, camera: CylinderCamera
) -> None:
    assert camera.asked == 0
    first = after(frames, 0)
    assert first.picture is not None
    assert frames.after(0) is first  # another tab gets the same
    assert after(frames, first.sequence).sequence > first.sequence
    assert camera.asked == 2


def test_a_held_frame_stays_until_it_goes_on(frames: LiveFrames, camera: CylinderCamera) -> None:
    seen, later = after(frames, 0), after(frames, 1)
    held = frames.hold(seen.sequence)
    assert held.picture.view is seen.picture.view
    assert frames.after(later.sequence) is held  # who saw a later one gets it again
    assert frames.after(held.sequence) is None
    assert camera.asked == 2
    with ThreadPoolExecutor(1) as tab:
        waiting = tab.submit(after, frames, held.sequence)
        time.sleep(0.05)
        frames.play()
        assert waiting.result().sequence > held.sequence


def test_a_frame_without_cloth_is_empty_and_says_why_and_an_unexpected_error_also_pauses(
    frames: LiveFrames, camera: CylinderCamera
) -> None:
    no_item = FlatteningError("The camera sees no item to flatten.")
    for error, pauses in ((no_item, False), (ZeroDivisionError("division by zero"), True)):
        camera.errors[camera.asked] = error
        empty = after(frames, camera.asked)
        assert empty.picture is None
        assert str(error) in empty.reason
        assert frames.playing is not pauses
        frames.play()
        assert after(frames, empty.sequence).picture is not None
