"""What all tests share: no test touches the user's own session folders; a page without a recording."""

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings
from viewer_fakes import CylinderIntegration, new_session

from flatcloth.session.store import SessionFolder
from flatcloth.viewer.server.app import PageServer
from flatcloth.viewer.server.workspace import Opened

# A slow machine must not fail a property, and a failure must come again at the next run: cases are the
# same each time. HYPOTHESIS_PROFILE=anew draws others, twenty times as many.
settings.register_profile("flatcloth", deadline=None, derandomize=True, max_examples=50)
settings.register_profile("anew", deadline=None, max_examples=1000)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "flatcloth"))


@pytest.fixture(scope="session", autouse=True)
def no_user_state(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Keep what lasts longer than a test from the user's own state, too."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state-home")))
        yield


@pytest.fixture(autouse=True)
def state_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Keep default session folders below the test's own folder."""
    home = tmp_path / "state-home"
    monkeypatch.setenv("XDG_STATE_HOME", str(home))
    return home


@pytest.fixture
def integration() -> CylinderIntegration:
    return CylinderIntegration()


@pytest.fixture
def folder() -> Iterator[SessionFolder]:
    """A new session of the cylinder."""
    opened = new_session()
    yield opened
    opened.close()


@pytest.fixture
def server(integration: CylinderIntegration, folder: SessionFolder) -> Iterator[PageServer]:
    """The page's server over an exact cylinder, with a new session."""
    with PageServer(Opened(integration, folder)) as running:
        yield running
        integration.gate.set()


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """Where a session is to be."""
    return tmp_path / "session"


@pytest.fixture(scope="session", autouse=True)
def interruptible() -> None:
    """Let programs hear Ctrl-C and a closed terminal, even if tests run in the background, deaf to them."""
    for number, usual in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
        if signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, usual)
