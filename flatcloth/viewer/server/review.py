"""Serve the page of a batch: store verdicts, and open a session in the operator page on a click."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import msgspec
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.routing import Route

from flatcloth.batch.report import decide, report_html, view_arguments
from flatcloth.batch.rows import is_result_name, read_row
from flatcloth.core.errors import FlatclothError
from flatcloth.viewer.http import REFUSALS, RefusedError, read_json
from flatcloth.viewer.server.app import serve_app
from flatcloth.viewer.server.guard import given_token, kept_token

HOST = "127.0.0.1"
SESSIONS_OPEN = 2
"""Largest number of open operator pages: each takes about half a gigabyte."""
_START_S = 90.0
"""Time limit for the start of an operator page. Chosen."""
_MOST_BODY_BYTES = 10_000
"""Largest body of a request. Chosen: far above those of the page."""
_LAUNCH = "from flatcloth.cli import run_and_exit; run_and_exit()"


class SessionPages:
    """The operator pages opened from a review. Each is a process; the oldest is ended first."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._open: OrderedDict[str, tuple[subprocess.Popen[str], str]] = OrderedDict()

    def address(self, name: str, arguments: list[str]) -> str:
        """Return the address of a session's page, which is started if it is not open.

        Raises
        ------
        FlatclothError
            If it cannot be started; the text is the output of its process.
        """
        with self._lock:
            if name in self._open and self._open[name][0].poll() is None:
                self._open.move_to_end(name)
                return self._open[name][1]
            self._open.pop(name, None)
            while len(self._open) >= SESSIONS_OPEN:
                _end(self._open.popitem(last=False)[1][0])
            process = subprocess.Popen(
                [sys.executable, "-c", _LAUNCH, "view", *arguments, "--port", "0"],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                start_new_session=True,  # Ctrl-C is for this process, which ends it
            )
            try:
                url = _address_said(process)
            except BaseException:
                _end(process)
                raise
            self._open[name] = process, url
            return url

    def close(self) -> None:
        """End all pages; their decisions are stored in the sessions."""
        with self._lock:
            for process, _ in self._open.values():
                _end(process)
            self._open.clear()


def _address_said(process: subprocess.Popen[str]) -> str:
    """Wait until the program prints the address of its page; discard its later output."""
    said: list[str] = []
    found: list[str] = []
    ready = threading.Event()

    def read() -> None:
        assert process.stdout is not None
        with process.stdout:
            for line in process.stdout:
                if not found:
                    said.append(line.strip())
                    found.extend(word for word in line.split() if word.startswith("http://"))
                    if found:
                        ready.set()
        ready.set()

    threading.Thread(target=read, daemon=True).start()
    ready.wait(_START_S)
    if not found:
        raise FlatclothError(" ".join(said[-3:]) or f"The session did not open within {_START_S:g} s.")
    return found[0]


def _end(process: subprocess.Popen[str]) -> None:
    process.terminate()
    try:
        process.wait(timeout=10)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def review_app(out: Path, pages: SessionPages) -> Starlette:
    """Return the server's application: the page, ``verdict`` and ``open``.

    Parameters
    ----------
    out : Path
        The folder of a batch.
    pages : SessionPages
        Opens sessions.
    """

    async def page(_request: Request) -> Response:
        text = await run_in_threadpool(report_html, out, served=True)
        return HTMLResponse(text, headers={"Cache-Control": "no-store", "X-Frame-Options": "DENY"})

    async def verdict(request: Request) -> Response:
        said = await _said(request)
        await run_in_threadpool(decide, out, said.name, said.verdict)
        return JSONResponse({"name": said.name, "verdict": said.verdict})

    async def open_session(request: Request) -> Response:
        said = await _said(request)
        row = read_row(out / said.name) if is_result_name(said.name) else None
        if row is None:
            raise RefusedError("There is no such result; load the page again.", 404)
        if row["outcome"] != "done":
            raise FlatclothError(f"{row['name']} has no session: {row.get('reason') or 'it is not done'}")
        url = await run_in_threadpool(pages.address, str(row["name"]), view_arguments(row, out))
        return JSONResponse({"url": url})

    return Starlette(
        routes=[
            Route("/", page),
            Route("/verdict", verdict, methods=["POST"]),
            Route("/open", open_session, methods=["POST"]),
        ],
        exception_handlers=REFUSALS,
    )


class _Said(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A message of the page: the name of a result, and a verdict on it; None withdraws the verdict."""

    name: Annotated[str, msgspec.Meta(max_length=255)]
    verdict: Annotated[str, msgspec.Meta(max_length=40)] | None = None


async def _said(request: Request) -> _Said:
    """Return the message in a request.

    Only JSON is accepted: pages of other origins may send forms, but not JSON.

    Raises
    ------
    RefusedError
        If it is not valid.
    """
    if request.headers.get("content-type", "").split(";")[0] != "application/json":
        raise RefusedError("Expected a name and a verdict, as JSON.", 400)
    return await read_json(request, _Said, _MOST_BODY_BYTES)


def serve_review(out: Path, port: int, ready: Callable[[str, str], None]) -> None:
    """Serve the page of a batch on this machine until Ctrl-C or SIGTERM; requests need the user's token.

    Parameters
    ----------
    out : Path
        The folder of the batch.
    port : int
        0 for any free one.
    ready : callable
        Called with the address of the page, and the token in it.

    Raises
    ------
    ServerError
        If the port is busy.
    """
    pages = SessionPages()
    # Without a token, another user of this computer could open a session, and would get its address.
    token = given_token(None) or kept_token()
    try:
        serve_app(lambda _end: review_app(out, pages), HOST, port, token, f"?token={token}", ready)
    finally:
        pages.close()
