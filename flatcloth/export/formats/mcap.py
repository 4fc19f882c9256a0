"""A session as ``.mcap`` for Foxglove, written with Foxglove's own library and its own message types.

One second for each view, in the order in which the views joined the shape. Frames: ``camera`` stands still,
``object`` turns with the item.
"""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from flatcloth.core.geometry import Rigid3
from flatcloth.core.types import Intrinsics
from flatcloth.export.data import png_bytes
from flatcloth.export.formats.moments import Moment, moments, points_of
from flatcloth.export.session import OpenedSession
from flatcloth.grasping.grasps import quaternion_wxyz
from flatcloth.rendering.pictures import jpeg
from flatcloth.session.journal import Pick

VIEW_NS = 1_000_000_000
"""Time of each view. Chosen: to be watched."""


def write_mcap(session: OpenedSession, path: Path) -> None:
    """Write images, transforms, the shape as it grew, and the poses of picks and named points.

    Raises
    ------
    FlatclothError
        If the session has no start view.
    """
    import foxglove
    from foxglove import channels

    begun = datetime.fromisoformat(session.history.header.created)
    begun_ns = int(begun.timestamp()) * 1_000_000_000
    context, poses = foxglove.Context(), _poses(session, points_of(session))
    with foxglove.open_mcap(path, allow_overwrite=True, context=context) as writer:
        log: dict[str, Any] = {
            "tf": channels.FrameTransformsChannel("/tf", context=context),
            "calibration": channels.CameraCalibrationChannel("/camera/calibration", context=context),
            "color": channels.CompressedImageChannel("/camera/color", context=context),
            "cloud": channels.PointCloudChannel("/shape/cloud", context=context),
            "flat": channels.CompressedImageChannel("/shape/image", context=context),
            "points": channels.PosesInFrameChannel("/points", context=context),
        }
        for moment in moments(session):
            messages = _messages(session, moment, poses)
            for topic, make in messages.items():
                log[topic].log(make, log_time=begun_ns + VIEW_NS * moment.order)
        writer.write_metadata(
            "flatcloth",
            {"recording": session.history.header.recording.name, "method": session.history.header.method},
        )


def _poses(session: OpenedSession, points: list[Pick]) -> dict[str, Rigid3]:
    """Return the grasp poses in the object frame by name; points whose normal is unknown have none."""
    found = {}
    for point in points:
        pose = session.pose_of(point)
        if pose is not None:
            found[point.name] = pose.object_from_grasp
    return found


def _messages(session: OpenedSession, moment: Moment, poses: dict[str, Rigid3]) -> dict[str, Any]:
    from foxglove import messages as types

    frames = {"object": ("camera", moment.camera_from_object)}
    frames |= {f"point/{name}": ("object", pose) for name, pose in poses.items()}
    transforms = [
        types.FrameTransform(
            parent_frame_id=parent,
            child_frame_id=child,
            translation=_vector(types.Vector3, motion),
            rotation=_quaternion(types, motion),
        )
        for child, (parent, motion) in frames.items()
    ]
    listed = [
        types.Pose(position=_vector(types.Vector3, pose), orientation=_quaternion(types, pose))
        for pose in poses.values()
    ]
    flat = png_bytes(session.growth.view.rgb, moment.shown)
    return {
        "tf": types.FrameTransforms(transforms=transforms),
        "calibration": _calibration(types, session.integration.recording.intrinsics),
        "color": types.CompressedImage(frame_id="camera", data=jpeg(moment.frame.color), format="jpeg"),
        "cloud": _cloud(types, moment),
        "flat": types.CompressedImage(frame_id="flattened", data=flat, format="png"),
        "points": types.PosesInFrame(frame_id="object", poses=listed),
    }


def _cloud(types: Any, moment: Moment) -> Any:
    kinds = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("red", "u1"), ("green", "u1"), ("blue", "u1")]
    points = np.rec.fromarrays([*moment.points_m.T, *moment.colors.T], dtype=kinds)
    numbers = types.PackedElementFieldNumericType
    offsets = {name: offset for name, (_, offset, *_rest) in (points.dtype.fields or {}).items()}
    fields = [
        types.PackedElementField(
            name=name, offset=offsets[name],
            type=numbers.Float32 if kind == "<f4" else numbers.Uint8,
        )
        for name, kind in kinds
    ]  # fmt: skip
    return types.PointCloud(
        frame_id="object", point_stride=points.itemsize, fields=fields, data=points.tobytes()
    )


def _calibration(types: Any, camera: Intrinsics) -> Any:
    matrix = [camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0]
    return types.CameraCalibration(
        frame_id="camera",
        width=camera.width,
        height=camera.height,
        K=matrix,
        P=[*matrix[:3], 0.0, *matrix[3:6], 0.0, *matrix[6:], 0.0],
    )


def _vector(kind: Any, motion: Rigid3) -> Any:
    x, y, z = map(float, motion.translation_m)
    return kind(x=x, y=y, z=z)


def _quaternion(types: Any, motion: Rigid3) -> Any:
    w, x, y, z = map(float, quaternion_wxyz(motion.rotation))
    return types.Quaternion(x=x, y=y, z=z, w=w)
