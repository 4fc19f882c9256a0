"""JSON Schemas of the files that flatcloth reads and writes, made of the types that decode them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgspec

from flatcloth.export.formats.documents import GarmentDocument, GraspsDocument, OutcomeDocument
from flatcloth.recordings.manifest import FORMAT as RECORDING_FORMAT
from flatcloth.recordings.manifest import RecordingHeader
from flatcloth.session.header import FORMAT as SESSION_FORMAT
from flatcloth.session.header import Header
from flatcloth.session.journal import KINDS

DRAFT = "https://json-schema.org/draft/2020-12/schema"


def _document(kind: type, title: str) -> dict[str, Any]:
    return {"$schema": DRAFT, **msgspec.json.schema(kind), "title": title}


def recording_schema() -> dict[str, Any]:
    """Return the schema of ``recording.json``; further fields are not used."""
    schema = _document(RecordingHeader, RECORDING_FORMAT)
    header = schema["$defs"][RecordingHeader.__name__]
    header["properties"]["format"] = {"const": RECORDING_FORMAT}
    return schema


def journal_schema() -> dict[str, Any]:
    """Return the schema of one line of ``journal.jsonl``: the entry's fields, and those of every line."""
    schemas, parts = msgspec.json.schema_components(KINDS.values(), ref_template="#/$defs/{name}")
    lines = []
    for (name, _), reference in zip(KINDS.items(), schemas, strict=True):
        entry = parts[reference["$ref"].rpartition("/")[2]]
        properties = {
            "line": {"type": "integer", "minimum": 1},
            "time": {"type": "string", "format": "date-time"},
            "kind": {"const": name},
            **entry["properties"],
            "crc": {"type": "string", "pattern": "^[0-9a-f]{8}$"},
        }
        lines.append(
            {
                "title": name,
                "description": entry.get("description", ""),
                "type": "object",
                "properties": properties,
                "required": ["line", "kind", *entry.get("required", [])],
            }
        )
    return {"$schema": DRAFT, "title": "A line of journal.jsonl", "anyOf": lines, "$defs": parts}


SCHEMAS: dict[str, Callable[[], dict[str, Any]]] = {
    "recording": recording_schema,
    "outcome": lambda: _document(OutcomeDocument, "flatcloth-outcome/1"),
    "grasps": lambda: _document(GraspsDocument, "flatcloth-grasps/1"),
    "garment": lambda: _document(GarmentDocument, "flatcloth-garment/1"),
    "session": lambda: _document(Header, SESSION_FORMAT),
    "journal": journal_schema,
}
"""The schemas by the name of the file."""
