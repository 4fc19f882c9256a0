"""The schemas say what is written: real files are valid, and lose nothing when they are read by the types."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import jsonschema
import msgspec
import pytest
from exported_sessions import write_cylinder, write_session

from flatcloth.cli import main
from flatcloth.commands.schema import NAMES
from flatcloth.export.formats.documents import GarmentDocument, GraspsDocument, OutcomeDocument
from flatcloth.recordings.manifest import HEADER

RECORDINGS = Path(__file__).parents[2] / "recordings"


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The documents of one session, by the name of their schema."""
    place = tmp_path_factory.mktemp("schema")
    recording, out = write_cylinder(place / "recording"), place / "out"
    session = write_session(place / "session", recording)
    assert main(["export", str(session), "--data", str(out)]) == 0
    found = {
        name: json.loads((out / f"{name}.json").read_text()) for name in ("outcome", "grasps", "garment")
    }
    found["recording"] = json.loads((recording / HEADER).read_text())
    found["session"] = json.loads((session / "session.json").read_text())
    found["journal"] = [json.loads(line) for line in (session / "journal.jsonl").read_text().splitlines()]
    return found


@pytest.fixture(scope="module")
def schemas(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder = tmp_path_factory.mktemp("schemas")
    assert main(["schema", "--out", str(folder)]) == 0
    return {name: json.loads((folder / f"{name}.schema.json").read_text()) for name in NAMES}


@pytest.mark.parametrize("name", ["outcome", "grasps", "garment", "recording", "session", "journal"])
def test_what_is_written_is_valid(name: str, written: dict[str, Any], schemas: dict[str, Any]) -> None:
    valid = jsonschema.Draft202012Validator(schemas[name])
    documents = written[name] if name == "journal" else [written[name]]
    assert documents
    for document in documents:
        assert valid.is_valid(document)
        spoilt = {key: value for key, value in document.items() if key not in ("format", "kind")}
        assert not valid.is_valid(spoilt)


@pytest.mark.parametrize(
    ("name", "kind"),
    [("outcome", OutcomeDocument), ("grasps", GraspsDocument), ("garment", GarmentDocument)],
)
def test_the_types_have_every_key_that_is_written(name: str, kind: type, written: dict[str, Any]) -> None:
    kept = msgspec.to_builtins(msgspec.convert(written[name], kind))
    assert without_none(kept) == without_none(written[name])


def test_the_bundled_recordings_are_valid(schemas: dict[str, Any]) -> None:
    valid = jsonschema.Draft202012Validator(schemas["recording"])
    for header in RECORDINGS.glob("*/recording.json"):
        assert valid.is_valid(json.loads(header.read_text()))


def test_a_schema_is_valid_itself_and_printed(
    capsys: pytest.CaptureFixture[str], schemas: dict[str, Any]
) -> None:
    for name in NAMES:
        jsonschema.Draft202012Validator.check_schema(schemas[name])
        assert main(["schema", name]) == 0
        assert json.loads(capsys.readouterr().out) == schemas[name]
    assert main(["schema"]) == 2


def without_none(value: Any) -> Any:
    """Leave out keys without a value, which the types add; a key with a value stays."""
    if isinstance(value, dict):
        return {key: without_none(one) for key, one in value.items() if one is not None}
    return [without_none(one) for one in value] if isinstance(value, list | tuple) else value
