"""Serve the page of a batch: store verdicts, and open a session in the operator page on a click."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import HTMLResponse, Response
from starlette.routing import Route

from flatcloth.batch.report import decide, report_html
from flatcloth.batch.rows import is_result_name, read_row
from flatcloth.core.errors import FlatclothError
from flatcloth.session.header import read_header
from flatcloth.viewer.http import REFUSALS, RefusedError, post
from flatcloth.viewer.places import Chosen
from flatcloth.viewer.server.app import PageServer, serve_app
from flatcloth.viewer.server.guard import Endpoint, given_token

if TYPE_CHECKING:
    from flatcloth.viewer.server.app import Opener


class SessionPage:
    """The operator page in which a review opens sessions, one at a time; ``opener`` as for the page."""

    def __init__(self, opener: Opener) -> None:
        self._opener, self._lock = opener, threading.Lock()
        self._server: PageServer | None = None

    def address(self, folder: Path) -> str:
        """Return the address of the page, with the session of a folder open.

        Raises
        ------
        FlatclothError
            If it cannot be opened.
        """
        folder = folder.resolve()
        header = read_header(folder)
        with self._lock:
            self._server = self._server or PageServer(opener=self._opener).start()
            self._server.open(Chosen("session", header.recording.location, folder, header))
            return self._server.url

    def close(self) -> None:
        """Close the page; the decisions are stored in the sessions."""
        if self._server is not None:
            self._server.stop()


def review_app(out: Path, page_of: SessionPage) -> Starlette:
    """Return the server's application: the page, ``verdict`` and ``open``.

    Parameters
    ----------
    out : Path
        The folder of a batch.
    page_of : SessionPage
        Opens sessions.
    """

    async def page(_request: Request) -> Response:
        text = await run_in_threadpool(report_html, out, served=True)
        return HTMLResponse(text, headers={"Cache-Control": "no-store", "X-Frame-Options": "DENY"})

    def verdict(_request: Request, said: _Said) -> _Said:
        decide(out, said.name, said.verdict)
        return said

    def open_session(_request: Request, said: _Said) -> dict[str, str]:
        row = read_row(out / said.name) if is_result_name(said.name) else None
        if row is None:
            raise RefusedError("There is no such result; load the page again.", 404)
        if row["outcome"] != "done":
            raise FlatclothError(f"{row['name']} has no session: {row.get('reason') or 'it is not done'}")
        return {"url": page_of.address(out / str(row["name"]))}

    return Starlette(
        routes=[Route("/", page), post("/verdict", _Said, verdict), post("/open", _Said, open_session)],
        exception_handlers=REFUSALS,
    )


class _Said(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A message of the page: the name of a result, and a verdict on it; None withdraws the verdict."""

    name: Annotated[str, msgspec.Meta(max_length=255)]
    verdict: Annotated[str, msgspec.Meta(max_length=40)] | None = None


def serve_review(out: Path, port: int, ready: Callable[[str, str], None], opener: Opener) -> None:
    """Serve the page of a batch on this machine until Ctrl-C or SIGTERM; requests need the user's token.

    Parameters
    ----------
    out : Path
        The folder of the batch.
    port : int
        0 for any free one.
    ready : callable
        Called with the address of the page, and the token in it.
    opener : callable
        Opens a session for the operator page.

    Raises
    ------
    ServerError
        If the port is busy.
    """
    sessions = SessionPage(opener)
    # Without a token, another user of this computer could open a session, and would get its address.
    endpoint = Endpoint(port=port)
    token = given_token(None) or endpoint.own_token()
    try:
        serve_app(lambda _end: review_app(out, sessions), endpoint, token, f"?token={token}", ready)
    finally:
        sessions.close()
