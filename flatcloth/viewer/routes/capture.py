"""Guided capture over HTTP: a turntable or a robot announces the angles and reads the status.

``GET /capture`` returns the status; ``POST /capture/angle`` with ``{"angle_deg": 20.0}`` announces the item's
present angle, since view 0. ``POST /capture/begin``, ``keep``, ``repeat`` and ``finish`` act like the buttons
of the page. Every answer is the status as JSON, or ``{"error": reason}`` with code 400 (malformed), 404 (no
such address), 409 (not allowed now) or 503 (the camera has ended).
"""

from __future__ import annotations

from typing import Annotated

import msgspec
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route

from flatcloth.rendering.layers import LAYERS
from flatcloth.viewer.http import RefusedError, as_json, get, read_json
from flatcloth.viewer.modes.capture import CaptureApplication
from flatcloth.viewer.protocol.messages import MAX_ANGLE_DEG

MAX_BODY_BYTES = 10_000
"""Limit of a request's body. Chosen: far above what the page sends."""
_WANTED = 'Send {"angle_deg": 20.0}, and "keep": false if an operator decides.'
_ACTIONS = {"angle": "announce", "begin": "begin", "keep": "keep", "repeat": "repeat", "finish": "finish"}


def capture_routes(captures: CaptureApplication) -> list[BaseRoute]:
    """Return the routes of a guided capture."""

    def view(_request: Request) -> bytes:
        if not captures.view_png:
            raise RefusedError("No view has been taken yet.", 404)
        return captures.view_png

    def frame(request: Request) -> bytes | None:
        layer, after = request.path_params["layer"], request.path_params["after"]
        if layer not in LAYERS:
            raise RefusedError(f"Unknown layer {layer!r:.40}; choose one of {', '.join(LAYERS)}.", 404)
        return captures.frame_after(after, layer)

    async def hear(request: Request) -> Response:
        word = request.path_params["action"]
        if word not in _ACTIONS:
            known = ", ".join(_ACTIONS)
            raise RefusedError(f"Unknown address /capture/{word:.40}; choose one of {known}.", 404)
        angle_deg, keeps_itself = None, False
        if word == "angle":
            said = await read_json(request, _Announcement, MAX_BODY_BYTES, _WANTED)
            angle_deg, keeps_itself = said.angle_deg, said.keep
        await run_in_threadpool(captures.act, _ACTIONS[word], angle_deg, keeps_itself)
        captures.announce()
        return as_json(await run_in_threadpool(captures.status))

    return [
        get("/capture", lambda _: captures.status()),
        get("/capture/view.png", view),
        get("/capture/frame/{after:int}/{layer}", frame, "application/octet-stream", gone=None),
        Route("/capture/{action}", hear, methods=["POST"]),
    ]


class _Announcement(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The body of ``POST /capture/angle``; without ``keep`` the view is kept automatically."""

    angle_deg: Annotated[float, msgspec.Meta(ge=-MAX_ANGLE_DEG, le=MAX_ANGLE_DEG)]
    keep: bool = True
