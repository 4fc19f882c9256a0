"""A session folder, and one with decisions in it."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from journal_script import played_in

from flatcloth.session.store import SessionFolder


@pytest.fixture
def played(place: Path) -> Iterator[SessionFolder]:
    folder = played_in(place)
    yield folder
    folder.close()
