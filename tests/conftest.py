"""What all tests share: no test touches the user's own session folders."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import settings

# A slow machine must not fail a property.
settings.register_profile("flatcloth", deadline=None)
settings.load_profile("flatcloth")


@pytest.fixture(autouse=True)
def state_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Keep default session folders below the test's own folder."""
    home = tmp_path / "state-home"
    monkeypatch.setenv("XDG_STATE_HOME", str(home))
    return home
