"""The thread that flattens the newest frame of a camera and delivers it to the tabs.

A frame is flattened only after a tab has taken the previous one, and a tab receives a frame only after it has
drawn its last one: slow tabs miss frames, and nothing is queued.
"""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

from flatcloth.core.errors import FlatclothError
from flatcloth.engine.live import LiveFrame
from flatcloth.viewer.protocol.picture import Picture

_log = logging.getLogger(__name__)

FRAMES_KEPT = 8
"""Number of past frames that a click may refer to."""


@dataclass(frozen=True, kw_only=True)
class Shown:
    """A shown frame. ``picture`` is None if it could not be flattened; ``reason`` gives the cause.

    ``sequence`` changes with every new display, also when an older frame is shown again.
    """

    sequence: int
    picture: Picture | None
    reason: str = ""


class LiveLoop:
    """Shows a camera; all public methods may be called from any thread.

    Parameters
    ----------
    newest : callable
        Flattens the newest frame; called on the loop's thread.
    deliver : callable
        ``deliver(shown, tabs)`` sends a frame to the tabs (number to layer) that are ready for it.
    report : callable
        Called with the text of an unexpected error; the loop then pauses.
    """

    def __init__(
        self,
        newest: Callable[[], LiveFrame],
        *,
        deliver: Callable[[Shown, dict[int, str]], None],
        report: Callable[[str], None],
    ) -> None:
        self._newest, self._deliver, self._report = newest, deliver, report
        self._changed = threading.Condition()
        self.playing = True
        self._waiting: dict[int, str] = {}
        self._taken: dict[int, tuple[int, str]] = {}
        self._kept: deque[Shown] = deque(maxlen=FRAMES_KEPT)
        self._sequence = 0
        self._holds = 0
        self._stopped = False
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

    def play(self) -> None:
        """Go on with the newest frame."""
        with self._changed:
            self.playing = True
            self._changed.notify()

    def hold(self, sequence: int | None = None) -> Shown | None:
        """Pause at a recently shown frame, or at the last one, and return it."""
        with self._changed:
            self.playing = False
            self._holds += 1
            kept = [s for s in self._kept if s.sequence == sequence] or list(self._kept)[-1:]
            if not kept:
                return None
            shown = kept[0]
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
                self._changed.wait_for(lambda: self._stopped or self._receivers() or self._is_wanted())
                if self._stopped:
                    return
                shown, receivers, holds = self.shown, self._receivers(), self._holds
                for client, layer in receivers.items():
                    assert shown is not None
                    self._taken[client] = (shown.sequence, layer)
                    del self._waiting[client]
            try:
                if shown is not None and receivers:
                    self._deliver(shown, receivers)
                else:
                    self._show(holds)
            except Exception as error:  # noqa: BLE001 - reported and logged
                self._fail(error)

    def _receivers(self) -> dict[int, str]:
        """Return the tabs that are ready for a newer frame, or for another layer."""
        if self.shown is None:
            return {}
        sequence = self.shown.sequence
        return {c: layer for c, layer in self._waiting.items() if self._taken.get(c) != (sequence, layer)}

    def _is_wanted(self) -> bool:
        """Whether to flatten the next frame: at most one while the tabs draw the last one."""
        if self.shown is None:
            return self.playing and bool(self._waiting)
        return self.playing and any(s == self.shown.sequence for s, _ in self._taken.values())

    def _show(self, holds: int) -> None:
        picture, reason = None, ""
        try:
            frame = self._newest()
        except FlatclothError as error:
            reason = str(error)
        else:
            picture = Picture(
                revision=0, view=frame.view, present_view=0, angle_deg=0.0,
                cloud=frame.cloud, legends={},
            )  # fmt: skip
        with self._changed:
            if holds == self._holds:  # otherwise an earlier frame was picked in the meantime, and stays
                self._keep(picture, reason)

    def _keep(self, picture: Picture | None, reason: str) -> None:
        self._sequence += 1
        if picture is not None:
            picture = replace(picture, revision=self._sequence)
        self._kept.append(Shown(sequence=self._sequence, picture=picture, reason=reason))

    def _fail(self, error: Exception) -> None:
        _log.error("showing the camera failed", exc_info=error)
        text = f"Unexpected error while showing the camera: {error!r}. See the terminal."
        with self._changed:
            self.playing = False
            self._keep(None, text)
        self._report(text)
