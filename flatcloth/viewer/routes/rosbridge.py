"""rosbridge's JSON protocol, for clients of ROS without ROS here: topics of the shape, and one service.

The protocol is version 2 of rosbridge_suite (ROBOTIS and RobotWebTools, ``ROSBRIDGE_PROTOCOL.md``), of which
``subscribe``, ``unsubscribe`` and ``call_service`` are answered. Messages have the fields of ROS 2; byte
arrays are base64, as rosbridge sends them.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from typing import Any

import msgspec
from starlette.concurrency import run_in_threadpool
from starlette.websockets import WebSocket

from flatcloth.core.errors import FlatclothError
from flatcloth.viewer import http
from flatcloth.viewer.protocol.robot import ProposedPick
from flatcloth.viewer.protocol.sent import encoded
from flatcloth.viewer.routes.robot import MAX_BODY_BYTES, push
from flatcloth.viewer.routes.robot_answers import Present, RobotAnswers
from flatcloth.viewer.routes.ros_messages import TOPICS, frame_of

SERVICE = "/flatcloth/propose_pick"


class _Request(msgspec.Struct, frozen=True, kw_only=True):
    """An operation of a client; fields of other operations are ignored."""

    op: str
    id: str | None = None
    topic: str = ""
    service: str = ""
    args: Any = None


@dataclass
class _Client:
    """A connected client: its topics, each with the part of the page that it was sent of last."""

    rotation_deg: float | None
    sent: dict[str, object] = field(default_factory=dict)
    lock: threading.Lock = field(default_factory=threading.Lock)


class RosBridge:
    """Answers the clients of ``/robot/rosbridge``."""

    def __init__(self, answers: RobotAnswers) -> None:
        self._answers = answers

    async def serve(self, socket: WebSocket) -> None:
        """Serve one client until it leaves."""
        await socket.accept()
        try:
            client = _Client(http.rotation_of(socket))
        except FlatclothError as error:
            await socket.close(1008, str(error))
            return

        async def hear(text: str) -> None:
            answer = await run_in_threadpool(self._answer, text, client)
            if answer is not None:
                await socket.send_text(encoded(answer).decode())

        await push(socket, lambda: self._news(client), hear)

    def _answer(self, text: str, client: _Client) -> dict[str, Any] | None:
        """Carry out an operation; return the answer to the client, None: no answer."""
        try:
            if len(text) > MAX_BODY_BYTES:
                raise ValueError(f"it is longer than {MAX_BODY_BYTES} characters")
            request = msgspec.json.decode(text, type=_Request)
        except (ValueError, RecursionError) as error:
            return _status("error", f"The message is not one of rosbridge: {error}.", None)
        match request.op:
            case "subscribe" if request.topic in TOPICS:
                with client.lock:
                    client.sent[request.topic] = None
            case "subscribe":
                known = ", ".join(TOPICS)
                return _status("error", f"No topic {request.topic!r:.80}; there are {known}.", request.id)
            case "unsubscribe":
                with client.lock:
                    client.sent.pop(request.topic, None)
            case "call_service":
                return self._call(request, client)
            case _:
                return _status("warning", f"Operation {request.op!r:.40} does nothing here.", request.id)
        return None

    def _call(self, request: _Request, client: _Client) -> dict[str, Any]:
        about = {"op": "service_response", "id": request.id, "service": request.service}
        try:
            values = self._served(request, client)
        except (FlatclothError, ValueError) as error:
            return {**about, "values": str(error), "result": False}
        return {**about, "values": values, "result": True}

    def _served(self, request: _Request, client: _Client) -> dict[str, Any]:
        match request.service:
            case "/rosapi/topics":
                return {"topics": list(TOPICS), "types": [topic.type for topic in TOPICS.values()]}
            case "/rosapi/services":
                return {"services": [SERVICE]}
            case "/flatcloth/propose_pick":
                pick = msgspec.convert(request.args or {}, ProposedPick)
                return self._answers.propose(pick, client.rotation_deg)
        raise FlatclothError(f"No service {request.service!r:.80}; there is {SERVICE}.")

    def _news(self, client: _Client) -> list[str]:
        """Return the messages of the client's topics whose content has changed since the last."""
        present = self._answers.present(client.rotation_deg)
        if present is None:
            return []
        with client.lock:
            parts = {name: TOPICS[name].part(present) for name in client.sent}
            changed = [name for name, part in parts.items() if part != client.sent[name]]
            client.sent = parts
        return [encoded(self._published(name, present)).decode() for name in changed]

    def _published(self, name: str, present: Present) -> dict[str, Any]:
        axis, base = self._answers.page.integration.axis, self._answers.base_from_camera
        message = TOPICS[name].make(present, frame_of(axis, base, present))
        return {"op": "publish", "topic": name, "msg": message}


def _status(level: str, text: str, about: str | None) -> dict[str, Any]:
    return {"op": "status", "level": level, "msg": text, "id": about}
