"""The page's own files, in few requests and bytes."""

from __future__ import annotations

import gzip
import hashlib
import mimetypes
from functools import lru_cache
from pathlib import Path

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response
from starlette.staticfiles import NotModifiedResponse, StaticFiles
from starlette.types import Scope

from flatcloth.export.page import whole

_KEPT = 16
"""Packed files that are kept. Chosen: more than one page has."""


class OwnFiles(StaticFiles):
    """Serves a folder; a module or style sheet comes with all that it imports."""

    async def get_response(self, path: str, scope: Scope) -> Response:
        """Return a file, or 404."""
        found, about = await run_in_threadpool(self.lookup_path, path)
        if about is None or self.directory is None or not path.endswith((".js", ".css")):
            return await super().get_response(path, scope)
        folder = Path(self.directory).resolve()
        text = await run_in_threadpool(whole, folder, Path(found).relative_to(folder).as_posix())
        return packed(Request(scope), text, mimetypes.guess_type(path)[0] or "text/plain")


def packed(request: Request, text: str, media_type: str) -> Response:
    """Return a text, zipped where the browser takes that; it asks each time whether the text has changed."""
    data, tag = text.encode(), hashlib.sha256(text.encode()).hexdigest()[:32]
    headers = {"ETag": f'"{tag}"', "Cache-Control": "no-cache", "Vary": "Accept-Encoding"}
    if request.headers.get("if-none-match") == headers["ETag"]:
        return NotModifiedResponse(Response(headers=headers).headers)
    if "gzip" in request.headers.get("accept-encoding", ""):
        headers["Content-Encoding"] = "gzip"
        data = _zipped(data)
    return Response(data, media_type=media_type, headers=headers)


@lru_cache(_KEPT)
def _zipped(data: bytes) -> bytes:
    return gzip.compress(data, 6, mtime=0)
