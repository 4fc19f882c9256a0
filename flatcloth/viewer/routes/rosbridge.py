"""rosbridge's JSON protocol, for clients of ROS without ROS here: topics of the shape, and one service.

The protocol is version 2 of rosbridge_suite (ROBOTIS and RobotWebTools, ``ROSBRIDGE_PROTOCOL.md``), of which
``subscribe``, ``unsubscribe`` and ``call_service`` are answered. Messages have the fields of ROS 2; byte
arrays are base64, as rosbridge sends them.

Frames: ``base`` (the robot's, with a hand-eye transform), ``camera``, and ``object``, which turns with the
item. ``/tf`` relates them, and has a frame for each pick (``pick/1``) and each named point (``cuff_left``).
"""

from __future__ import annotations

import base64
import json
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import msgspec
import numpy as np
from starlette.concurrency import run_in_threadpool
from starlette.websockets import WebSocket

from flatcloth.core.errors import FlatclothError
from flatcloth.core.geometry import Rigid3, camera_from_object
from flatcloth.core.types import FlattenedView, RotationAxis
from flatcloth.export.data import png_bytes
from flatcloth.grasping.grasps import quaternion_wxyz
from flatcloth.viewer import http
from flatcloth.viewer.protocol.robot import ProposedPick
from flatcloth.viewer.protocol.sent import encoded
from flatcloth.viewer.routes.robot import RobotAnswers, Shown, push

OBJECT, CAMERA, BASE = "object", "camera", "base"
Frames = Mapping[str, tuple[str, Rigid3]]
"""The transforms between the frames: each child with its parent, and the child's pose there."""


@dataclass(frozen=True, kw_only=True)
class Topic:
    """A topic: the type of its messages, the part of the page they are made of, and what makes one."""

    type: str
    part: Callable[[Shown], object]
    make: Callable[[Shown, Frames], dict[str, Any]]


def frame_of(axis: RotationAxis, base_from_camera: Rigid3 | None, present: Shown) -> Frames:
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


def _transforms(present: Shown, frames: Frames) -> dict[str, Any]:
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
        make=lambda present, _: _cloud(present.view),
    ),
    "/flatcloth/image": Topic(
        type="sensor_msgs/CompressedImage",
        part=lambda present: present.shape.revision,
        make=lambda present, _: _image(present.view),
    ),
}
"""All topics; each is sent when it is subscribed, and whenever its part has changed."""


SERVICE = "/flatcloth/propose_pick"


class _Request(msgspec.Struct, frozen=True, kw_only=True):
    """An operation of a client; fields of other operations are ignored."""

    op: str
    id: str | None = None
    topic: str = ""
    service: str = ""
    args: Any = None


@dataclass
class _Client:
    """A connected client: its topics, each with the part of the page that it was sent of last."""

    rotation_deg: float | None
    sent: dict[str, object] = field(default_factory=dict)
    lock: threading.Lock = field(default_factory=threading.Lock)


class RosBridge:
    """Answers the clients of ``/robot/rosbridge``."""

    def __init__(self, answers: RobotAnswers) -> None:
        self._answers = answers

    async def serve(self, socket: WebSocket) -> None:
        """Serve one client until it leaves."""
        await socket.accept()
        try:
            client = _Client(http.rotation_of(socket))
        except FlatclothError as error:
            await socket.close(1008, str(error))
            return

        async def hear(text: str) -> None:
            answer = await run_in_threadpool(self._answer, text, client)
            if answer is not None:
                await socket.send_text(encoded(answer).decode())

        await push(socket, lambda: self._news(client), hear)

    def _answer(self, text: str, client: _Client) -> dict[str, Any] | None:
        """Carry out an operation; return the answer to the client, None: no answer."""
        try:
            if len(text) > http.MAX_BODY_BYTES:
                raise ValueError(f"it is longer than {http.MAX_BODY_BYTES} characters")
            request = msgspec.json.decode(text, type=_Request)
        except (ValueError, RecursionError) as error:
            return _status("error", f"The message is not one of rosbridge: {error}.", None)
        match request.op:
            case "subscribe" if request.topic in TOPICS:
                with client.lock:
                    client.sent[request.topic] = None
            case "subscribe":
                known = ", ".join(TOPICS)
                return _status("error", f"No topic {request.topic!r:.80}; there are {known}.", request.id)
            case "unsubscribe":
                with client.lock:
                    client.sent.pop(request.topic, None)
            case "call_service":
                return self._call(request, client)
            case _:
                return _status("warning", f"Operation {request.op!r:.40} does nothing here.", request.id)
        return None

    def _call(self, request: _Request, client: _Client) -> dict[str, Any]:
        about = {"op": "service_response", "id": request.id, "service": request.service}
        try:
            values = self._served(request, client)
        except (FlatclothError, ValueError) as error:
            return {**about, "values": str(error), "result": False}
        return {**about, "values": values, "result": True}

    def _served(self, request: _Request, client: _Client) -> dict[str, Any]:
        match request.service:
            case "/rosapi/topics":
                return {"topics": list(TOPICS), "types": [topic.type for topic in TOPICS.values()]}
            case "/rosapi/services":
                return {"services": [SERVICE]}
            case "/flatcloth/propose_pick":
                pick = msgspec.convert(request.args or {}, ProposedPick)
                return self._answers.propose(pick, client.rotation_deg)
        raise FlatclothError(f"No service {request.service!r:.80}; there is {SERVICE}.")

    def _news(self, client: _Client) -> list[str]:
        """Return the messages of the client's topics whose content has changed since the last."""
        present = self._answers.present(client.rotation_deg)
        if present is None:
            return []
        with client.lock:
            parts = {name: TOPICS[name].part(present) for name in client.sent}
            changed = [name for name, part in parts.items() if part != client.sent[name]]
            client.sent = parts
        return [encoded(self._published(name, present)).decode() for name in changed]

    def _published(self, name: str, present: Shown) -> dict[str, Any]:
        page = self._answers.page
        axis, base = page.integration.axis, page.base_from_camera
        message = TOPICS[name].make(present, frame_of(axis, base, present))
        return {"op": "publish", "topic": name, "msg": message}


def _status(level: str, text: str, about: str | None) -> dict[str, Any]:
    return {"op": "status", "level": level, "msg": text, "id": about}
