"""The command ``validate``: proof of accuracy by a recording of a marked fabric."""

from __future__ import annotations

import argparse
from pathlib import Path

from flatcloth.commands.common import ProgressBar, add_method, add_sides, add_source, source_options_of
from flatcloth.commands.output import report

NAME = "validate"
SUMMARY = "compare a recording of a marked fabric (flatcloth kit) with it: is it right in this cell?"
EXAMPLES = """examples:
  flatcloth validate monday --within 10     exit code 1 unless 95 % of the cloth is within 10 mm
  flatcloth validate monday --kit kit/kit.json --out monday-proof --share monday.json"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    add_source(parser)
    parser.add_argument("--kit", type=Path, metavar="FILE", help="kit.json (default: the recording's own)")
    asked = "what is asked of 95 %% of the cloth (default: %(default)g)"
    parser.add_argument("--within", type=float, default=10.0, metavar="MM", help=asked)
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder for a page and all figures")
    parser.add_argument("--share", type=Path, metavar="FILE", help="write figures without images")
    add_method(parser)
    add_sides(parser)


def run(options: argparse.Namespace) -> int:
    """Validate, and say what is off; 1 if the cloth is not as near to its place as is asked."""
    from flatcloth.recordings import open_recording
    from flatcloth.validation.markers import kit_of
    from flatcloth.validation.validate import validate

    recording = open_recording(options.source, source_options_of(options))
    kit, given = kit_of(recording, options.kit), {"method": options.method, "sides": options.sides}
    with ProgressBar(recording.name, steps=True) as bar:
        found = validate(recording, kit, **given, within_mm=options.within, progress=bar.show)
    report(options, found.document, [*found.document["lines"], *found.write(options.out, options.share)])
    return 0 if found.document["is_within"] else 1
