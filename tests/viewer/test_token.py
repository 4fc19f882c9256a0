"""The token that a file or the environment gives."""

from __future__ import annotations

import stat

import pytest
from page_tabs import get
from viewer_fakes import CylinderIntegration, MemoryFolder

from flatcloth.core.errors import ServerError
from flatcloth.viewer.server.app import PageServer
from flatcloth.viewer.server.guard import given_token
from flatcloth.viewer.server.workspace import Opened


def test_the_token_of_a_file_is_made_once_and_read_again(tmp_path):
    file = tmp_path / "token"
    made = given_token(file)
    assert made is not None
    assert given_token(file) == made
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    with PageServer(Opened(CylinderIntegration(), MemoryFolder()), port=0, token=made) as server:
        assert get(server, "/").status_code == 200
        assert server.url.endswith(f"?token={made}")


def test_the_token_of_the_environment_is_taken_unless_a_file_is_named(tmp_path, monkeypatch):
    monkeypatch.setenv("FLATCLOTH_TOKEN", "e" * 32)
    assert given_token(None) == "e" * 32
    (tmp_path / "token").write_text("f" * 40)
    assert given_token(tmp_path / "token") == "f" * 40
    for weak in ("", "short", "e" * 31, "ä" * 40, "e" * 32 + " "):
        monkeypatch.setenv("FLATCLOTH_TOKEN", weak)
        with pytest.raises(ServerError, match="FLATCLOTH_TOKEN: not a token; give 32 to 64"):
            given_token(None)
    with pytest.raises(ServerError, match="no token can be kept here"):
        given_token(tmp_path)
