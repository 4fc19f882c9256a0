"""The command ``schema``: JSON Schemas of the files and of the robot protocol."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flatcloth.commands.options import Output, option
from flatcloth.commands.output import report
from flatcloth.core.errors import FlatclothError

NAMES = ("recording", "outcome", "grasps", "garment", "session", "journal", "robot")
SUMMARY = "print the JSON Schema of a file, or of the protocol for robots"
EXAMPLES = """examples:
  flatcloth schema grasps
  flatcloth schema --out schemas                  all of them, as grasps.schema.json and so on"""


@dataclass(kw_only=True)
class Options(Output):
    """The options of the command."""

    name: str | None = option("what the schema is of", choices=lambda: NAMES, positional=True)
    out: Path | None = option("write all schemas to DIR", "DIR")


def run(options: Options) -> None:
    """Print one schema, or write all."""
    name, out = options.name, options.out
    if (name is None) == (out is None):
        raise FlatclothError(f"Give one of {', '.join(NAMES)}, or --out for all.")
    if name is not None:
        print(json.dumps(schema_of(name), indent=1))
    if out is None:
        return
    from flatcloth.export.files import write_text

    files = {name: out / f"{name}.schema.json" for name in NAMES}
    for name, file in files.items():
        write_text(file, json.dumps(schema_of(name), indent=1) + "\n")
    report(
        options,
        {"written": [*map(str, files.values())]},
        [f"Written to {out}: {len(NAMES)} schemas."],
    )


def schema_of(name: str) -> dict[str, Any]:
    """Return a schema by its name."""
    if name == "robot":
        from flatcloth.viewer.protocol.robot import schema

        return schema()
    from flatcloth.export.formats.schemas import SCHEMAS

    return SCHEMAS[name]()
