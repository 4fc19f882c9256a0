"""The views of a session in the order in which they joined the shape, for files that can be played."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from flatcloth.core.geometry import Rigid3, camera_from_object
from flatcloth.core.types import Bool, Float32, RgbdFrame, Uint8
from flatcloth.export.data import png_bytes
from flatcloth.export.garment import named_points
from flatcloth.export.session import OpenedSession
from flatcloth.grasping.grasps import quaternion_wxyz
from flatcloth.rendering.pictures import jpeg
from flatcloth.session.journal import Pick

_EVERY = 2
"""Before the last view the cloud has every second row and column of the shape. Chosen for size."""


@dataclass(frozen=True, kw_only=True)
class Moment:
    """A view as it joined the shape, and the shape with it.

    ``order`` counts from 0; ``camera_from_object`` is the pose of the item before the fixed camera;
    ``points_m`` (N, 3) float32, object frame, and ``colors`` (N, 3) uint8 are the cloth of the shape so far,
    ``shown`` (H, W) its pixels on the plane.
    """

    order: int
    frame: RgbdFrame
    camera_from_object: Rigid3
    points_m: Float32
    colors: Uint8
    shown: Bool


def moments(session: OpenedSession) -> Iterator[Moment]:
    """Yield the views of a session's shape in the order of acceptance.

    Raises
    ------
    FlatclothError
        If the session has no start view.
    """
    growth, integration = session.growth, session.integration
    view = growth.view
    for step in growth.steps:
        shown = growth.shown_after(step.order)
        listed = shown.copy()
        if step.order + 1 < len(growth.steps):
            listed[:] = False
            listed[::_EVERY, ::_EVERY] = shown[::_EVERY, ::_EVERY]
        frame = integration.recording[step.view_index]
        yield Moment(
            order=step.order,
            frame=frame,
            camera_from_object=camera_from_object(integration.axis, frame.angle_deg),
            points_m=view.xyz_m[listed],
            colors=view.rgb[listed],
            shown=shown,
        )
        session.progress((step.order + 1) / len(growth.steps), "writing views")


def points_of(session: OpenedSession) -> list[Pick]:
    """Return the picks of a session, and the named points that were seen."""
    return [*session.history.picks, *named_points(session.data.garment)]


# --- rerun ----------------------------------------------------------------------------------------

OBJECT = "camera/object"
DEPTH_PER_M = 10_000.0
"""Steps of the depth images in a metre. Chosen: 0.1 mm, up to 6.5 m."""


def write_rrd(session: OpenedSession, path: Path) -> None:
    """Write the cloud of the shape as it grew, the views, the flat shape, and the points at each angle.

    Raises
    ------
    FlatclothError
        If the session has no start view.
    """
    import rerun as rr

    recording, points = session.integration.recording, points_of(session)
    stream = rr.RecordingStream("flatcloth", recording_id=recording.name)
    stream.save(str(path))
    stream.set_log_time_enabled(False)  # the time of the export is irrelevant
    camera = recording.intrinsics
    matrix = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    stream.log("camera", rr.ViewCoordinates.RDF, static=True)
    stream.log(
        "camera/image", rr.Pinhole(image_from_camera=matrix, width=camera.width, height=camera.height),
        static=True,
    )  # fmt: skip
    positions_m = np.array([point.position_held_m for point in points]).reshape(-1, 3)
    names = [point.name for point in points]
    stream.log(f"{OBJECT}/points", rr.Points3D(positions_m, labels=names, radii=0.005), static=True)
    for moment in moments(session):
        frame, pose = moment.frame, moment.camera_from_object
        stream.set_time("step", sequence=moment.order)
        # Timelines count whole numbers: thousandths of a degree.
        stream.set_time("angle", sequence=round(1000 * frame.angle_deg))
        stream.log("angle_deg", rr.Scalars(frame.angle_deg))
        stream.log(OBJECT, rr.Transform3D(translation=pose.translation_m, mat3x3=pose.rotation))
        stream.log(f"{OBJECT}/cloud", rr.Points3D(moment.points_m, colors=moment.colors, radii=0.001))
        stream.log("camera/image/color", rr.EncodedImage(contents=jpeg(frame.color), media_type="image/jpeg"))
        depth = cv2.imencode(".png", np.rint(DEPTH_PER_M * frame.depth_m).astype(np.uint16))[1].tobytes()
        encoded = rr.EncodedDepthImage(depth, media_type="image/png", meter=DEPTH_PER_M)
        stream.log("camera/image/depth", encoded)
        flat = png_bytes(session.growth.view.rgb, moment.shown)
        stream.log("flat/image", rr.EncodedImage(contents=flat, media_type="image/png"))
        if points:
            in_camera = rr.Points3D(pose.apply(positions_m), labels=names, radii=0.005)
            stream.log("points_in_camera", in_camera)
    stream.flush()
    stream.disconnect()


# --- MCAP, for Foxglove ---------------------------------------------------------------------------

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
    context = foxglove.Context()
    found = {point.name: session.pose_of(point) for point in points_of(session)}
    poses = {name: pose.object_from_grasp for name, pose in found.items() if pose is not None}
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


def _messages(session: OpenedSession, moment: Moment, poses: dict[str, Rigid3]) -> dict[str, Any]:
    from foxglove import messages as types

    def place(kind: Any, motion: Rigid3) -> Any:
        x, y, z = map(float, motion.translation_m)
        return kind(x=x, y=y, z=z)

    def turn(motion: Rigid3) -> Any:
        w, x, y, z = map(float, quaternion_wxyz(motion.rotation))
        return types.Quaternion(x=x, y=y, z=z, w=w)

    frames = {"object": ("camera", moment.camera_from_object)}
    frames |= {f"point/{name}": ("object", pose) for name, pose in poses.items()}
    transforms = [
        types.FrameTransform(
            parent_frame_id=parent,
            child_frame_id=child,
            translation=place(types.Vector3, motion),
            rotation=turn(motion),
        )
        for child, (parent, motion) in frames.items()
    ]
    listed = [types.Pose(position=place(types.Vector3, p), orientation=turn(p)) for p in poses.values()]
    k = session.integration.recording.intrinsics
    matrix = [k.fx, 0.0, k.cx, 0.0, k.fy, k.cy, 0.0, 0.0, 1.0]
    projection = [*matrix[:3], 0.0, *matrix[3:6], 0.0, *matrix[6:], 0.0]
    kinds = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("red", "u1"), ("green", "u1"), ("blue", "u1")]
    points = np.rec.fromarrays([*moment.points_m.T, *moment.colors.T], dtype=kinds)
    numbers = types.PackedElementFieldNumericType
    fields = [
        types.PackedElementField(
            name=name, offset=offset, type=numbers.Float32 if kind == np.float32 else numbers.Uint8
        )
        for name, (kind, offset, *_) in (points.dtype.fields or {}).items()
    ]
    cloud = types.PointCloud(
        frame_id="object", point_stride=points.itemsize, fields=fields, data=points.tobytes()
    )
    flat = png_bytes(session.growth.view.rgb, moment.shown)
    return {
        "tf": types.FrameTransforms(transforms=transforms),
        "calibration": types.CameraCalibration(
            frame_id="camera", width=k.width, height=k.height, K=matrix, P=projection
        ),
        "color": types.CompressedImage(frame_id="camera", data=jpeg(moment.frame.color), format="jpeg"),
        "cloud": cloud,
        "flat": types.CompressedImage(frame_id="flattened", data=flat, format="png"),
        "points": types.PosesInFrame(frame_id="object", poses=listed),
    }
