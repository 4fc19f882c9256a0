"""Guided capture as a state machine: turn, wait until the item is still, take frames, keep or repeat.

It is pure: each frame enters as its time and the speed of the item, and the actions of the operator
or of a turntable enter as commands. The owner of the camera and the folder acts on the state.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum

from flatcloth.core.errors import IllegalDecisionError
from flatcloth.recordings.base import SAME_VIEW_DEG, apart_deg
from flatcloth.recordings.film.stillness import STILL_PX_S

FRAMES = 10
"""Frames averaged for a view; fewer than 8 leave noise in the depth that averaging would remove. Set by
hand."""
LEAST_FRAMES = 8
"""Frames of a view at least: fewer do not average the noise. Chosen."""
HOLD_S = 0.7
"""How long the item must be still before frames are taken: cloth pauses at the end of a swing. Set by
hand."""
MOVING_PX_S = 3.0 * STILL_PX_S
"""Above this speed the item is being turned, or swings. Set by hand."""
TURN_S = 0.2
"""An item that moves for this long is being turned. Chosen: longer than a shake."""


class Phase(Enum):
    """The phases of the capture of one view."""

    TURN = "turn"
    """The item must be turned to the target angle."""
    SETTLE = "settle"
    """The item is at the target angle and must come to rest."""
    TAKE = "take"
    """Frames are being taken."""
    REVIEW = "review"
    """The view has been taken: keep or repeat it."""
    DONE = "done"


@dataclass(frozen=True, kw_only=True)
class Capture:
    """The state of the capture.

    ``kept_deg`` are the angles of the views on disk, ``target_deg`` is that of the current view,
    ``taken`` the number of its frames so far. ``announced``: angles come from a turntable, so that
    no motion is awaited. ``still_since_s`` and ``moving_since_s`` are times of frames, ``time_s`` is
    that of the last frame.
    """

    step_deg: float
    frames: int = FRAMES
    phase: Phase = Phase.SETTLE
    kept_deg: tuple[float, ...] = ()
    target_deg: float = 0.0
    taken: int = 0
    moved: bool = False
    announced: bool = False
    keeps_itself: bool = False
    speed_px_s: float | None = None
    time_s: float = 0.0
    still_since_s: float | None = None
    moving_since_s: float | None = None

    @property
    def still_s(self) -> float:
        """For how long the item has been still."""
        return 0.0 if self.still_since_s is None else self.time_s - self.still_since_s

    @property
    def turn_by_deg(self) -> float:
        """Rotation from the last view to the target."""
        return self.target_deg - (self.kept_deg[-1] if self.kept_deg else 0.0)

    @property
    def is_full(self) -> bool:
        """Whether the turn is complete, i.e. the next step would repeat an angle."""
        return bool(self.kept_deg) and _is_taken(self, self.kept_deg[-1] + self.step_deg)


def begin(step_deg: float, frames: int = FRAMES, kept_deg: tuple[float, ...] = ()) -> Capture:
    """Return the initial state; if there are views on disk, it begins with the next turn.

    Raises
    ------
    IllegalDecisionError
        If the step or the number of frames is out of range.
    """
    if not math.isfinite(step_deg) or not 1 <= abs(step_deg) <= 180:
        raise IllegalDecisionError(
            f"A step of {step_deg:g} degrees is out of range: give 1 to 180, or negative."
        )
    if not LEAST_FRAMES <= frames <= 100:
        raise IllegalDecisionError(f"{frames} frames per view is out of range: give {LEAST_FRAMES} to 100.")
    state = Capture(step_deg=step_deg, frames=frames, kept_deg=kept_deg)
    return _next(state) if kept_deg else state


def see(state: Capture, time_s: float, speed_px_s: float | None) -> Capture:
    """Process a frame: its time, and the speed of the item (None if not known yet).

    If the phase is ``TAKE`` before and after, the frame belongs to the view.
    """
    still = speed_px_s is not None and speed_px_s < STILL_PX_S
    moving = speed_px_s is not None and speed_px_s > MOVING_PX_S
    state = replace(
        state,
        time_s=time_s,
        speed_px_s=speed_px_s,
        still_since_s=(time_s if state.still_since_s is None else state.still_since_s) if still else None,
        moving_since_s=(time_s if state.moving_since_s is None else state.moving_since_s) if moving else None,
    )
    if state.moving_since_s is not None and time_s - state.moving_since_s >= TURN_S:
        state = replace(state, moved=True)
    match state.phase:
        case Phase.TURN if state.moved and not state.announced:
            return replace(state, phase=Phase.SETTLE)
        case Phase.SETTLE if state.still_s >= HOLD_S:
            return replace(state, phase=Phase.TAKE, taken=0)
        case Phase.TAKE if not still:
            return replace(state, phase=Phase.SETTLE, taken=0)
        case Phase.TAKE:
            taken = state.taken + 1
            phase = Phase.REVIEW if taken >= state.frames else Phase.TAKE
            return replace(state, phase=phase, taken=taken, moved=False)
    return state


def keep(state: Capture) -> Capture:
    """Keep the view that was taken; the next turn follows, unless the turn is complete.

    If the item was turned during the review, that turn counts.

    Raises
    ------
    IllegalDecisionError
        If there is no view to keep.
    """
    if state.phase is not Phase.REVIEW:
        raise IllegalDecisionError("There is no view to keep yet; wait until its frames are taken.")
    moved = state.moved
    state = replace(state, kept_deg=(*state.kept_deg, state.target_deg))
    if state.is_full and not state.announced:
        return replace(state, phase=Phase.DONE, taken=0)
    state = _next(state)
    return replace(state, phase=Phase.SETTLE) if moved and not state.announced else state


def repeat(state: Capture) -> Capture:
    """Take the view again.

    Raises
    ------
    IllegalDecisionError
        If there is no view to repeat.
    """
    if state.phase not in (Phase.REVIEW, Phase.TAKE):
        raise IllegalDecisionError("There is no view to repeat yet.")
    return replace(state, phase=Phase.SETTLE, taken=0, moved=False, still_since_s=None)


def turned(state: Capture) -> Capture:
    """Confirm that the item is at the target angle, although no motion was detected.

    Raises
    ------
    IllegalDecisionError
        If no turn is awaited.
    """
    if state.phase is not Phase.TURN:
        raise IllegalDecisionError("No turn is expected now.")
    return replace(state, phase=Phase.SETTLE)


def aim(state: Capture, angle_deg: float) -> Capture:
    """Correct the angle of the current view, because the item was turned to another angle.

    Raises
    ------
    IllegalDecisionError
        If there is a view at that angle, or it is not a valid angle.
    """
    _check_angle(state, angle_deg)
    return replace(state, target_deg=angle_deg)


def announce(state: Capture, angle_deg: float, keeps_itself: bool) -> Capture:
    """Report the item's angle from a turntable.

    Parameters
    ----------
    state : Capture
        The current state.
    angle_deg : float
        Since view 0, right-handed about the upward axis.
    keeps_itself : bool
        Keep the view without the operator as soon as it is taken.

    Raises
    ------
    IllegalDecisionError
        If a view awaits a decision, there is a view at that angle, or the capture has ended.
    """
    if state.phase is Phase.REVIEW:
        raise IllegalDecisionError(
            f"The view at {state.target_deg:g} degrees awaits a decision: keep or repeat it first."
        )
    _check_angle(state, angle_deg)
    state = replace(state, announced=True)
    return _towards(state, Phase.SETTLE, angle_deg, keeps_itself)


def finish(state: Capture) -> Capture:
    """End the capture; a view that has not been kept is dropped."""
    return replace(state, phase=Phase.DONE, taken=0)


Command = Callable[[Capture], Capture]


def _next(state: Capture) -> Capture:
    return _towards(state, Phase.TURN, state.kept_deg[-1] + state.step_deg)


def _towards(state: Capture, phase: Phase, target_deg: float, keeps_itself: bool = False) -> Capture:
    """Return the state in which the view at an angle has not begun yet."""
    return replace(
        state,
        phase=phase,
        target_deg=target_deg,
        taken=0,
        moved=False,
        keeps_itself=keeps_itself,
        still_since_s=None,
    )


def _check_angle(state: Capture, angle_deg: float) -> None:
    if state.phase is Phase.DONE:
        raise IllegalDecisionError("The capture has ended; start a new one.")
    if not math.isfinite(angle_deg) or abs(angle_deg) > 3600:
        raise IllegalDecisionError(f"{angle_deg} is not an angle; give degrees since view 0.")
    if _is_taken(state, angle_deg):
        raise IllegalDecisionError(f"There is a view at {angle_deg:g} degrees already, modulo a full turn.")


def _is_taken(state: Capture, angle_deg: float) -> bool:
    return any(apart_deg(angle_deg, kept) < SAME_VIEW_DEG for kept in state.kept_deg)
