"""Routes for robots: shape, grasps and proposed picks over HTTP, events over a WebSocket (docs/robots.md)."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Callable, Iterable
from typing import Any, TypeVar

import msgspec
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from flatcloth.core.errors import FlatclothError
from flatcloth.viewer import http
from flatcloth.viewer.protocol.robot import ProposedPick, RobotEvent, schema
from flatcloth.viewer.protocol.sent import encoded
from flatcloth.viewer.routes.robot_answers import RobotAnswers, Told

POLL_S = 0.1
"""Interval between checks for new events. Chosen."""
MAX_BODY_BYTES = 10_000
"""Limit of a request's body, as for ``/capture``. Chosen: far above what a pick takes."""

T = TypeVar("T")


def robot_routes(answers: RobotAnswers) -> list[BaseRoute]:
    """Return the routes; they require the page's token, as all others."""

    async def shape(_request: Request) -> Response:
        return await answered(answers.shape)

    async def grasps(_request: Request, rotation_deg: float | None) -> Response:
        return await answered(lambda: answers.grasps(rotation_deg))

    async def pick(request: Request, rotation_deg: float | None) -> Response:
        try:
            proposed = await body_of(request, ProposedPick)
        except ValueError as error:
            return http.refused(str(error), 400)
        return await answered(lambda: answers.propose(proposed, rotation_deg))

    async def protocol(_request: Request) -> Response:
        return http.as_json(schema())

    return [
        Route("/robot/shape", shape),
        Route("/robot/grasps", with_rotation(grasps)),
        Route("/robot/pick", with_rotation(pick), methods=["POST"]),
        Route("/robot/schema.json", protocol),
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


async def answered(make: Callable[[], Any]) -> Response:
    """Answer with what ``make`` returns on a thread, as JSON; with its reason (409) if there is nothing."""
    try:
        return http.as_json(await run_in_threadpool(make))
    except FlatclothError as error:
        return http.refused(str(error), 409)


def with_rotation(
    answer: Callable[[Request, float | None], Awaitable[Response]],
) -> Callable[[Request], Awaitable[Response]]:
    """Return a route that is given ``?rotation=`` in degrees, or None; 400 if it is no angle."""

    async def route(request: Request) -> Response:
        try:
            rotation_deg = http.rotation_of(request)
        except FlatclothError as error:
            return http.refused(str(error), 400)
        return await answer(request, rotation_deg)

    return route


async def body_of(request: Request, kind: type[T]) -> T:
    """Return the body of a request as a struct.

    Raises
    ------
    ValueError
        If it is too long, no JSON, or has other fields; the message says which.
    """
    body = await http.read_body(request, MAX_BODY_BYTES)
    try:
        return msgspec.json.decode(body, type=kind)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"The body is not as /robot/schema.json has it: {error}.") from error


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
