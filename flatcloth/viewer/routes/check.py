"""The check of the open recording: what was found, as JSON, and the picture of each finding."""

from __future__ import annotations

import threading
from typing import Any

from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route

from flatcloth.checking.check import checked
from flatcloth.checking.findings import Check
from flatcloth.core.cache import Cache
from flatcloth.engine.integration import Integration
from flatcloth.engine.warmup import wait_until_compiled
from flatcloth.recordings.base import source_options
from flatcloth.rendering.drawing import png_of
from flatcloth.rendering.evidence import evidence
from flatcloth.viewer import http

PICTURES_KEPT = 8
"""Pictures that are kept. Chosen: more findings at once are rare."""


class CheckRoutes:
    """Answers ``GET /check.json`` and ``GET /check/{finding}.png``; the first request makes the check."""

    def __init__(self, integration: Integration) -> None:
        self._integration = integration
        self._lock = threading.Lock()
        self._check: Check | None = None
        self._pictures: Cache[bytes | None] = Cache(PICTURES_KEPT)

    def routes(self) -> list[BaseRoute]:
        """Return the routes of this object."""
        return [
            Route("/check.json", self._findings),
            Route("/check/{finding:int}.png", self._picture),
        ]

    def _made(self) -> Check:
        with self._lock:
            wait_until_compiled()
            views = self._integration.views
            check = checked(self._integration.recording, views.recorded)
            if check is not self._check:
                self._check = check
                self._pictures = Cache(PICTURES_KEPT)
            return check

    async def _findings(self, _request: Request) -> Response:
        def make() -> dict[str, Any]:
            recording = self._integration.recording
            as_recorded = bool(source_options(recording).get("as_recorded"))
            check = Check() if as_recorded else self._made()
            return {"as_recorded": as_recorded, **check.to_dict()}

        return await http.made(make)

    async def _picture(self, request: Request) -> Response:
        number = request.path_params["finding"]

        def make() -> bytes | None:
            findings = self._made().findings
            return self._pictures.get(number, lambda: self._drawn(number)) if number < len(findings) else None

        return await http.made(make, gone="There is no such finding.")

    def _drawn(self, number: int) -> bytes | None:
        picture = evidence(self._integration.recording, self._made().findings[number])
        return None if picture is None else png_of(picture)
