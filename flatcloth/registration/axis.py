"""The turning axis and the held point of a recording that lacks them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from flatcloth.core.config import SurfaceConfig
from flatcloth.core.errors import RecordingError, SurfaceError
from flatcloth.core.geometry import back_project, object_from_camera
from flatcloth.core.types import Float64, RgbdFrame, RotationAxis
from flatcloth.flattening.surface import foreground_mask
from flatcloth.recordings.base import Recording
from flatcloth.registration.axis_estimation import (
    UP,
    choose_views,
    coarse_features,
    estimate_axis,
)
from flatcloth.registration.view_features import ViewFeatures

T = TypeVar("T")

TOP_M = 0.010
"""The held point is the mean of the item's uppermost part of this height. Set by hand."""

THREADS = 2
"""Views read at a time. Chosen for two cores; more need more memory."""
_AROUND_M = np.array([(0.0, 0.0, 0.0), (0.0, 0.0, 0.08), (-0.08, 0.0, 0.04), (0.08, 0.0, 0.04)])
"""Start points of the axis: the visible surface lies in front of the axis. Set by hand."""


@dataclass(frozen=True, kw_only=True)
class Hanging:
    """How the item hangs, camera frame of view 0: the axis, the held point, and notes for the operator."""

    axis: RotationAxis
    held_point_m: Float64
    notes: tuple[str, ...] = ()


def resolve_axis(recording: Recording, frame: Callable[[int], RgbdFrame], config: SurfaceConfig) -> Hanging:
    """Return how the item hangs, as recorded or as estimated from the views.

    Parameters
    ----------
    recording : Recording
        Its axis and held point are used if it has them.
    frame : callable
        Reads a view; used only if something is missing, and then by several threads.
    config : SurfaceConfig
        Limits of the foreground search.

    Returns
    -------
    Hanging
        An axis that is not recorded is estimated from up to 18 views. If they do not determine it,
        it is the vertical of a level camera through the held point. A held point that is not
        recorded is the top of the item.

    Raises
    ------
    RecordingError
        If no view can be read.

    Notes
    -----
    It takes about 0.6 s for 18 views of 480x848 px on two cores.
    """
    axis, held = recording.rotation_axis, recording.held_point_m
    if axis is not None and held is not None:
        return Hanging(axis=axis, held_point_m=held)
    if axis is not None:
        return Hanging(axis=axis, held_point_m=_found_held_point(recording, frame, axis, config))
    views = choose_views(recording.angles_deg)
    seen = _of_readable(views, lambda view: coarse_features(frame(view), config))
    found = estimate_axis(seen, _starts(seen, held))
    if found is not None:
        axis, rms_m = found
        note = (
            f"The turning axis is not recorded. It was estimated from {len(seen)} views, which agree "
            f"to {1000 * rms_m:.1f} mm."
        )
        top = _found_held_point(recording, frame, axis, config) if held is None else held
        return Hanging(axis=_through_height_of(top, axis), held_point_m=top, notes=(note,))
    upright = RotationAxis(point_m=np.zeros(3), direction=UP, estimated=True)
    top = (
        _top(_of_readable(views[:1], lambda view: _points(frame(view), config)), upright)
        if held is None
        else held
    )
    return Hanging(
        axis=replace(upright, point_m=top), held_point_m=top, notes=(_cannot_tell(recording, seen, top),)
    )


def _of_readable(views: Sequence[int], look: Callable[[int], T | None]) -> list[T]:
    """Return the results of the readable views; a damaged view is reported when it is requested."""
    errors: list[RecordingError] = []

    def looked(view: int) -> T | None:
        try:
            return look(view)
        except RecordingError as error:
            errors.append(error)
            return None

    with ThreadPoolExecutor(THREADS) as pool:
        seen = [found for found in pool.map(looked, views) if found is not None]
    if errors and not seen:
        raise errors[0]
    return seen


def _starts(seen: Sequence[ViewFeatures], held_point_m: Float64 | None) -> list[Float64]:
    """Points that the axis may be near: the held point or the top, the middle, and around the middle."""
    if not seen:
        return []
    upright = RotationAxis(point_m=np.zeros(3), direction=UP)
    top = (
        np.median([_top([view.all_points_m], upright) for view in seen], axis=0)
        if held_point_m is None
        else held_point_m
    )
    middle: Float64 = np.median(np.concatenate([view.all_points_m for view in seen]), axis=0)
    return [top, *(middle + shift for shift in _AROUND_M)]


def _found_held_point(
    recording: Recording, frame: Callable[[int], RgbdFrame], axis: RotationAxis, config: SurfaceConfig
) -> Float64:
    """Return the top of the item in views all around it, object frame."""

    def look(view: int) -> Float64 | None:
        points = _points(frame(view), config, axis)
        return None if points is None else object_from_camera(axis, recording.angles_deg[view]).apply(points)

    return _top(_of_readable(choose_views(recording.angles_deg), look), axis)


def _points(frame: RgbdFrame, config: SurfaceConfig, axis: RotationAxis | None = None) -> Float64 | None:
    """Return the points (N, 3) of the whole item, camera frame; None if there are none.

    The mask is ignored, because the held point need not be on the side of interest.
    """
    try:
        item = foreground_mask(replace(frame, mask=None), axis, config)
    except SurfaceError:
        return None
    return back_project(frame.depth_m, frame.intrinsics)[item].astype(np.float64)


def _top(views: Sequence[Float64], axis: RotationAxis) -> Float64:
    """Return the mean of the uppermost 10 mm of the points (N, 3) of some views; zeros without views.

    The top is the median of the views', because some may not show it or contain an outlier.
    """
    if not views:
        return np.zeros(3)
    heights = [points @ axis.direction for points in views]
    top = float(np.median([height.max() for height in heights]))
    upper = [
        p[h >= top - TOP_M].mean(axis=0)
        for p, h in zip(views, heights, strict=True)
        if h.max() >= top - TOP_M
    ]
    return np.asarray(np.mean(upper, axis=0))


def _through_height_of(point_m: Float64, axis: RotationAxis) -> RotationAxis:
    """Return the same axis with its point at the height of another point."""
    along = (point_m - axis.point_m) @ axis.direction
    return replace(axis, point_m=axis.point_m + along * axis.direction)


def _cannot_tell(recording: Recording, seen: Sequence[ViewFeatures], held_point_m: Float64) -> str:
    note = "The turning axis is not recorded; the vertical through the top of the item is used."
    if len(recording) < 2:
        return note
    backwards = [replace(view, angle_deg=-view.angle_deg) for view in seen]
    if estimate_axis(backwards, _starts(seen, held_point_m)) is not None:
        return (
            f"{note} The views agree only for the other direction of rotation: open the recording with "
            "the signs of its angles reversed."
        )
    return f"{note} The views agree with no axis: check the angles, or give rotation_axis in recording.json."
