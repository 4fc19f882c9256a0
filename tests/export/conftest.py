"""A session of a cylinder: three views, one of them first rejected, and three picks."""

from __future__ import annotations

import pytest
from exported_sessions import cylinder_session

from flatcloth.export.session import OpenedSession


@pytest.fixture(scope="session")
def session(tmp_path_factory: pytest.TempPathFactory) -> OpenedSession:
    return cylinder_session(tmp_path_factory.mktemp("session"))
