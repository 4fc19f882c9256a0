"""The command ``check``: whether a recording is right, and what mends it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from flatcloth.commands.options import Output, Source
from flatcloth.commands.output import ProgressBar, refuse_full, report
from flatcloth.core.errors import RecordingError, os_errors_as
from flatcloth.recordings.options import option

if TYPE_CHECKING:
    from flatcloth.checking.findings import Check
    from flatcloth.recordings import Recording

SUMMARY = "find mistakes of a recording: its turning, its images, its camera"
EXAMPLES = """examples:
  flatcloth check my-recording
  flatcloth check my-recording --reverse --pictures why   is it right with this mend? draw what shows it"""


@dataclass(kw_only=True)
class Options(Output, Source):
    """The options of the command."""

    pictures: Path | None = option(
        "new or empty folder for a picture of each finding: two views laid on each other", "DIR"
    )


def run(options: Options) -> int:
    """Check, and print a line for each finding; 1 if results would certainly be wrong."""
    from flatcloth.checking.check import check_recording
    from flatcloth.recordings import open_recording

    if options.pictures is not None:
        refuse_full(options.pictures)
    recording = open_recording(options.source, options.source_options())
    with ProgressBar(recording.name) as bar:
        check = check_recording(recording, progress=bar.show)
    lines = [*(f"{recording.name}: {line}" for line in check.lines), *recording.notes]
    if options.pictures is not None:
        files = _write_pictures(recording, check, options.pictures)
        lines.append(f"Pictures written to {options.pictures}: {', '.join(files) or 'none'}")
    document = {"recording": recording.name, "notes": list(recording.notes), **check.to_dict()}
    report(options, document, lines)
    return 1 if check.certain else 0


def _write_pictures(recording: Recording, check: Check, folder: Path) -> list[str]:
    """Write a picture of each finding that views show, ``sense.png`` and so on; return their names."""
    from flatcloth.rendering.evidence import evidence
    from flatcloth.rendering.layers import png

    made = []
    with os_errors_as(RecordingError, f"{folder}: cannot be written", "Choose a writable folder."):
        folder.mkdir(parents=True, exist_ok=True)
        for finding in check.findings:
            picture = evidence(recording, finding)
            if picture is not None:
                made.append(f"{finding.name}.png")
                (folder / made[-1]).write_bytes(png(picture))
    return made
