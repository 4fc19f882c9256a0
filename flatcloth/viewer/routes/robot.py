"""Routes for robots (docs/robots.md): shape, grasps and proposed picks over HTTP, events over a WebSocket.

For clients of ROS without ROS here there is rosbridge's JSON protocol, version 2 of rosbridge_suite (ROBOTIS
and RobotWebTools, ``ROSBRIDGE_PROTOCOL.md``): topics of the shape, and one service. Messages have the fields
of ROS 2; byte arrays are base64, as rosbridge sends them. Its frames: ``base`` (the robot's, with a hand-eye
transform), ``camera``, and ``object``, which turns with the item. ``/tf`` relates them, and has a frame for
each pick (``pick/1``) and each named point (``cuff_left``).
"""

from __future__ import annotations

import asyncio
import base64
import contextlib
import json
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import msgspec
import numpy as np
from msgspec import structs
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.routing import BaseRoute, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

import flatcloth
from flatcloth.core.errors import FlatclothError
from flatcloth.core.geometry import Rigid3, camera_from_object
from flatcloth.core.types import FlattenedView, RotationAxis
from flatcloth.engine.garment import KnownGarment
from flatcloth.export.data import png_bytes
from flatcloth.export.garment import garment_document
from flatcloth.garments.recognition import NONE
from flatcloth.grasping.grasps import BASE_FROM_CAMERA, quaternion_wxyz
from flatcloth.viewer import http
from flatcloth.viewer.modes.controller import PageController
from flatcloth.viewer.protocol.picture import Picture
from flatcloth.viewer.protocol.robot import (
    PROTOCOL,
    Grasp,
    Hello,
    PickChanged,
    PickDeleted,
    PointsChanged,
    ProposedPick,
    RobotEvent,
    ShapeChanged,
    schema,
)
from flatcloth.viewer.protocol.sent import encoded, typed

_ROTATIONS_KEPT = 16
"""Most rotations for which the poses are kept. Chosen: more than robots listen at once; it bounds memory."""


Events = dict[int | str, RobotEvent]
"""By what they are about: a pick by its number."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Shown:
    """What robots receive: a shape, its ``view``, the document of ``grasps.json`` at one rotation, events."""

    shape: ShapeChanged
    view: FlattenedView
    document: dict[str, Any]
    events: Events


@dataclass
class Client:
    """A client of a socket: the rotation of its poses, and what it was sent last, by what that is about."""

    rotation_deg: float | None = None
    sent: dict[Any, object] = field(default_factory=dict)
    lock: threading.Lock = field(default_factory=threading.Lock)


class RobotAnswers:
    """Answers robots from what the page shows; its methods may take a second, and are safe for threads.

    Parameters
    ----------
    page : PageController
        The page.
    """

    def __init__(self, page: PageController) -> None:
        self.page = page
        self._lock = threading.Lock()
        self._made_of: tuple[Any, ...] = ()
        self._kept: dict[float | None, Shown] = {}

    def shape(self) -> dict[str, Any]:
        """Return the shape with its garment, or the reason why there is none."""
        picture = self.picture()
        known = self.page.garments.known(picture.document)
        about = _shape_of(picture)
        shape = {
            "protocol": PROTOCOL,
            "recording": self.page.integration.recording.name,
            **structs.asdict(about),
        }
        if isinstance(known, str):
            return {**shape, "garment": None, "reason": known}
        sides = None if picture.other is None else picture.other.sides
        return {**shape, "garment": garment_document(known, sides)}

    def propose(self, pick: ProposedPick, rotation_deg: float | None = None) -> dict[str, Any]:
        """Add the pick that a robot proposes, and return its grasp.

        Raises
        ------
        FlatclothError
            If it has no place, or not exactly one, on the shown shape; or another shape is shown.
        """
        self.picture()
        given = [place for place in (pick.uv_m, pick.position_m) if place is not None]
        if len(given) + (pick.point is not None) != 1:
            raise FlatclothError("A pick needs one of point, uv_m and position_m.")
        place = given[0] if given else self._named(str(pick.point))
        number = self.page.propose_pick(place, pick.name or pick.point or "", pick.revision)
        document = self.page.grasps(rotation_deg)
        found = [grasp for grasp in document["grasps"] if grasp["id"] == number]
        if not found:
            raise FlatclothError("The operator deleted this pick.")
        return {"grasp": found[0], **_frames(document)}

    def _named(self, name: str) -> tuple[float, ...]:
        points = {point.name: point for point in self.page.named_points()}
        if name not in points:
            seen = ", ".join(points) or "none"
            raise FlatclothError(f"No view saw a point {name!r:.80}; seen are: {seen}.")
        return tuple(map(float, points[name].position_held_m))

    def events(self, client: Client) -> Iterator[RobotEvent]:
        """Yield the events that a client misses, and note that they are sent."""
        shown = self.present(client.rotation_deg)
        events = None if shown is None else shown.events
        yield from news(client, self.page.integration.recording.name, events)

    def present(self, rotation_deg: float | None) -> Shown | None:
        """Return what the page shows, None before the first shape; kept for all robots until it changes."""
        page = self.page
        picture, known = page.picture, page.garments.last
        if not isinstance(picture, Picture):
            return None
        made_of = picture, page.picks, self.page.integration.axis, dict(page.grips), known
        with self._lock:
            if not _same(self._made_of, made_of) or len(self._kept) >= _ROTATIONS_KEPT:
                self._made_of, self._kept = made_of, {}
            if rotation_deg not in self._kept:
                self._kept[rotation_deg] = self._presented(picture, known, rotation_deg)
            return self._kept[rotation_deg]

    def _presented(self, picture: Picture, known: KnownGarment | None, rotation_deg: float | None) -> Shown:
        """Return what a picture shows; the garment only once the page has recognised it."""
        canonical = picture.sheet.canonical
        if known is not None and not known.is_of(canonical):
            known = None
        grasps = self.page.grasps(rotation_deg, with_garment=known is not None)
        kind = None if known is None or known.found.kind == NONE else known.found.kind
        shape = _shape_of(picture)
        events = events_of(shape, grasps, kind, recognised=known is not None)
        return Shown(shape=shape, view=canonical.view, document=grasps, events=events)

    def picture(self) -> Picture:
        """Return the shown picture.

        Raises
        ------
        FlatclothError
            If nothing is flattened yet.
        """
        picture = self.page.picture
        if not isinstance(picture, Picture):
            raise FlatclothError("Nothing is flattened yet; step first.")
        return picture


def _shape_of(picture: Picture) -> ShapeChanged:
    return ShapeChanged(
        revision=picture.revision,
        views=sorted(picture.document.used_views),
        area_cm2=round(1e4 * picture.sheet.shape_m2, 1),
        rotation_deg=picture.angle_deg,
    )


def events_of(shape: ShapeChanged, document: dict[str, Any], kind: str | None, *, recognised: bool) -> Events:
    """Return the events that tell of a shape; of its named points once its garment is ``recognised``."""
    events: Events = {"shape": shape}
    for grasp in document["grasps"]:
        events[grasp["id"]] = PickChanged(grasp=typed(grasp, Grasp), **_frames(document))
    if recognised:
        points = typed(document["garment_points"], list[Grasp])
        events["points"] = PointsChanged(
            revision=shape.revision, kind=kind, points=points, **_frames(document)
        )
    return events


def news(client: Client, recording: str, events: Events | None) -> Iterator[RobotEvent]:
    """Yield those of the events of what is shown that a client misses, and note that they are sent."""
    hello = Hello(protocol=PROTOCOL, flatcloth=flatcloth.__version__, recording=recording)
    now = {"hello": hello, **(events or {})}
    for about, event in now.items():
        if client.sent.get(about) != event:
            client.sent[about] = event
            yield event
    if events is not None:
        for number in [each for each in client.sent if isinstance(each, int) and each not in now]:
            del client.sent[number]
            yield PickDeleted(id=number)


def _frames(document: dict[str, Any]) -> dict[str, Any]:
    return {"rotation_deg": document["rotation_deg"], BASE_FROM_CAMERA: document[BASE_FROM_CAMERA]}


def _same(before: tuple[Any, ...], now: tuple[Any, ...]) -> bool:
    """Say whether the parts are the same objects; lists and mappings are compared by their content."""
    return len(before) == len(now) and all(
        a == b if isinstance(b, dict | tuple) else a is b for a, b in zip(before, now, strict=True)
    )


POLL_S = 0.1
"""Interval between checks for new events. Chosen."""


def robot_routes(answers: RobotAnswers) -> list[BaseRoute]:
    """Return the routes; they require the page's token, as all others."""

    def pick(request: Request, proposed: ProposedPick) -> dict[str, Any]:
        return answers.propose(proposed, http.rotation_of(request))

    bridge = RosBridge(answers)
    return [
        http.get("/robot/shape", lambda _: answers.shape()),
        http.get("/robot/grasps", lambda request: answers.page.grasps(http.rotation_of(request))),
        http.post("/robot/pick", ProposedPick, pick, hint="See /robot/schema.json."),
        http.get("/robot/schema.json", lambda _: schema()),
        pushed("/robot/events", answers.events),
        pushed("/robot/rosbridge", bridge.news, bridge.answer),
    ]


def pushed(
    path: str,
    news: Callable[[Client], Iterable[object]],
    hear: Callable[[Client, str], object] = lambda _client, _text: None,
) -> WebSocketRoute:
    """Return a route of sockets: a client is sent what is new, as JSON, until it leaves.

    ``hear`` gets its messages, and returns the answer, None: no answer. Both are called on threads.
    """

    async def serve(robot: WebSocket) -> None:
        await robot.accept()
        try:
            client = Client(http.rotation_of(robot))
        except FlatclothError as error:
            await robot.close(1008, str(error))
            return

        async def listen() -> None:
            while (said := await robot.receive())["type"] != "websocket.disconnect":
                answer = await run_in_threadpool(hear, client, said.get("text") or "")
                if answer is not None:
                    await robot.send_text(encoded(answer).decode())

        listening = asyncio.create_task(listen())
        try:
            while not listening.done():
                for event in await run_in_threadpool(lambda: list(news(client))):
                    await robot.send_text(encoded(event).decode())
                await asyncio.wait([listening], timeout=POLL_S)
        except WebSocketDisconnect:
            pass
        finally:
            listening.cancel()
            with contextlib.suppress(asyncio.CancelledError, WebSocketDisconnect):
                await listening

    return WebSocketRoute(path, serve)


# --- rosbridge -------------------------------------------------------------------------------------

OBJECT, CAMERA, BASE = "object", "camera", "base"
Frames = Mapping[str, tuple[str, Rigid3]]
"""The transforms between the frames: each child with its parent, and the child's pose there."""


@dataclass(frozen=True, kw_only=True)
class Topic:
    """A topic: the part of the page that its messages are made of, and what makes one."""

    part: Callable[[Shown], object]
    make: Callable[[Shown, Frames], dict[str, Any]]


def frames_of(axis: RotationAxis, base_from_camera: Rigid3 | None, present: Shown) -> Frames:
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
        part=lambda present: present.document["grasps"],
        make=lambda present, _: _poses(present.document["grasps"]),
    ),
    "/flatcloth/named_points": Topic(
        part=lambda present: present.document["garment_points"],
        make=lambda present, _: _poses(present.document["garment_points"]),
    ),
    "/flatcloth/grasps": Topic(
        part=lambda present: present.document,
        make=lambda present, _: _text(present.document),
    ),
    "/tf": Topic(
        part=lambda present: present.document,
        make=_transforms,
    ),
    "/flatcloth/cloud": Topic(
        part=lambda present: present.shape.revision,
        make=lambda present, _: _cloud(present.view),
    ),
    "/flatcloth/image": Topic(
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


class RosBridge:
    """Answers the clients of ``/robot/rosbridge``."""

    def __init__(self, answers: RobotAnswers) -> None:
        self._answers = answers

    def answer(self, client: Client, text: str) -> dict[str, Any] | None:
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

    def _call(self, request: _Request, client: Client) -> dict[str, Any]:
        about = {"op": "service_response", "id": request.id, "service": request.service}
        try:
            if request.service != SERVICE:
                raise FlatclothError(f"No service {request.service!r:.80}; there is {SERVICE}.")
            pick = msgspec.convert(request.args or {}, ProposedPick)
            values = self._answers.propose(pick, client.rotation_deg)
        except (FlatclothError, ValueError) as error:
            return {**about, "values": str(error), "result": False}
        return {**about, "values": values, "result": True}

    def news(self, client: Client) -> list[dict[str, Any]]:
        """Return the messages of the client's topics whose content has changed since the last."""
        present = self._answers.present(client.rotation_deg)
        if present is None:
            return []
        with client.lock:
            parts = {name: TOPICS[name].part(present) for name in client.sent}
            changed = [name for name, part in parts.items() if part != client.sent[name]]
            client.sent = parts
        page = self._answers.page
        frames = frames_of(page.integration.axis, page.base_from_camera, present)
        return [
            {"op": "publish", "topic": name, "msg": TOPICS[name].make(present, frames)} for name in changed
        ]


def _status(level: str, text: str, about: str | None) -> dict[str, Any]:
    return {"op": "status", "level": level, "msg": text, "id": about}
