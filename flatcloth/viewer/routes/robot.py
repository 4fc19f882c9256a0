"""Routes for robots: shape, grasps and proposed picks over HTTP, events over a WebSocket (docs/robots.md)."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Callable, Iterable

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


def robot_routes(answers: RobotAnswers) -> list[BaseRoute]:
    """Return the routes; they require the page's token, as all others."""

    async def pick(request: Request) -> Response:
        rotation_deg = http.rotation_of(request)
        try:
            body = await http.read_body(request, MAX_BODY_BYTES)
        except ValueError as error:
            raise http.RefusedError(str(error), 400) from error
        try:
            proposed = msgspec.json.decode(body, type=ProposedPick)
        except (ValueError, RecursionError) as error:
            reason = f"The body is not as /robot/schema.json has it: {error}."
            raise http.RefusedError(reason, 400) from error
        return http.as_json(await run_in_threadpool(answers.propose, proposed, rotation_deg))

    return [
        http.get("/robot/shape", lambda _: answers.shape()),
        http.get("/robot/grasps", lambda request: answers.grasps(http.rotation_of(request))),
        Route("/robot/pick", pick, methods=["POST"]),
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
