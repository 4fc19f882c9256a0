"""The frames of a camera as tabs ask for them: each is flattened when somebody wants a newer one."""

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
LONGEST_WAIT_S = 2.0
"""Longest time that a tab waits for another frame than the held one; it then asks again. Chosen."""


@dataclass(frozen=True, kw_only=True)
class Shown:
    """A shown frame. ``picture`` is None if it could not be flattened; ``reason`` gives the cause.

    ``sequence`` changes with every new display, also when an older frame is shown again.
    """

    sequence: int
    picture: Picture | None
    reason: str = ""


class LiveFrames:
    """Shows a camera, or holds one of its frames; methods may be called from any thread.

    A tab asks for the next frame when it has got one, so slow tabs miss frames, and nothing is queued.

    Parameters
    ----------
    newest : callable
        Flattens the newest frame; called by one thread at a time.
    """

    def __init__(self, newest: Callable[[], LiveFrame]) -> None:
        self._newest = newest
        self._changed, self._flattening = threading.Condition(), threading.Lock()
        self._kept: deque[Shown] = deque(maxlen=FRAMES_KEPT)
        self._sequence = self._holds = 0
        self._stopped = False
        self.playing = True

    @property
    def shown(self) -> Shown | None:
        """The frame that was flattened last."""
        return self._kept[-1] if self._kept else None

    def stop(self) -> None:
        """Let nobody wait any more."""
        with self._changed:
            self._stopped = True
            self._changed.notify_all()

    def play(self) -> None:
        """Go on with the newest frame."""
        with self._changed:
            self.playing = True
            self._changed.notify_all()

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
                shown = self._keep(shown.picture, shown.reason)
            self._changed.notify_all()
            return shown

    def after(self, sequence: int) -> Shown | None:
        """Return a newer frame than one, flattened now if need be; None if one is held, or it takes long."""
        with self._changed:
            self._changed.wait_for(
                lambda: self._stopped or self.playing or self._newer(sequence), LONGEST_WAIT_S
            )
        with self._flattening:  # another tab may have waited for the same frame
            with self._changed:
                found, holds = self._newer(sequence), self._holds
                if found is not None or self._stopped or not self.playing:
                    return found
            picture, reason = self._flattened()
            with self._changed:
                if holds == self._holds:  # otherwise an earlier frame was picked in the meantime, and stays
                    self._keep(picture, reason)
                return self._newer(sequence)

    def _newer(self, sequence: int) -> Shown | None:
        return self.shown if self.shown is not None and self.shown.sequence > sequence else None

    def _flattened(self) -> tuple[Picture | None, str]:
        try:
            frame = self._newest()
        except FlatclothError as error:
            return None, str(error)
        except Exception as error:  # noqa: BLE001 - reported and logged
            _log.exception("showing the camera failed")
            self.playing = False
            return None, f"Unexpected error while showing the camera: {error!r}. See the terminal."
        picture = Picture(
            revision=0, view=frame.view, present_view=0, angle_deg=0.0, cloud=frame.cloud, legends={}
        )
        return picture, ""

    def _keep(self, picture: Picture | None, reason: str) -> Shown:
        self._sequence += 1
        if picture is not None:
            picture = replace(picture, revision=self._sequence)
        self._kept.append(Shown(sequence=self._sequence, picture=picture, reason=reason))
        return self._kept[-1]
