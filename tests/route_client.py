"""Asks routes without a server."""

from __future__ import annotations

import asyncio
from concurrent.futures import ThreadPoolExecutor

import httpx
from starlette.applications import Starlette

from flatcloth.viewer.http import REFUSALS


class RouteClient:
    """Asks in a thread of its own, since browser tests leave a loop running in theirs."""

    def __init__(self, routes):
        self._app = Starlette(routes=routes, exception_handlers=REFUSALS)

    def get(self, path):
        return self._ask(lambda client: client.get(path))

    def post(self, path, data):
        return self._ask(lambda client: client.post(path, content=data, timeout=30))

    def _ask(self, request):
        async def ask():
            transport = httpx.ASGITransport(app=self._app)
            async with httpx.AsyncClient(transport=transport, base_url="http://page") as client:
                return await request(client)

        with ThreadPoolExecutor(1) as thread:
            return thread.submit(asyncio.run, ask()).result()
