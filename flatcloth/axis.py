"""The turning axis and the held point of a recording that does not give them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from flatcloth.config import SurfaceConfig
from flatcloth.geometry import back_project
from flatcloth.recordings.base import Recording
from flatcloth.surface import foreground_mask
from flatcloth.types import Float64, RgbdFrame, RotationAxis

UP = np.array([0.0, -1.0, 0.0])
"""Up in the camera frame of a level camera."""


def resolve_axis(
    recording: Recording, frame: Callable[[int], RgbdFrame], config: SurfaceConfig
) -> tuple[RotationAxis, Float64]:
    """Return the turning axis and the held point, camera frame of view 0.

    Parameters
    ----------
    recording : Recording
        Where they are looked up first.
    frame : callable
        Reads a view; used only if something is missing.
    config : SurfaceConfig
        Limits of the foreground search.

    Returns
    -------
    axis : RotationAxis
        As recorded; else the vertical of a level camera through the held point, marked as estimated.
    held_point_m : (3,) float64
        As recorded; else the top of the item in view 0, the mean of its uppermost 10 mm.
    """
    axis, held = recording.rotation_axis, recording.held_point_m
    if axis is not None and held is not None:
        return axis, held
    if held is None:
        first = frame(0)
        item = (
            foreground_mask(first, axis, config) if first.mask is None else first.mask & (first.depth_m > 0)
        )
        points = back_project(first.depth_m, first.intrinsics)[item].astype(np.float64)
        height = points @ (UP if axis is None else axis.direction)
        held = points[height >= height.max() - 0.010].mean(axis=0) if len(points) else np.zeros(3)
    return axis or RotationAxis(point_m=held, direction=UP, estimated=True), held
