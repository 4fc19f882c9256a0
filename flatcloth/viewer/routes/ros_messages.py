"""The topics of ``/robot/rosbridge``: what the page shows as messages of ROS 2, in JSON.

Frames: ``base`` (the robot's, with a hand-eye transform), ``camera``, and ``object``, which turns with the
item. ``/tf`` relates them, and has a frame for each pick (``pick/1``) and each named point (``cuff_left``).
"""

from __future__ import annotations

import base64
import json
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from flatcloth.core.geometry import Rigid3, camera_from_object
from flatcloth.core.types import FlattenedView, RotationAxis
from flatcloth.export.data import png_bytes
from flatcloth.grasping.grasps import quaternion_wxyz
from flatcloth.viewer.routes.robot_answers import Present

OBJECT, CAMERA, BASE = "object", "camera", "base"
Frames = Mapping[str, tuple[str, Rigid3]]
"""The transforms between the frames: each child with its parent, and the child's pose there."""


@dataclass(frozen=True, kw_only=True)
class Topic:
    """A topic: the type of its messages, the part of the page they are made of, and what makes one."""

    type: str
    part: Callable[[Present], object]
    make: Callable[[Present, Frames], dict[str, Any]]


def frame_of(axis: RotationAxis, base_from_camera: Rigid3 | None, present: Present) -> Frames:
    """Return the frames at the rotation of the poses."""
    rotation_deg = float(present.document["rotation_deg"])
    parents = {OBJECT: (CAMERA, camera_from_object(axis, rotation_deg))}
    if base_from_camera is not None:
        parents[CAMERA] = (BASE, base_from_camera)
    return parents


def _poses(grasps: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """Return ``geometry_msgs/PoseArray`` of the grasps that have a pose, in the object frame."""
    poses = [_pose(grasp["poses"]["held"]) for grasp in grasps if grasp["poses"] is not None]
    return {"header": _header(OBJECT), "poses": poses}


def _pose(pose: Mapping[str, Any]) -> dict[str, Any]:
    w, x, y, z = pose["quaternion_wxyz"]
    return {"position": _xyz(pose["position_m"]), "orientation": {"x": x, "y": y, "z": z, "w": w}}


def _transforms(present: Present, frames: Frames) -> dict[str, Any]:
    """Return ``tf2_msgs/TFMessage``: the frames, each pick and each named point."""
    transforms = [
        _transform(parent, child, motion.translation_m, quaternion_wxyz(motion.rotation))
        for child, (parent, motion) in frames.items()
    ]
    document = present.document
    named = [(f"pick/{grasp['id']}", grasp) for grasp in document["grasps"]]
    named += [(grasp["name"], grasp) for grasp in document["garment_points"]]
    for name, grasp in named:
        if grasp["poses"] is not None:
            pose = grasp["poses"]["held"]
            transforms.append(_transform(OBJECT, name, pose["position_m"], pose["quaternion_wxyz"]))
    return {"transforms": transforms}


def _transform(parent: str, child: str, position_m: Any, wxyz: Any) -> dict[str, Any]:
    w, x, y, z = map(float, wxyz)
    return {
        "header": _header(parent),
        "child_frame_id": child,
        "transform": {"translation": _xyz(position_m), "rotation": {"x": x, "y": y, "z": z, "w": w}},
    }


def _xyz(position_m: Any) -> dict[str, float]:
    return dict(zip("xyz", map(float, position_m), strict=True))


def _cloud(view: FlattenedView) -> dict[str, Any]:
    """Return ``sensor_msgs/PointCloud2`` of the cloth: x, y, z in metres, ``rgb`` as PCL packs it."""
    at = view.valid
    kinds = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("rgb", "<u4")]
    points = np.zeros(int(at.sum()), dtype=kinds)
    points["x"], points["y"], points["z"] = view.xyz_m[at].T
    red, green, blue = view.rgb[at].astype(np.uint32).T
    points["rgb"] = red << 16 | green << 8 | blue
    return {
        "header": _header(OBJECT),
        "height": 1,
        "width": points.size,
        "fields": [
            {"name": name, "offset": 4 * n, "datatype": 7, "count": 1} for n, (name, _) in enumerate(kinds)
        ],  # 7 is FLOAT32
        "is_bigendian": False,
        "point_step": points.itemsize,
        "row_step": points.nbytes,
        "data": base64.b64encode(points.tobytes()).decode(),
        "is_dense": True,
    }


def _image(view: FlattenedView) -> dict[str, Any]:
    """Return ``sensor_msgs/CompressedImage`` of the flat image."""
    return {
        "header": _header("flattened"),
        "format": "png",
        "data": base64.b64encode(png_bytes(view.rgb, view.valid)).decode(),
    }


def _header(frame: str) -> dict[str, Any]:
    sec, nanosec = divmod(time.time_ns(), 10**9)
    return {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": frame}


def _text(values: Any) -> dict[str, str]:
    return {"data": json.dumps(values, allow_nan=False)}


TOPICS: dict[str, Topic] = {
    "/flatcloth/picks": Topic(
        type="geometry_msgs/PoseArray",
        part=lambda present: present.document["grasps"],
        make=lambda present, _: _poses(present.document["grasps"]),
    ),
    "/flatcloth/named_points": Topic(
        type="geometry_msgs/PoseArray",
        part=lambda present: present.document["garment_points"],
        make=lambda present, _: _poses(present.document["garment_points"]),
    ),
    "/flatcloth/grasps": Topic(
        type="std_msgs/String",
        part=lambda present: present.document,
        make=lambda present, _: _text(present.document),
    ),
    "/tf": Topic(
        type="tf2_msgs/TFMessage",
        part=lambda present: present.document,
        make=_transforms,
    ),
    "/flatcloth/cloud": Topic(
        type="sensor_msgs/PointCloud2",
        part=lambda present: present.shape.revision,
        make=lambda present, _: _cloud(present.picture.pieces("this")[0]),
    ),
    "/flatcloth/image": Topic(
        type="sensor_msgs/CompressedImage",
        part=lambda present: present.shape.revision,
        make=lambda present, _: _image(present.picture.pieces("this")[0]),
    ),
}
"""All topics; each is sent when it is subscribed, and whenever its part has changed."""
