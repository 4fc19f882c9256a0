"""The command ``validate``: proof of accuracy by a recording of a marked fabric."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from flatcloth.commands.options import Method, Output, Sides, Source
from flatcloth.commands.output import ProgressBar, report
from flatcloth.recordings.options import option

SUMMARY = "compare a recording of a marked fabric (flatcloth kit) with it: is it right in this cell?"
EXAMPLES = """examples:
  flatcloth validate monday --within 10     exit code 1 unless 95 % of the cloth is within 10 mm
  flatcloth validate monday --kit kit/kit.json --out monday-proof --share monday.json"""


@dataclass(kw_only=True)
class Options(Output, Sides, Method, Source):
    """The options of the command."""

    kit: Path | None = option("kit.json (default: the recording's own)", "FILE")
    within: float = option("what is asked of 95 %% of the cloth", "MM", 10.0)
    out: Path | None = option("folder for a page and all figures", "DIR")
    share: Path | None = option("write figures without images", "FILE")


def run(options: Options) -> int:
    """Validate, and say what is off; 1 if the cloth is not as near to its place as is asked."""
    from flatcloth.recordings import open_recording
    from flatcloth.validation.kit import kit_of
    from flatcloth.validation.validate import validate

    recording = open_recording(options.source, options.source_options())
    kit, method, sides = kit_of(recording, options.kit), options.method, options.sides
    with ProgressBar(recording.name, steps=True) as bar:
        found = validate(
            recording, kit, method=method, sides=sides, within_mm=options.within, progress=bar.show
        )
    report(options, found.document, [*found.document["lines"], *found.write(options.out, options.share)])
    return 0 if found.document["is_within"] else 1
