"""Routes of an active loop: a robot asks for the next angle, turns, and announces or sends the view.

Without a page, results are also sent over the WebSocket that a page has (docs/robots.md).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route

from flatcloth.active.service import ActiveService
from flatcloth.core.errors import RecordingError
from flatcloth.viewer import http
from flatcloth.viewer.protocol.robot import PostedView, RobotEvent, ShapeChanged
from flatcloth.viewer.routes.robot import Shown, Told, news

MAX_BODY_BYTES = 32 * 2**20
"""Limit of a view's body. Chosen: raw color and depth of 1920 x 1080 pixels take 14 MB in base64."""


def active_routes(
    service: ActiveService, on_answer: Callable[[dict[str, Any]], object] = lambda _: None
) -> list[BaseRoute]:
    """Return the routes; ``on_answer`` is called with each answer before it is sent."""

    async def answered(make: Callable[[], dict[str, Any]]) -> Response:
        answer = await run_in_threadpool(make)
        on_answer(answer)
        return http.as_json(answer)

    async def following(request: Request) -> Response:
        rotation_deg = http.rotation_of(request)
        return await answered(lambda: service.next(rotation_deg))

    async def view(request: Request) -> Response:
        rotation_deg = http.rotation_of(request)
        posted = await http.read_json(request, PostedView, MAX_BODY_BYTES)
        try:
            seen = await run_in_threadpool(posted.view) if posted.has_images else None
        except (ValueError, RecordingError) as error:
            raise http.RefusedError(f"The view was not read: {error}", 400) from error
        if seen is None:
            return await answered(lambda: service.look(posted.angle_deg, posted.number, rotation_deg))
        return await answered(lambda: service.take(seen, posted.number, rotation_deg))

    return [Route("/robot/next", following), Route("/robot/view", view, methods=["POST"])]


def loop_events(service: ActiveService) -> Callable[[Told], Iterator[RobotEvent]]:
    """Return the generator of a loop's events without a page: its shape, and the named points."""
    loop = service.loop

    def events(told: Told) -> Iterator[RobotEvent]:
        with loop.lock:
            shown, document = None, service.document(told.rotation_deg)
            if document is not None:
                shape = ShapeChanged(
                    revision=loop.views,
                    views=sorted(loop.document.used_views),
                    area_cm2=round(1e4 * loop.knowledge.area_m2, 1),
                    rotation_deg=loop.stands_deg,
                )
                is_recognised = not isinstance(loop.known, str)
                kind = loop.knowledge.kind
                shown = Shown(shape=shape, document=document, is_recognised=is_recognised, kind=kind)
        yield from news(told, loop.name, shown)

    return events
