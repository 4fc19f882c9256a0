"""Views as they come from a camera, a robot or a cell, and what is wrong with them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from flatcloth.core.config import SurfaceConfig
from flatcloth.core.errors import FlatclothError
from flatcloth.core.geometry import back_project, camera_from_object, object_from_camera, project
from flatcloth.core.strokes import ImageStroke
from flatcloth.core.types import Bool, Float32, Float64, Intrinsics, RgbdFrame, RotationAxis
from flatcloth.engine.views import RecordedViews
from flatcloth.flattening.surface import crop_to_item, foreground_mask
from flatcloth.recordings.base import apart_deg
from flatcloth.recordings.writer import GrowingRecording
from flatcloth.session.store import Keeper

_SAME_M = 0.010
"""Depths that agree: sway, noise and an angle that is off by two degrees move cloth by less. Chosen."""
_POINTS = 1500
"""Points compared of a view, and of the others together. Chosen for speed; they are hundreds of independent
places."""
_COARSE_DEG, _FINE_DEG = 4.0, 1.0
"""Steps of the search. Chosen: cloth 0.15 m from the axis moves by _SAME_M in four degrees."""
WRONG_DEG = 6.0
"""An announced angle that is off by more is wrong; registration refines smaller errors. Chosen."""
_BETTER = 0.10
"""By so much more of the compared points must agree at another angle. Chosen: five times the standard
deviation of the share of five hundred points."""


class ViewError(FlatclothError):
    """A view that cannot be taken; the message gives the reason. Nothing of what was taken is lost."""


@dataclass(frozen=True, kw_only=True)
class SeenView(RgbdFrame):
    """A view as announced, without a number; ``axis`` and ``held_point_m``, camera frame, None if unknown."""

    view_index: int = 0
    mask: Bool | None = None
    axis: RotationAxis | None = None
    held_point_m: Float64 | None = None
    source: str = "a robot"


@dataclass(frozen=True, kw_only=True)
class Taken:
    """What became of a view: its number, and the messages about it."""

    number: int
    told: tuple[str, ...]


def check_view(view: SeenView, recording: GrowingRecording | None) -> None:
    """Refuse a view that has no place in a recording.

    Raises
    ------
    ViewError
        With the reason.
    """
    height, width = view.depth_m.shape
    if not math.isfinite(view.angle_deg) or abs(view.angle_deg) > 3600:
        raise ViewError(f"{view.angle_deg} is not an angle: announce degrees since the first view.")
    is_registered = view.color.shape == (height, width, 3)
    if not is_registered or (view.intrinsics.width, view.intrinsics.height) != (width, height):
        raise ViewError(
            f"color is {view.color.shape[1]}x{view.color.shape[0]}, depth {width}x{height} pixels and the "
            f"camera {view.intrinsics.width}x{view.intrinsics.height}: send images registered to each other."
        )
    if not (view.depth_m > 0).any():
        raise ViewError("the view has no depth, every pixel is 0: is the camera covered? Look again.")
    if recording is None or not len(recording):
        return
    camera = recording.intrinsics
    if (camera.width, camera.height) != (width, height):
        raise ViewError(
            f"the view has {width}x{height} pixels, the views before it {camera.width}x{camera.height}: "
            "use the same camera mode, or begin a new folder."
        )
    if (view.mask is not None) != recording.has_masks:
        raise ViewError("all views of a recording have masks, or none has: send them as before.")


def doubled(view: SeenView, views: RecordedViews) -> int | None:
    """Return the number of the recorded view that a view repeats, pixel by pixel; None if it is another."""
    for number in range(len(views.angles_deg)):
        if np.array_equal(views.recorded(number).color, view.color):
            return number
    return None


def keep_side(views: RecordedViews, session: Keeper) -> None:
    """Record a stroke on the side of interest that was found from the views: further views keep it."""
    document = session.state.document
    if not views.finds_sides or document.strokes or document.start_view is not None:
        return
    stroke = stroke_on_side(views)
    if stroke is not None:
        session.record(stroke)


def stroke_on_side(views: RecordedViews) -> ImageStroke | None:
    """Return a stroke in the middle of the side of interest, as it was found in the first view with it."""
    masks = views.segment(())
    for number in range(len(views.angles_deg)):
        mask = None if masks is None else masks.mask(number)
        if mask is not None and mask.any():
            depth_px = ndimage.distance_transform_edt(np.pad(mask, 1))
            row, col = np.unravel_index(int(depth_px.argmax()), depth_px.shape)
            return ImageStroke(
                side="this", view_index=number, points_rc=((float(row) - 1.0, float(col) - 1.0),)
            )
    return None


class AngleFinder:
    """Finds angles of views: points of earlier views must not lie before its surface, nor off the item.

    Agreement at an angle: the share of the compared points that meet the same surface, less that of those
    that meet none.

    Parameters
    ----------
    views : RecordedViews
        The earlier views. Those that are added to them later are compared, too.
    """

    def __init__(self, views: RecordedViews) -> None:
        self._views = views
        self._seen: list[_Surface] = []  # of each view, in its own camera

    def corrected_deg(self, view: SeenView) -> float | None:
        """Return the angle at which a view clearly agrees better than at its announced one; None if none."""
        axis, config = self._views.axis, self._views.config.surface
        for number in range(len(self._seen), len(self._views.angles_deg)):
            self._seen.append(_surface_of(self._views.recorded(number), axis, config))
        new, count = _surface_of(view, axis, config), len(self._seen)
        poses = [object_from_camera(axis, angle) for angle in self._views.angles_deg]
        known_m = np.concatenate(
            [pose.apply(each.points_m[::count]) for pose, each in zip(poses, self._seen, strict=True)]
        )
        some_new = new.points_m[::count]

        def in_new(angle_deg: float) -> Float64:
            return _votes(camera_from_object(axis, angle_deg).apply(known_m), new)

        def agreement(angle_deg: float) -> float:
            back = object_from_camera(axis, angle_deg).apply(some_new)
            poses_and_seen = zip(poses, self._seen, strict=True)
            votes = [_votes(pose.inverse().apply(back), each) for pose, each in poses_and_seen]
            return float(np.concatenate([in_new(angle_deg), *votes]).mean())

        coarse = np.arange(0.0, 360.0, _COARSE_DEG)
        best = float(coarse[int(np.argmax([in_new(angle).mean() for angle in coarse]))])
        fine = best + np.arange(-_COARSE_DEG, _COARSE_DEG + _FINE_DEG, _FINE_DEG)
        agreements = [agreement(angle) for angle in fine]
        near = view.angle_deg + np.arange(-2.0, 3.0, 2.0) * _FINE_DEG
        found_deg = float(fine[int(np.argmax(agreements))]) % 360.0
        is_better = max(agreements) - max(agreement(angle) for angle in near) > _BETTER
        return found_deg if is_better and apart_deg(found_deg, view.angle_deg) > WRONG_DEG else None


@dataclass(frozen=True, kw_only=True)
class _Surface:
    """The item in one view: some of its points (N, 3), and the image around it, its depth 0 off the item."""

    points_m: Float64
    depth_m: Float32
    intrinsics: Intrinsics


def _surface_of(frame: RgbdFrame, axis: RotationAxis, config: SurfaceConfig) -> _Surface:
    frame = replace(frame, mask=None)
    frame, item = crop_to_item(frame, foreground_mask(frame, axis, config))
    points = back_project(frame.depth_m, frame.intrinsics)[item].astype(np.float64)
    step = max(1, len(points) // _POINTS)
    return _Surface(
        points_m=points[::step],
        depth_m=np.where(item, frame.depth_m, 0.0).astype(np.float32),
        intrinsics=frame.intrinsics,
    )


def _votes(points_m: Float64, seen: _Surface) -> Float64:
    """Return for points (N, 3), camera frame, 1 on the surface, 0 behind it, -1 before it or off the item."""
    rc = np.rint(project(points_m, seen.intrinsics)).astype(np.int64)
    height, width = seen.depth_m.shape
    inside = (rc >= 0).all(axis=1) & (rc[:, 0] < height) & (rc[:, 1] < width) & (points_m[:, 2] > 0)
    depth, measured = points_m[:, 2], np.zeros(len(points_m), dtype=np.float32)
    measured[inside] = seen.depth_m[rc[inside, 0], rc[inside, 1]]
    votes = np.where(np.abs(depth - measured) <= _SAME_M, 1.0, np.where(depth > measured, 0.0, -1.0))
    found: Float64 = np.where(measured == 0.0, -1.0, votes)
    return found
