"""Routes for robots: shape and grasps over HTTP, new picks over a WebSocket (docs/robots.md)."""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import Awaitable, Callable
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from flatcloth.core.errors import FlatclothError
from flatcloth.core.geometry import Rigid3
from flatcloth.engine.integration import Integration
from flatcloth.export.garment import garment_document
from flatcloth.grasping.hand_eye import KEY as BASE_FROM_CAMERA
from flatcloth.session.document import Document
from flatcloth.viewer import http
from flatcloth.viewer.modes.controller import PageController
from flatcloth.viewer.protocol.picture import Picture

_POLL_S = 0.1
"""Interval between checks for a new selection. Chosen."""


class RobotRoutes:
    """Answers robots; these routes require the page's token, as all others.

    Parameters
    ----------
    application : PageController
        The application of the page.
    integration : Integration
        Computes its shapes.
    base_from_camera : Rigid3, optional
        The hand-eye transform; with it, poses are also given in the frame of the robot.
    """

    def __init__(
        self, application: PageController, integration: Integration, base_from_camera: Rigid3 | None = None
    ) -> None:
        self._application, self._integration = application, integration
        self._base_from_camera = base_from_camera
        self._lock = threading.Lock()
        self._made_of: tuple[Any, ...] = ()
        self._messages: dict[int, str] = {}

    def routes(self) -> list[BaseRoute]:
        """Return the routes."""
        return [
            Route("/robot/shape", self._answering(self._shape)),
            Route("/robot/grasps", self._answering(self._grasps)),
            WebSocketRoute("/robot/picks", self._picks),
        ]

    def _answering(self, make: Callable[[], Any]) -> Callable[[Request], Awaitable[Response]]:
        async def answer(_request: Request) -> Response:
            return await http.made(make)

        return answer

    def _picture(self) -> tuple[Picture, Document]:
        """Return the shown picture, and its document."""
        picture = self._application.picture
        if picture is None or picture.document is None:
            raise FlatclothError("Nothing is flattened yet; step first.")
        return picture, picture.document

    def _shape(self) -> dict[str, Any]:
        picture, document = self._picture()
        known = self._application.garments.known(document)
        area_m2 = picture.view.area_m2 if picture.sheet is None else picture.sheet.shape_m2
        shape: dict[str, Any] = {
            "recording": self._integration.recording.name,
            "views": sorted(document.used_views),
            "area_cm2": round(1e4 * area_m2, 1),
            "rotation_deg": picture.angle_deg,
        }
        if isinstance(known, str):
            return {**shape, "garment": None, "reason": known}
        return {**shape, "garment": garment_document(known)}

    def _grasps(self, *, with_garment: bool = True) -> dict[str, Any]:
        self._picture()  # refused while nothing is flattened
        return self._application.grasps(self._base_from_camera, with_garment=with_garment)

    async def _picks(self, robot: WebSocket) -> None:
        """Send the existing picks as messages, and then every pick that is made or changed."""
        await robot.accept()
        sent: dict[int, str] = {}
        gone = asyncio.create_task(_disconnected(robot))
        try:
            while not gone.done():
                for pick_id, text in (await run_in_threadpool(self._texts)).items():
                    if sent.get(pick_id) != text:
                        await robot.send_text(text)
                        sent[pick_id] = text
                await asyncio.wait([gone], timeout=_POLL_S)
        except WebSocketDisconnect:
            pass
        finally:
            gone.cancel()

    def _texts(self) -> dict[int, str]:
        """Return the messages about all picks; they are cached for all robots until a pick changes."""
        page = self._application
        made_of = page.picture, page.picks, self._integration.axis, dict(page.grips)
        with self._lock:
            *parts, grips = self._made_of or (None,) * len(made_of)
            if grips != made_of[-1] or any(a is not b for a, b in zip(parts, made_of, strict=False)):
                self._messages = self._computed()
                self._made_of = made_of
            return self._messages

    def _computed(self) -> dict[int, str]:
        try:
            document = self._grasps(with_garment=False)
        except FlatclothError:
            return {}  # nothing is flattened yet
        return {
            grasp["id"]: json.dumps({"grasp": grasp, BASE_FROM_CAMERA: document[BASE_FROM_CAMERA]})
            for grasp in document["grasps"]
        }


async def _disconnected(robot: WebSocket) -> None:
    """Return when a robot has left; its messages are ignored."""
    while (await robot.receive())["type"] != "websocket.disconnect":
        pass
