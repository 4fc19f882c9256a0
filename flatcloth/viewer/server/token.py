"""The token of the page, saved for the user, so that an open page reconnects after a restart."""

from __future__ import annotations

import contextlib
import os
import re
import secrets
import stat
from pathlib import Path

from flatcloth.core.plain_files import read_plain, replace_file
from flatcloth.session.header import state_folder

FILE = "token"
_TOKEN = re.compile(rb"[A-Za-z0-9_-]{32,64}\n")


def new_token() -> str:
    """Return a new random token."""
    return secrets.token_urlsafe(24)


def kept_token() -> str:
    """Return the user's token for pages on this computer; it is created on first use.

    Only the user can read it. If it cannot be saved, or others can read it, a new one is returned.
    """
    path = state_folder() / FILE
    with contextlib.suppress(OSError):
        about = path.lstat()
        data = read_plain(path, 100)
        private = stat.S_ISREG(about.st_mode) and about.st_uid == os.getuid() and not about.st_mode & 0o077
        if private and _TOKEN.fullmatch(data):
            return data.decode().strip()
    token = new_token()
    with contextlib.suppress(OSError):
        _keep(path, token)
    return token


def _keep(path: Path, token: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    replace_file(path, f"{token}\n".encode(), mode=0o600)
