"""The command ``segment``: the side of interest of a recording without masks, as masks."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from flatcloth.commands.common import ProgressBar, add_source, source_options_of
from flatcloth.commands.output import report

if TYPE_CHECKING:
    from flatcloth.core.strokes import Decision

NAME = "segment"
SUMMARY = "find the side of interest of a recording without masks, and write masks"
EXAMPLES = """examples:
  flatcloth segment my-recording --out masks
  flatcloth segment my-recording --out my-masked-recording --copy --strokes strokes.json"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    add_source(parser)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="new or empty folder to write")
    parser.add_argument(
        "--copy", action="store_true", help="write a complete recording with the masks, not the masks alone"
    )
    add_strokes(parser)


def add_strokes(parser: argparse.ArgumentParser) -> None:
    """Declare ``--strokes``."""
    parser.add_argument(
        "--strokes", type=Path, metavar="FILE", help="strokes and cuts that say which side is of interest"
    )


def strokes_of(options: argparse.Namespace) -> tuple[Decision, ...]:
    """Read the file of ``--strokes``; without one, there are none."""
    from flatcloth.core.strokes import decisions_from_plain
    from flatcloth.recordings.files.text import load_table

    return decisions_from_plain(load_table(options.strokes), str(options.strokes)) if options.strokes else ()


def run(options: argparse.Namespace) -> None:
    """Segment, and write the masks."""
    from flatcloth.api.integrating import integration_of
    from flatcloth.engine.segmenting import masked, prepare, summary
    from flatcloth.recordings import open_recording
    from flatcloth.recordings.copying import copy_recording, write_masks

    decisions = strokes_of(options)
    recording = open_recording(options.source, source_options_of(options))
    integration = integration_of(recording)
    with ProgressBar(recording.name) as bar:
        found = prepare(integration.views, bar.show).solve(decisions)
        copied = masked(recording, found)
        if options.copy:
            count = copy_recording(copied, options.out, progress=bar.show)
        else:
            count = write_masks(copied, options.out, summary(found), bar.show)
    lines = [f"{recording.name}: has masks; they were not used."] if recording.has_masks else []
    lines += [found.text, *(cut.text for cut in found.cut_off), *found.conflicts]
    lines.append(f"Written to {options.out}: {count} {'views with masks' if options.copy else 'masks'}.")
    report(options, summary(found), lines)
