"""The operator page: one web server for the page, its messages and viser's 3D scene.

Only this package uses viser and the web server. Nothing heavy is imported before :func:`serve` or
:class:`PageServer` is used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from flatcloth.viewer.server.app import PageServer, serve

__all__ = ["PageServer", "serve"]


def __getattr__(name: str) -> Any:
    if name in __all__:
        from flatcloth.viewer.server import app as server

        return getattr(server, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
