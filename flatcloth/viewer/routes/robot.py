"""Routes for robots: shape, grasps and proposed picks over HTTP, events over a WebSocket (docs/robots.md)."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections.abc import Awaitable, Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from msgspec import structs
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.routing import BaseRoute, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

import flatcloth
from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import FlattenedView
from flatcloth.engine.garment import KnownGarment
from flatcloth.export.garment import garment_document
from flatcloth.garments.recognition import NONE
from flatcloth.grasping.grasps import BASE_FROM_CAMERA
from flatcloth.session.document import Document
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
class Told:
    """The events that one client received last; those that it misses follow from them."""

    rotation_deg: float | None = None
    events: Events = field(default_factory=dict)


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
        picture, document = self.picture()
        known = self.page.garments.known(document)
        about = self._shape_of(picture, document)
        shape = {
            "protocol": PROTOCOL,
            "recording": self.page.integration.recording.name,
            **structs.asdict(about),
        }
        if isinstance(known, str):
            return {**shape, "garment": None, "reason": known}
        sides = None if picture.other is None else picture.other.sides
        return {**shape, "garment": garment_document(known, sides)}

    def grasps(self, rotation_deg: float | None = None) -> dict[str, Any]:
        """Return the document of ``grasps.json`` at a rotation, by default that of the shown view."""
        self.picture()  # refused while nothing is flattened
        return self.page.grasps(rotation_deg)

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
        document = self.grasps(rotation_deg)
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

    def events(self, told: Told) -> Iterator[RobotEvent]:
        """Yield the events that a client misses, and note that they are sent."""
        shown = self.present(told.rotation_deg)
        events = None if shown is None else shown.events
        yield from news(told, self.page.integration.recording.name, events)

    def present(self, rotation_deg: float | None) -> Shown | None:
        """Return what the page shows, None before the first shape; kept for all robots until it changes."""
        page = self.page
        picture, known = page.picture, page.garments.last
        if picture is None or picture.document is None:
            return None
        made_of = picture, page.picks, self.page.integration.axis, dict(page.grips), known
        with self._lock:
            if not _same(self._made_of, made_of) or len(self._kept) >= _ROTATIONS_KEPT:
                self._made_of, self._kept = made_of, {}
            if rotation_deg not in self._kept:
                self._kept[rotation_deg] = self._presented(picture, picture.document, known, rotation_deg)
            return self._kept[rotation_deg]

    def _presented(
        self, picture: Picture, document: Document, known: KnownGarment | None, rotation_deg: float | None
    ) -> Shown:
        """Return what a picture shows; the garment only once the page has recognised it."""
        canonical = None if picture.sheet is None else picture.sheet.canonical
        if known is not None and (canonical is None or not known.is_of(canonical)):
            known = None
        grasps = self.page.grasps(rotation_deg, with_garment=known is not None)
        kind = None if known is None or known.found.kind == NONE else known.found.kind
        shape, view = self._shape_of(picture, document), picture.pieces("this")[0]
        events = events_of(shape, grasps, kind, recognised=known is not None)
        return Shown(shape=shape, view=view, document=grasps, events=events)

    def picture(self) -> tuple[Picture, Document]:
        """Return the shown picture, and its document.

        Raises
        ------
        FlatclothError
            If nothing is flattened yet.
        """
        picture = self.page.picture
        if picture is None or picture.document is None:
            raise FlatclothError("Nothing is flattened yet; step first.")
        return picture, picture.document

    def _shape_of(self, picture: Picture, document: Document) -> ShapeChanged:
        area_m2 = picture.view.area_m2 if picture.sheet is None else picture.sheet.shape_m2
        return ShapeChanged(
            revision=picture.revision,
            views=sorted(document.used_views),
            area_cm2=round(1e4 * area_m2, 1),
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


def news(told: Told, recording: str, events: Events | None) -> Iterator[RobotEvent]:
    """Yield those of the events of what is shown that a client misses, and note that they are sent."""
    hello = Hello(protocol=PROTOCOL, flatcloth=flatcloth.__version__, recording=recording)
    now = {"hello": hello, **(events or {})}
    for about, event in now.items():
        if told.events.get(about) != event:
            told.events[about] = event
            yield event
    if events is not None:
        for number in [each for each in told.events if isinstance(each, int) and each not in now]:
            del told.events[number]
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

    return [
        http.get("/robot/shape", lambda _: answers.shape()),
        http.get("/robot/grasps", lambda request: answers.grasps(http.rotation_of(request))),
        http.post("/robot/pick", ProposedPick, pick, hint="See /robot/schema.json."),
        http.get("/robot/schema.json", lambda _: schema()),
        events_route(answers.events),
    ]


def events_route(events: Callable[[Told], Iterable[RobotEvent]]) -> WebSocketRoute:
    """Return the route that pushes the events that a client has not received yet."""

    async def serve(robot: WebSocket) -> None:
        await robot.accept()
        try:
            told = Told(rotation_deg=http.rotation_of(robot))
        except FlatclothError as error:
            await robot.close(1008, str(error))
            return
        await push(robot, lambda: [encoded(event).decode() for event in events(told)])

    return WebSocketRoute("/robot/events", serve)


async def push(
    robot: WebSocket, news: Callable[[], list[str]], hear: Callable[[str], Awaitable[None]] | None = None
) -> None:
    """Send what is new until the client leaves; ``hear`` is called with each of its messages."""

    async def listen() -> None:
        while (said := await robot.receive())["type"] != "websocket.disconnect":
            if hear is not None:
                await hear(said.get("text") or "")

    listening = asyncio.create_task(listen())
    try:
        while not listening.done():
            for text in await run_in_threadpool(news):
                await robot.send_text(text)
            await asyncio.wait([listening], timeout=POLL_S)
    except WebSocketDisconnect:
        pass
    finally:
        listening.cancel()
        with contextlib.suppress(asyncio.CancelledError, WebSocketDisconnect):
            await listening
