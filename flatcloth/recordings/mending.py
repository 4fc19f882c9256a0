"""A recording read with mends: as if a mistake in it had not been made. The recording stays as it is."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from flatcloth.core.errors import RecordingError
from flatcloth.core.types import Intrinsics, RgbdFrame
from flatcloth.recordings.base import Recording, ViewImages, altered
from flatcloth.recordings.options import Mends as Mends
from flatcloth.recordings.options import options_of as options_of


def mended(recording: Recording, mends: Mends) -> Recording:
    """Return a recording read with mends; the recording itself if there are none.

    Raises
    ------
    RecordingError
        If a mend names a view that there is not, or leaves none.
    """
    if not mends:
        return recording
    depth_of = dict(mends.depth_views)
    named = [*mends.leave_out, *(view for view, _ in mends.view_angles), *depth_of, *depth_of.values()]
    wrong = [view for view in named if view >= len(recording)]
    kept = [n for n in range(len(recording)) if n not in mends.leave_out]
    if wrong or not kept:
        cause = f"has no view {wrong[0]}" if wrong else "has no view left"
        raise RecordingError(
            f"{recording.location}: {cause}. Correct --leave-out, --view-angles or --depth-views."
        )
    own = dict(mends.view_angles)
    sign = -mends.angle_factor if mends.reverse else mends.angle_factor
    angles = [sign * own.get(n, recording.angles_deg[n]) for n in kept]

    def read(view: int) -> ViewImages:
        frame = recording[kept[view]]
        if kept[view] in depth_of:
            frame = dataclasses.replace(frame, depth_m=recording[depth_of[kept[view]]].depth_m)
        return _images(frame, mends)

    k, f = recording.intrinsics, mends.focal_factor
    for _ in range(mends.rotate // 90):
        k = Intrinsics(width=k.height, height=k.width, fx=k.fy, fy=k.fx, cx=k.height - 1 - k.cy, cy=k.cx)
    return altered(
        recording,
        notes=(*getattr(recording, "notes", ()), f"Mended: {mends.words()}."),
        intrinsics=dataclasses.replace(k, fx=k.fx * f, fy=k.fy * f),
        angles_deg=tuple(angle - angles[0] for angle in angles),
        read=read,
        rotation_axis=None if mends.estimate_axis else recording.rotation_axis,
        held_point_m=None if mends.estimate_axis else recording.held_point_m,
        has_masks=recording.has_masks and not mends.without_masks,
        mends=mends,
    )


def _images(frame: RgbdFrame, mends: Mends) -> ViewImages:
    depth_m = frame.depth_m
    masks = [None if mends.without_masks else mask for mask in (frame.mask, frame.other_mask)]
    if mends.invert_masks:
        masks = [None if mask is None else ~mask & (depth_m > 0) for mask in masks]
    if mends.depth_factor != 1.0:
        depth_m = depth_m * np.float32(mends.depth_factor)

    def turned(image: Any) -> Any:
        image = image[:, ::-1] if mends.mirror else image
        return np.ascontiguousarray(np.rot90(image, -(mends.rotate // 90)))  # numpy turns anticlockwise

    color, scale = frame.color, mends.color_scale
    if mends.color_shift != (0.0, 0.0) or scale != 1.0:  # about the middle; the border repeats
        import cv2

        rows, cols = color.shape[:2]
        middle = np.array([(cols - 1) / 2, (rows - 1) / 2])
        moved = np.column_stack([scale * np.eye(2), (1 - scale) * middle + mends.color_shift])
        made = cv2.warpAffine(color, moved, (cols, rows), borderMode=cv2.BORDER_REPLICATE)
        color = np.asarray(made, dtype=np.uint8)
    return ViewImages(
        turned(color), turned(depth_m), *(None if mask is None else turned(mask) for mask in masks)
    )
