"""A session as ``.rrd`` for the rerun viewer, written with its own library.

Timelines: ``step``, in which the views joined the shape, and ``angle``, at which the item stood. The camera
stands still; ``camera/object`` turns with the item.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np

from flatcloth.export.data import png_bytes
from flatcloth.export.formats.moments import Moment, moments, points_of
from flatcloth.export.session import OpenedSession
from flatcloth.rendering.pictures import jpeg

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
        _log(rr, stream, session, moment, positions_m, names)
    stream.flush()
    stream.disconnect()


def _log(
    rr: Any, stream: Any, session: OpenedSession, moment: Moment, positions_m: Any, names: list[str]
) -> None:
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
    rgb = session.growth.view.rgb
    flat = png_bytes(rgb, moment.shown)
    stream.log("flat/image", rr.EncodedImage(contents=flat, media_type="image/png"))
    if len(positions_m):
        in_camera = pose.apply(positions_m)
        stream.log("points_in_camera", rr.Points3D(in_camera, labels=names, radii=0.005))
