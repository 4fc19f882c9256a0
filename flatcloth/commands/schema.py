"""The command ``schema``: JSON Schemas of the files and of the robot protocol."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from flatcloth.commands.output import report
from flatcloth.core.errors import FlatclothError

NAMES = ("recording", "outcome", "grasps", "garment", "session", "journal", "robot")
NAME = "schema"
SUMMARY = "print the JSON Schema of a file, or of the protocol for robots"
EXAMPLES = """examples:
  flatcloth schema grasps
  flatcloth schema --out schemas                  all of them, as grasps.schema.json and so on"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("name", nargs="?", choices=NAMES, help="what the schema is of")
    parser.add_argument("--out", type=Path, metavar="DIR", help="write all schemas to DIR")


def run(options: argparse.Namespace) -> None:
    """Print one schema, or write all."""
    if (options.name is None) == (options.out is None):
        raise FlatclothError(f"Give one of {', '.join(NAMES)}, or --out for all.")
    if options.name is not None:
        print(json.dumps(schema_of(options.name), indent=1))
        return
    from flatcloth.export.files import write_text

    files = {name: options.out / f"{name}.schema.json" for name in NAMES}
    for name, file in files.items():
        write_text(file, json.dumps(schema_of(name), indent=1) + "\n")
    report(
        options,
        {"written": [*map(str, files.values())]},
        [f"Written to {options.out}: {len(NAMES)} schemas."],
    )


def schema_of(name: str) -> dict[str, Any]:
    """Return a schema by its name."""
    if name == "robot":
        from flatcloth.viewer.protocol.robot import schema

        return schema()
    from flatcloth.export.formats.schemas import SCHEMAS

    return SCHEMAS[name]()
