"""A viser server that only this process can reach: it listens on a socket file in a private folder.

viser itself requires no token and does not check the Origin, so any web page could connect to its port.
"""

from __future__ import annotations

import contextlib
import io
import os
import shutil
import tempfile
from pathlib import Path
from typing import Any
from unittest import mock

import viser
import websockets.asyncio.server
from viser import _messages

from flatcloth.core.errors import ServerError

_PREFIX = "flatcloth-scene-"
"""Of the folders of socket files; the number of the process follows."""
_MAX_PATH_CHARS = 90
"""The system allows 107 bytes for the address of a socket file."""


def _sweep(place: Path) -> None:
    """Remove the socket folders of this user's programs that were killed."""
    for left in place.glob(f"{_PREFIX}*-*"):
        with contextlib.suppress(OSError, ValueError):
            pid = int(left.name.removeprefix(_PREFIX).split("-")[0])
            is_own = left.lstat().st_uid == os.getuid()
            if is_own and not Path(f"/proc/{pid}").exists() and Path("/proc/self").exists():
                shutil.rmtree(left)


class PrivateViser:
    """Owns a ``viser.ViserServer`` that listens at ``path``, a socket file of this user only.

    Raises
    ------
    ServerError
        If this version of viser listens in an unknown way.
    """

    def __init__(self) -> None:
        prefix = f"{_PREFIX}{os.getpid()}-"
        folder = tempfile.mkdtemp(prefix=prefix)  # mode 0700
        if len(folder) > _MAX_PATH_CHARS:
            Path(folder).rmdir()
            folder = tempfile.mkdtemp(prefix=prefix, dir="/tmp")
        for place in {Path(folder).parent, Path(tempfile.gettempdir())}:
            _sweep(place)
        self._folder = Path(folder)
        self.path = self._folder / "viser"
        try:
            self.server = self._started()
        except BaseException:
            shutil.rmtree(self._folder, ignore_errors=True)
            raise

    def _started(self) -> viser.ViserServer:
        serve = websockets.asyncio.server.serve

        def at_file(handler: Any, _host: str, _port: int, **options: Any) -> Any:
            return serve(handler, unix=True, path=str(self.path), **options)

        # viser has no option for a socket file. It prints its address; the user opens only ours.
        with (
            mock.patch.object(websockets.asyncio.server, "serve", at_file),
            contextlib.redirect_stdout(io.StringIO()),
        ):
            server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        if not self.path.is_socket():
            server.stop()
            raise ServerError("This version of viser is not supported. Run pip install 'viser<1.2'.")
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
