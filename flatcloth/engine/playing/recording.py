"""Live mode of a recording: each frame is flattened from the result of the previous one."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

from flatcloth.core.config import FlatteningConfig
from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import FlattenedView, RgbdFrame
from flatcloth.engine.integration import Integration
from flatcloth.engine.views import ViewCloud
from flatcloth.flattening.flatten import Flattening, flatten
from flatcloth.flattening.surface import observe_item


@dataclass(frozen=True, kw_only=True)
class LiveFrame:
    """One frame: its flattened view (own plane, attributes in the object frame) and its cloud.

    ``flatten_ms`` is the time of surface and flattening, without reading.
    """

    view: FlattenedView
    cloud: ViewCloud
    flatten_ms: float


class LivePlayer:
    """Flattens views one after the other, each starting from the previous result; not thread-safe.

    Parameters
    ----------
    integration : Integration
        Recording and configuration. Only the finest sampling interval is used: the previous frame
        replaces the coarse level.
    """

    def __init__(self, integration: Integration) -> None:
        self._integration = integration
        config = integration.config.flattening
        self._config: FlatteningConfig = replace(
            config, sampling_intervals_px=config.sampling_intervals_px[-1:]
        )
        self._last: Flattening | None = None

    def show(self, view_index: int) -> LiveFrame:
        """Flatten a view, starting from the one shown before.

        Raises
        ------
        FlatclothError
            If the view shows too little cloth; the next view then starts from its pixels.
        """
        frame = self._integration.views.frame(view_index)
        view, took_ms = self.flattened(frame)
        return LiveFrame(view=view, cloud=self._integration.views.cloud(view_index), flatten_ms=took_ms)

    def flattened(self, frame: RgbdFrame) -> tuple[FlattenedView, float]:
        """Return the flattened view of a frame, and its computing time in milliseconds."""
        made = self._integration
        started = time.perf_counter()
        try:
            surface = observe_item(frame, made.axis, made.config.surface)
            self._last = flatten(
                surface, made.axis, self._config, previous=self._last,
                min_area_m2=made.config.surface.min_component_area_m2,
            )  # fmt: skip
        except FlatclothError:
            self._last = None
            raise
        return self._last.view, 1e3 * (time.perf_counter() - started)
