"""A camera in place of a recording: its newest frame is flattened, starting from the one before."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from flatcloth.cameras.base import CameraError
from flatcloth.cameras.checks import check_frame
from flatcloth.cameras.feed import CameraFeed
from flatcloth.core.config import FlatteningConfig
from flatcloth.core.errors import FlatclothError, SegmentationError, SurfaceError
from flatcloth.core.geometry import back_project
from flatcloth.core.types import Bool, FlattenedView, Float32, RgbdFrame, RotationAxis, Uint8
from flatcloth.engine.integration import Integration
from flatcloth.flattening.flatten import Flattening, flatten
from flatcloth.flattening.surface import observe_item
from flatcloth.recordings.base import Recording, ViewImages, images_of
from flatcloth.segmentation.item import find_item

NOTHING_YET_S = 2.0
"""A camera that delivers no new frame for this long is reported. Set by hand."""
MOST_POINTS = 25_000
"""Most points of a live cloud; browsers cannot receive more at 30 frames per second. Set by hand."""
BEHIND_M = 0.7
"""Points farther than this behind the nearest one are not drawn. Set by hand."""
HOLDER_INTERVAL_S = 1.0
"""Interval of finding the gripper, which takes the time of two frames. Chosen."""
HOLDER_M = 0.02
"""Pixels this near to the last place of the gripper belong to it. Chosen: it moves little in a second."""


class LiveFlattening:
    """Flattens the newest frame of a camera, without the gripper; not thread-safe.

    Parameters
    ----------
    integration : Integration
        The integration of a :func:`camera_recording`. Only the finest sampling interval is used: the
        previous frame replaces the coarse level.
    feed : CameraFeed
        Source of the frames.
    """

    def __init__(self, integration: Integration, feed: CameraFeed) -> None:
        self._integration = integration
        self._feed = feed
        config = integration.config.flattening
        self._config: FlatteningConfig = replace(
            config, sampling_intervals_px=config.sampling_intervals_px[-1:]
        )
        self._last: Flattening | None = None
        self._shown_s: float | None = None
        self._holder_m: Float32 | None = None
        self._looked_s = -HOLDER_INTERVAL_S

    def newest(self) -> FlattenedView:
        """Wait for a new frame and flatten it, starting from the one before.

        Raises
        ------
        FlatclothError
            If no frame arrives, or it shows too little cloth; the next one then starts from its pixels.
        """
        seen = self._feed.newest(self._shown_s, NOTHING_YET_S)
        if seen is None:
            raise CameraError(f"{self._feed.camera.name}: no image for {NOTHING_YET_S:g} s.")
        self._shown_s = seen.time_s
        frame = seen.rgbd(self._feed.camera)
        item = check_frame(frame).item
        if not item.any():
            raise SurfaceError("The camera sees no item to flatten.")
        item = self._without_holder(frame, item)
        try:
            return self._flattened(replace(frame, mask=item))
        except FlatclothError as error:
            # The remedy for recorded views, to use another one, does not apply here.
            raise SurfaceError(str(error).removeprefix("View 0: ").partition(";")[0] + ".") from error

    def _flattened(self, frame: RgbdFrame) -> FlattenedView:
        made, previous, self._last = self._integration, self._last, None
        surface = observe_item(frame, made.axis, made.config.surface)
        self._last = flatten(
            surface, made.axis, self._config, previous=previous,
            min_area_m2=made.config.surface.min_component_area_m2,
        )  # fmt: skip
        return self._last.view

    def _without_holder(self, frame: RgbdFrame, item: Bool) -> Bool:
        """Return the item (H, W) without the gripper and other objects, as found last."""
        now_s = time.monotonic()
        if now_s - self._looked_s >= HOLDER_INTERVAL_S:
            self._looked_s = now_s
            try:
                found = find_item([replace(frame, mask=None)], None, None, self._integration.config.surface)
                self._holder_m = np.where(item & ~found.masks[0], frame.depth_m, np.inf).astype(np.float32)
            except SegmentationError:  # for example two items: the whole frame is shown
                self._holder_m = None
        if self._holder_m is None or self._holder_m.shape != item.shape:
            return item
        own = item & (np.abs(frame.depth_m - self._holder_m) > HOLDER_M)
        return own if own.any() else item


def camera_recording(feed: CameraFeed) -> Recording:
    """Return a camera as a recording of one view, the newest frame, for code that needs a recording.

    Its axis is the vertical of a level camera, 0.5 to 1 m away. Reading raises ``CameraError`` if there is no
    frame.
    """
    camera = feed.camera

    def read(_view_index: int) -> ViewImages:
        seen = feed.newest(None, NOTHING_YET_S)
        if seen is None:
            raise CameraError(f"{camera.name}: no image yet.")
        return images_of(seen.rgbd(camera))

    return Recording(
        name=camera.name,
        description="live camera",
        location=f"camera {camera.name}",
        intrinsics=camera.intrinsics,
        rotation_axis=RotationAxis(
            point_m=np.array([0.0, 0.0, 0.8]), direction=np.array([0.0, -1.0, 0.0]), estimated=True
        ),
        held_point_m=np.array([0.0, -0.4, 0.8]),
        angles_deg=(0.0,),
        read=read,
    )


def cloud_of(frame: RgbdFrame) -> tuple[Float32, Uint8]:
    """Return points (N, 3) and colors (N, 3) near the camera in a frame, camera frame, an even selection."""
    depth = frame.depth_m
    few = depth[::8, ::8]
    measured = few[few > 0]
    if not measured.size:
        return np.zeros((0, 3), dtype=np.float32), np.zeros((0, 3), dtype=np.uint8)
    near = (depth > 0) & (depth < np.percentile(measured, 2) + BEHIND_M)
    rows, cols = np.nonzero(near)
    if rows.size > MOST_POINTS:
        keep = np.linspace(0, rows.size - 1, MOST_POINTS).astype(np.intp)
        rows, cols = rows[keep], cols[keep]
    points: Float32 = back_project(depth, frame.intrinsics)[rows, cols]
    return points, frame.color[rows, cols]
