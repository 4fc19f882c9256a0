"""A session folder that an earlier version wrote, when a hundred more settings could be set."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from flatcloth.cli import main
from flatcloth.core.config import AlignmentConfig, Config, FlatteningConfig
from flatcloth.core.errors import JournalError
from flatcloth.engine.integration import Integration
from flatcloth.recordings import open_recording
from flatcloth.session.header import kept_config
from flatcloth.session.store import SessionFolder

FORMER = Path(__file__).parent / "former"
METHOD = "paper"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return Path(shutil.copytree(FORMER, tmp_path / "session"))


def change(folder: Path, section: str, name: str, value: object) -> None:
    header = json.loads((folder / "session.json").read_text())
    header["config"][section][name] = value
    (folder / "session.json").write_text(json.dumps(header))


def test_it_opens_with_its_decisions_and_draws_its_shape(folder: Path) -> None:
    made = Integration(open_recording("shirt-sleeve-clean"), kept_config(folder, METHOD), METHOD)
    assert made.config.flattening.least_core_samples == 0  # its parts are numbered as they were
    assert made.config.alignment == AlignmentConfig()
    opened = SessionFolder.open(folder, made.recording, made.config, METHOD)
    try:
        document = opened.state.document
    finally:
        opened.close()
    lines = [json.loads(line) for line in (FORMER / "journal.jsonl").read_text().splitlines()]
    accepted = [line["view_index"] for line in lines if line.get("kind", line.get("type")) == "accept"]
    assert [a.view_index for a in document.accepted] == accepted
    assert len(accepted) > 3
    assert set(made.canonical(document).current_from_view) == document.used_views


def test_run_resumes_it(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "shirt-sleeve-clean", "--method", METHOD, "--out", str(folder), "--quiet"]) == 0
    assert (folder / "flattened.npz").exists()
    assert capsys.readouterr().err == ""


def test_a_setting_that_is_fixed_now_is_named_if_it_had_another_value(folder: Path) -> None:
    change(folder, "planning", "edge_width_px", 7)
    recording = open_recording("shirt-sleeve-clean")
    with pytest.raises(JournalError, match=r"planning\.edge_width_px: 7 was set, .* fixed to 4"):
        SessionFolder.open(
            folder, recording, Config(flattening=FlatteningConfig(least_core_samples=0)), METHOD
        )


def test_a_setting_that_never_was_is_refused(folder: Path) -> None:
    change(folder, "planning", "luck", 7)
    recording = open_recording("shirt-sleeve-clean")
    with pytest.raises(JournalError, match=r"planning\.luck: no such setting"):
        SessionFolder.open(folder, recording, Config(), METHOD)
