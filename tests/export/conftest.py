"""A session of a cylinder: three views, one of them first rejected, and three picks."""

import pytest
from exported_sessions import cylinder_session

from flatcloth.export.figures import figure_files
from flatcloth.export.report import report
from flatcloth.export.session import OpenedSession


@pytest.fixture(scope="session")
def cylinder(tmp_path_factory: pytest.TempPathFactory) -> OpenedSession:
    return cylinder_session(tmp_path_factory.mktemp("session"))


@pytest.fixture(scope="session")
def figures(cylinder: OpenedSession) -> dict[str, bytes]:
    """All figures of the session by the names of their files; drawing them takes four seconds."""
    return dict(figure_files(cylinder))


@pytest.fixture(scope="session")
def text(cylinder: OpenedSession) -> str:
    """The report of the session."""
    return report(cylinder)


@pytest.fixture(scope="module")
def session(cylinder: OpenedSession) -> OpenedSession:
    return cylinder
