"""The source that the page shows: one session or camera, with its scene and its routes."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import msgspec
import websockets
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import Route, Router, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect
from websockets.asyncio.client import ClientConnection, unix_connect
from websockets.typing import Subprotocol

from flatcloth.core.errors import FlatclothError, ServerError
from flatcloth.core.geometry import Rigid3
from flatcloth.engine.integration import Integration
from flatcloth.grasping.hand_eye import hand_eye_from
from flatcloth.recordings import SourceOptions
from flatcloth.recordings.base import source_options
from flatcloth.recordings.mending import Mends
from flatcloth.session.store import SessionFolder
from flatcloth.viewer.http import post, rotation_of
from flatcloth.viewer.hub import Hub, Tab
from flatcloth.viewer.modes.controller import PageController
from flatcloth.viewer.modes.session import Application
from flatcloth.viewer.modes.teaching import TeachingRoutes
from flatcloth.viewer.places import Chosen
from flatcloth.viewer.protocol import messages
from flatcloth.viewer.protocol.sent import encoded
from flatcloth.viewer.routes.exports import ExportRoutes
from flatcloth.viewer.routes.layers import check_routes, layer_routes, source_routes
from flatcloth.viewer.routes.robot import RobotAnswers, robot_routes
from flatcloth.viewer.scene.scene import Scene

_HAND_EYE = "Choose a hand-eye file (docs/grasps.md)."
_SWAMPED_S = 0.05
"""Interval between checks whether an overloaded page can take messages again. Chosen."""


@dataclass(frozen=True, eq=False)
class Opened:
    """A source that was opened for the page.

    Parameters
    ----------
    integration, folder
        The session.
    controller : callable, optional
        Makes the application of another mode, such as a camera's, given the 3D side and the tabs.
    base_from_camera : Rigid3, optional
        Hand-eye transform, for poses in the frame of a robot (docs/robots.md).
    close : callable
        Closes the session and its source.
    """

    integration: Integration
    folder: SessionFolder
    controller: Callable[[Scene, Hub], PageController] | None = None
    base_from_camera: Rigid3 | None = None
    close: Callable[[], object] = lambda: None


class Workspace:
    """Shows an opened source; ``router`` answers the requests about it."""

    def __init__(self, opened: Opened) -> None:
        self._opened, self.integration = opened, opened.integration
        self.scene, self.hub = Scene(opened.integration), Hub()
        controller = opened.controller or partial(Application, opened.integration, opened.folder)
        page: PageController = controller(self.scene, self.hub)
        self.application, self.scene.on_ray = page, page.click_ray
        page.base_from_camera = opened.base_from_camera
        self.exports = ExportRoutes(page)
        self.router = Router(
            redirect_slashes=False,  # they would name the host that a proxy has set
            routes=[
                *layer_routes(page),
                *source_routes(page),
                *check_routes(page),
                Route("/export/grasps.json", self._grasps),
                post("/hand-eye", msgspec.Raw, self._take_hand_eye, hint=_HAND_EYE),
                Route("/export/{name}", self.exports.serve),
                Route("/teaching/{part}", TeachingRoutes(page).serve),
                *page.routes(),
                *robot_routes(RobotAnswers(page)),
                WebSocketRoute("/ws", self._messages),
                Route("/ws", _no_socket, methods=["GET", "POST"]),
                WebSocketRoute("/viser", lambda browser: relay(browser, lambda: self.scene.path)),
            ],
        )

    def mended(self, mends: Mends) -> Chosen:
        """Return the open recording as a place to open, with more mends.

        Raises
        ------
        FlatclothError
            If it is a camera.
        """
        recording = self.integration.recording
        if self.application.has_camera:
            raise FlatclothError("A camera has no mends; open the recording that was captured.")
        options = SourceOptions.from_dict(source_options(recording), "the session")
        more = (options.mends or Mends()).then(mends)
        return Chosen("folder", recording.location, options=replace(options, mends=more))

    def start(self, loop: asyncio.AbstractEventLoop) -> None:
        """Start the threads, and serve on this event loop."""
        self.hub.open(loop)
        self.application.start()

    def stop(self) -> None:
        """Stop the threads; close the scene and the source."""
        self.application.stop()
        self.hub.close()
        self.scene.stop()
        self._opened.close()

    async def _messages(self, browser: WebSocket) -> None:
        async def receive(key: int, tab: Tab, text: str) -> None:
            message = messages.parsed(text)
            # What is under the pointer waits for nobody: it only takes a look at the present picture.
            if isinstance(message, messages.Hover | messages.HoverRay):
                tab.put(encoded(self.application.pointed_at(message)).decode())
                return
            while self.application.is_swamped:  # until then, no further message of this tab is read
                await asyncio.sleep(_SWAMPED_S)
            self.application.receive(key, message)

        await self.hub.serve(browser, self.application.last_state, receive)

    async def _grasps(self, request: Request) -> Response:
        headers = {"Content-Disposition": 'attachment; filename="grasps.json"'}
        grasps = await run_in_threadpool(self.application.grasps, rotation_of(request))
        return JSONResponse(grasps, headers=headers)

    def _take_hand_eye(self, _request: Request, file: msgspec.Raw) -> dict[str, bool]:
        """Take the content of a hand-eye file; poses are in the robot's frame from now on, until the end."""
        self.application.base_from_camera = hand_eye_from(bytes(file), Path("hand-eye file"))
        return {"taken": True}


async def _no_socket(_request: Request) -> Response:
    """Tell the page, which asks this way when its socket is refused, that requests do come through."""
    return PlainTextResponse(
        "The proxy does not pass on WebSockets: it must forward the headers Upgrade and Connection"
        " (docs/security.md has the lines for nginx).",
        status_code=426,
        headers={"Upgrade": "websocket"},
    )


# --- viser's socket, through our port -------------------------------------------------------------


async def relay(browser: WebSocket, path: Callable[[], Path]) -> None:
    """Connect a browser's socket with viser's, a socket file, until either closes.

    The sub-protocol (viser's version) is passed on unchanged; nothing is compressed, and viser's
    messages have no size limit, because point clouds are neither small nor compressible.
    """
    wanted = [Subprotocol(p) for p in browser.scope.get("subprotocols", [])]
    try:
        viser = await unix_connect(
            str(await run_in_threadpool(path)),
            uri="ws://localhost/",
            subprotocols=wanted or None,
            compression=None,
            max_size=None,
        )
    except (OSError, ServerError, websockets.WebSocketException):
        await browser.close(1013, "the 3D scene is not running")
        return
    await browser.accept(subprotocol=viser.subprotocol)
    tasks = [
        asyncio.create_task(_from_browser(browser, viser)),
        asyncio.create_task(_from_viser(browser, viser)),
    ]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        await viser.close()


async def _from_browser(browser: WebSocket, viser: ClientConnection) -> None:
    try:
        while True:
            message = await browser.receive()
            if message["type"] == "websocket.disconnect":
                return
            data = message.get("bytes")
            await viser.send(message["text"] if data is None else data)
    except (WebSocketDisconnect, websockets.ConnectionClosed, RuntimeError):
        return


async def _from_viser(browser: WebSocket, viser: ClientConnection) -> None:
    try:
        async for data in viser:
            if isinstance(data, str):
                await browser.send_text(data)
            else:
                await browser.send_bytes(data)
        await browser.close(1012, "the 3D scene has closed")
    except (WebSocketDisconnect, websockets.ConnectionClosed, RuntimeError):
        return
