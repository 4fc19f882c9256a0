"""The thread that plays a recording: the clock, the flattening, and the delivery to the tabs.

A frame is flattened only after a tab has taken the previous one, and a tab receives a frame only after it has
drawn its last one: slow tabs miss frames, and nothing is queued.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol

from flatcloth.core.errors import FlatclothError
from flatcloth.engine.playing.recording import LiveFrame
from flatcloth.viewer.protocol.picture import Picture
from flatcloth.viewer.worker import Worker

_log = logging.getLogger(__name__)

FRAMES_KEPT = 8
"""Number of past frames that a click may refer to."""


RATE_WINDOW_S = 1.0
"""Time over which the rate is measured. Chosen."""


@dataclass(frozen=True, kw_only=True)
class Playhead:
    """A position in the round trip ``0 .. n-1 .. 0`` over the frames of a recording.

    ``phase`` counts the positions of the round trip: the first ``n_frames`` are the way forward, the
    rest the way back without its ends, so that no frame is shown twice in succession.
    """

    n_frames: int
    fps: float
    phase: int = 0
    playing: bool = True

    @property
    def frame(self) -> int:
        """The frame at the position."""
        return self.phase if self.phase < self.n_frames else self._period - self.phase

    @property
    def forward(self) -> bool:
        """Whether the next frame is a later one."""
        return self.n_frames == 1 or self.phase < self.n_frames - 1

    @property
    def _period(self) -> int:
        return max(1, 2 * (self.n_frames - 1))

    def advanced(self, ticks: int = 1) -> Playhead:
        """Return the position some ticks later."""
        return replace(self, phase=(self.phase + ticks) % self._period)

    def at(self, frame: int) -> Playhead:
        """Return the position of the nearest existing frame, in the same direction if possible."""
        frame = min(max(frame, 0), self.n_frames - 1)
        phase = frame if self.forward else (self._period - frame) % self._period
        return replace(self, phase=phase)

    def turned(self, forward: bool) -> Playhead:
        """Return the same frame in the given direction; at either end there is only one direction."""
        if forward == self.forward:
            return self
        return replace(self, phase=(self._period - self.phase) % self._period)


def ticks_due(now_s: float, due_s: float, fps: float) -> int:
    """Return the number of ticks since the next one was due; 0 if it is not due yet."""
    return 0 if now_s < due_s else 1 + math.floor((now_s - due_s) * fps)


class RateMeter:
    """Counts the events of the last second."""

    def __init__(self) -> None:
        self._at_s: deque[float] = deque()

    def count(self, now_s: float) -> float:
        """Count an event, and return the rate (1/s) of the last second."""
        self._at_s.append(now_s)
        while now_s - self._at_s[0] > RATE_WINDOW_S:
            self._at_s.popleft()
        span_s = now_s - self._at_s[0]
        return (len(self._at_s) - 1) / span_s if span_s > 0 else 0.0


class Player(Protocol):
    """Flattens the frames; see :class:`~flatcloth.engine.playing.recording.LivePlayer`. Loop thread only."""

    def show(self, view_index: int) -> LiveFrame:
        """Flatten a view, starting from the last one."""


@dataclass(frozen=True, kw_only=True)
class Shown:
    """A shown frame. ``picture`` is None if it could not be flattened; ``reason`` gives the cause.

    ``sequence`` changes with every new display, also when an older frame is shown again.
    """

    sequence: int
    frame: int
    angle_deg: float
    picture: Picture | None
    reason: str = ""
    flatten_ms: float | None = None


class LiveLoop:
    """Plays a recording; all public methods may be called from any thread.

    Parameters
    ----------
    player : Player
        Flattens a frame.
    angles_deg : tuple of float
        Angles of all frames.
    fps : float
        Initial rate.
    prepare : callable
        Called with the next frame's number on a second thread, to read it ahead.
    deliver : callable
        ``deliver(shown, tabs)`` sends a frame to the tabs (number to layer) that are ready for it;
        called on another thread.
    report : callable
        Called with the text of an unexpected error; the loop then pauses.
    """

    def __init__(
        self,
        player: Player,
        angles_deg: tuple[float, ...],
        fps: float,
        *,
        prepare: Callable[[int], object],
        deliver: Callable[[Shown, dict[int, str]], None],
        report: Callable[[str], None],
    ) -> None:
        self._player = player
        self._angles_deg = angles_deg
        self._prepare, self._deliver, self._report = prepare, deliver, report
        self._changed = threading.Condition()
        # The present position; the shown frame may be one behind.
        self.head = Playhead(n_frames=len(angles_deg), fps=fps)
        self._wanted = True
        self._due_s = 0.0
        self._waiting: dict[int, str] = {}
        self._taken: dict[int, tuple[int, str]] = {}
        self._kept: deque[Shown] = deque(maxlen=FRAMES_KEPT)
        self._sequence = 0
        self._holds = 0
        self._stopped = False
        self._ahead = Worker("flatcloth-read")
        self._out = Worker("flatcloth-show")
        self._thread = threading.Thread(target=self._run, name="flatcloth-live", daemon=True)

    @property
    def shown(self) -> Shown | None:
        """The frame that was flattened last."""
        return self._kept[-1] if self._kept else None

    def start(self) -> None:
        """Begin to play."""
        self._thread.start()

    def stop(self, timeout_s: float) -> None:
        """Stop after the frame that is being flattened."""
        with self._changed:
            self._stopped = True
            self._changed.notify()
        if self._thread.is_alive():
            self._thread.join(timeout_s)
        self._ahead.stop(timeout_s)
        self._out.stop(timeout_s)

    def change(self, edit: Callable[[Playhead], Playhead]) -> None:
        """Change the position or the playing; another frame is shown immediately."""
        with self._changed:
            before, self.head = self.head, edit(self.head)
            if self.head.frame != before.frame:
                self._wanted = True
            if not before.playing:
                self._due_s = time.monotonic() + 1.0 / self.head.fps
            self._changed.notify()

    def again(self) -> None:
        """Flatten the present frame again, because its mask has changed."""
        with self._changed:
            self._wanted = True
            self._changed.notify()

    def hold(self, sequence: int | None) -> Shown | None:
        """Pause at a recently shown frame, or at the last one, and return it."""
        with self._changed:
            kept = [s for s in self._kept if s.sequence == sequence] or list(self._kept)[-1:]
            if not kept:
                return None
            shown = kept[0]
            self.head = replace(self.head.at(shown.frame), playing=False)
            self._wanted = False
            self._holds += 1
            if shown is not self._kept[-1]:
                self._sequence += 1
                shown = replace(shown, sequence=self._sequence)
                self._kept.append(shown)
            self._changed.notify()
            return shown

    def ready(self, client: int, layer: str) -> None:
        """Note that a tab has drawn its last frame, and the layer it wants next."""
        with self._changed:
            self._waiting[client] = layer
            self._changed.notify()

    def leave(self, client: int) -> None:
        """Remove a tab."""
        with self._changed:
            self._waiting.pop(client, None)
            self._taken.pop(client, None)

    # --- the loop's thread -------------------------------------------------------------------

    def _run(self) -> None:
        while True:
            with self._changed:
                while not (self._stopped or self._receivers() or self._is_due()):
                    self._changed.wait(self._pause_s())
                if self._stopped:
                    return
                shown, receivers = self.shown, self._receivers()
                for client, layer in receivers.items():
                    assert shown is not None
                    self._taken[client] = (shown.sequence, layer)
                    del self._waiting[client]
                frame = None if receivers else self._next_frame()
            try:
                if frame is not None:
                    self._show(frame)
            except Exception as error:  # noqa: BLE001 - reported and logged
                self._fail(error)
            if shown is not None and receivers:
                # In parallel with the next flattening; at most one frame per tab waits for its tab.
                self._out.put(partial(self._put_before, shown, receivers))

    def _put_before(self, shown: Shown, tabs: dict[int, str]) -> None:
        try:
            self._deliver(shown, tabs)
        except Exception as error:  # noqa: BLE001 - reported and logged
            self._fail(error)

    def _receivers(self) -> dict[int, str]:
        """Return the tabs that are ready for a newer frame."""
        if self.shown is None:
            return {}
        sequence = self.shown.sequence
        return {c: layer for c, layer in self._waiting.items() if self._taken.get(c) != (sequence, layer)}

    def _is_due(self) -> bool:
        if not self._is_watched():
            return False
        return self._wanted or (self.head.playing and time.monotonic() >= self._due_s)

    def _is_watched(self) -> bool:
        # At most one frame is flattened while the tabs draw the last one.
        if self.shown is None:
            return bool(self._waiting)
        return any(sequence == self.shown.sequence for sequence, _ in self._taken.values())

    def _pause_s(self) -> float | None:
        if not self._is_watched() or not self.head.playing:
            return None
        return max(0.0, self._due_s - time.monotonic())

    def _next_frame(self) -> int:
        now_s, period_s = time.monotonic(), 1.0 / self.head.fps
        if self._wanted:
            self._wanted = False
            self._due_s = now_s + period_s
        else:
            ticks = ticks_due(now_s, self._due_s, self.head.fps)
            self.head = self.head.advanced(ticks)
            self._due_s = max(self._due_s + ticks * period_s, now_s)
        return self.head.frame

    def _show(self, frame: int) -> None:
        head, holds = self.head, self._holds
        if head.playing:
            self._ahead.put(lambda: self._read_ahead(head.advanced().frame))
        picture, reason, flatten_ms = None, "", None
        angle_deg = self._angles_deg[frame]
        try:
            live = self._player.show(frame)
        except FlatclothError as error:
            reason = str(error)
        else:
            flatten_ms = live.flatten_ms
            picture = Picture(
                revision=0, view=live.view, present_view=frame, angle_deg=angle_deg,
                cloud=live.cloud, energies=(), legends={},
            )  # fmt: skip
        if holds == self._holds:  # otherwise an earlier frame was picked in the meantime, and stays
            self._keep(frame, picture, reason, flatten_ms)

    def _keep(self, frame: int, picture: Picture | None, reason: str, flatten_ms: float | None) -> None:
        with self._changed:
            self._sequence += 1
            if picture is not None:
                picture = replace(picture, revision=self._sequence)
            self._kept.append(
                Shown(
                    sequence=self._sequence,
                    frame=frame,
                    angle_deg=self._angles_deg[frame],
                    picture=picture,
                    reason=reason,
                    flatten_ms=flatten_ms,
                )
            )

    def _fail(self, error: Exception) -> None:
        _log.error("playing failed", exc_info=error)
        with self._changed:
            self.head = replace(self.head, playing=False)
        text = f"Unexpected error while playing: {error!r}. See the terminal."
        self._keep(self.head.frame, None, text, None)
        self._report(text)

    def _read_ahead(self, frame: int) -> None:
        try:
            self._prepare(frame)
        except Exception:  # noqa: BLE001 - the loop gets the same error, and reports it
            _log.debug("frame %d could not be read ahead", frame, exc_info=True)
