"""The check of the open recording: what was found, as JSON, and the picture of each finding."""

from __future__ import annotations

import threading
from typing import Any

from starlette.requests import Request
from starlette.routing import BaseRoute

from flatcloth.checking.check import checked
from flatcloth.checking.findings import Check
from flatcloth.core.cache import Cache
from flatcloth.engine.warmup import wait_until_compiled
from flatcloth.recordings.base import source_options
from flatcloth.rendering.drawing import png_of
from flatcloth.rendering.evidence import evidence
from flatcloth.viewer import http
from flatcloth.viewer.modes.controller import PageController

PICTURES_KEPT = 8
"""Pictures that are kept. Chosen: more findings at once are rare."""


def check_routes(page: PageController) -> list[BaseRoute]:
    """Return ``GET /check.json`` and ``GET /check/{finding}.png``; the first request makes the check."""
    recording, views = page.integration.recording, page.integration.views
    pictures: Cache[bytes | None] = Cache(PICTURES_KEPT)

    one_at_a_time = threading.Lock()

    def made() -> Check:
        with one_at_a_time:
            wait_until_compiled()
            return checked(recording, views.recorded)

    def findings(_request: Request) -> dict[str, Any]:
        as_recorded = bool(source_options(recording).get("as_recorded"))
        check = Check() if as_recorded else made()
        return {"as_recorded": as_recorded, **check.to_dict()}

    def picture(request: Request) -> bytes | None:
        number, found = request.path_params["finding"], made().findings

        def drawn() -> bytes | None:
            image = evidence(recording, found[number])
            return None if image is None else png_of(image)

        return pictures.get((number, found), drawn) if number < len(found) else None

    return [
        http.get("/check.json", findings),
        http.get("/check/{finding:int}.png", picture, gone="There is no such finding."),
    ]
