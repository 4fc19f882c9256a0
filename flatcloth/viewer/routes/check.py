"""The check of the open recording: what was found, as JSON, and the picture of each finding."""

from __future__ import annotations

import threading
from typing import Any

from starlette.requests import Request
from starlette.routing import BaseRoute

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
            http.get("/check.json", lambda _: self._findings()),
            http.get("/check/{finding:int}.png", self._picture, gone="There is no such finding."),
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

    def _findings(self) -> dict[str, Any]:
        as_recorded = bool(source_options(self._integration.recording).get("as_recorded"))
        check = Check() if as_recorded else self._made()
        return {"as_recorded": as_recorded, **check.to_dict()}

    def _picture(self, request: Request) -> bytes | None:
        number = request.path_params["finding"]
        is_found = number < len(self._made().findings)
        return self._pictures.get(number, lambda: self._drawn(number)) if is_found else None

    def _drawn(self, number: int) -> bytes | None:
        picture = evidence(self._integration.recording, self._made().findings[number])
        return None if picture is None else png_of(picture)
