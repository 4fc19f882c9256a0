"""A viser server that only this process can reach: it listens on a socket file in a private folder.

viser itself requires no token and does not check the Origin, so any web page could connect to its port.
"""

from __future__ import annotations

import contextlib
import io
import logging
import shutil
import tempfile
import threading
import traceback
from pathlib import Path
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

from flatcloth.core.errors import ServerError

if TYPE_CHECKING:
    import viser

_log = logging.getLogger(__name__)
_ONE_AT_A_TIME = threading.Lock()
_MAX_PATH_CHARS = 90
"""The system allows 107 bytes for the address of a socket file."""


def _without_traceback(record: logging.LogRecord) -> bool:
    """Shorten a line about a message that viser does not understand; no page sends such."""
    error = record.exc_info[1] if record.exc_info else None
    if error is not None and (record.name == _log.name or _is_visers(error)):
        record.msg, record.args = "a message to the 3D scene was not understood: %.200r", (error,)
        record.exc_info = record.exc_text = None
    return True


def _is_visers(error: BaseException) -> bool:
    """Return whether an error was raised in viser's own code."""
    frames = list(traceback.walk_tb(error.__traceback__))
    return bool(frames) and str(frames[-1][0].f_globals.get("__name__")).partition(".")[0] == "viser"


for _source in (_log, logging.getLogger("asyncio")):
    _source.addFilter(_without_traceback)


class PrivateViser:
    """Owns a ``viser.ViserServer`` that listens at ``path``, a socket file of this user only.

    Raises
    ------
    ServerError
        If this version of viser listens in an unknown way.
    """

    def __init__(self) -> None:
        folder = tempfile.mkdtemp(prefix="flatcloth-")  # mode 0700
        if len(folder) > _MAX_PATH_CHARS:
            Path(folder).rmdir()
            folder = tempfile.mkdtemp(prefix="flatcloth-", dir="/tmp")
        self._folder = Path(folder)
        self.path = self._folder / "viser"
        try:
            self.server = self._started()
        except BaseException:
            shutil.rmtree(self._folder, ignore_errors=True)
            raise

    def _started(self) -> viser.ViserServer:
        import viser
        import websockets.asyncio.server as sockets
        from viser import _messages

        listening: list[Any] = []
        serve = sockets.serve

        def listen(handler: Any, _host: str, _port: int, **options: Any) -> Any:
            # The files of viser's client are served by our own server.
            options["process_request"] = None
            options["logger"] = _log
            listening.append(serve(handler, unix=True, path=str(self.path), **options))
            return listening[-1]

        # Suppress the address that viser prints; the user opens only ours.
        with (
            _ONE_AT_A_TIME,
            patch.object(sockets, "serve", listen),
            contextlib.redirect_stdout(io.StringIO()),
        ):
            server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        if len(listening) != 1:
            server.stop()
            raise ServerError(
                "This version of viser is not supported. Install viser 1.1: pip install 'viser<1.2'."
            )
        # Clients could open a public tunnel to this computer, or fill its memory with files.
        for unused in (
            _messages.ShareUrlRequest,
            _messages.FileTransferStartUpload,
            _messages.FileTransferPart,
        ):
            server._websock_server.unregister_handler(unused)
        return server

    def stop(self) -> None:
        """Close the server and remove the socket file."""
        with contextlib.redirect_stdout(io.StringIO()):
            self.server.stop()
        shutil.rmtree(self._folder, ignore_errors=True)
