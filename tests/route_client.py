"""Asks routes, or a whole application, without a server."""

import asyncio
from concurrent.futures import ThreadPoolExecutor

import httpx
from starlette.applications import Starlette

from flatcloth.viewer.http import REFUSALS


class RouteClient:
    """Asks in a thread of its own, since browser tests leave a loop running in theirs."""

    def __init__(self, routes=(), app=None):
        self._app = app or Starlette(routes=routes, exception_handlers=REFUSALS)

    def get(self, path, **given):
        return self._ask("GET", path, **given)

    def post(self, path, **given):
        return self._ask("POST", path, **given)

    def _ask(self, method, path, **given):
        async def ask():
            transport = httpx.ASGITransport(app=self._app)
            async with httpx.AsyncClient(
                transport=transport, base_url="http://127.0.0.1", timeout=30
            ) as client:
                return await client.request(method, path, **given)

        with ThreadPoolExecutor(1) as thread:
            return thread.submit(asyncio.run, ask()).result()
