"""The command ``segment``: the side of interest of a recording without masks, as masks."""

from __future__ import annotations

from dataclasses import MISSING, dataclass
from pathlib import Path

from flatcloth.commands.options import Output, Source, Strokes
from flatcloth.commands.output import ProgressBar, refuse_full, report
from flatcloth.recordings.options import option

SUMMARY = "find the side of interest of a recording without masks, and write masks"
EXAMPLES = """examples:
  flatcloth segment my-recording --out masks
  flatcloth segment my-recording --out my-masked-recording --copy --strokes strokes.json"""


@dataclass(kw_only=True)
class Options(Output, Strokes, Source):
    """The options of the command."""

    out: Path = option("new or empty folder to write", "DIR", MISSING)
    copy: bool = option("write a complete recording with the masks, not the masks alone")


def run(options: Options) -> None:
    """Segment, and write the masks."""
    from flatcloth.api.integrating import integration_of
    from flatcloth.engine.segmenting import masked, prepare, summary
    from flatcloth.recordings import open_recording
    from flatcloth.recordings.writer import copy_recording, write_masks

    refuse_full(options.out)
    decisions = options.decisions()
    recording = open_recording(options.source, options.source_options())
    integration = integration_of(recording)
    with ProgressBar(recording.name) as bar:
        found = prepare(integration.views, bar.show).solve(decisions)
        copied = masked(recording, found)
        if options.copy:
            count = copy_recording(copied, options.out, progress=bar.show)
        else:
            count = write_masks(copied, options.out, summary(found), bar.show)
    lines = [f"{recording.name}: has masks; they were not used."] if recording.has_masks else []
    lines += [found.text, *(cut.text for cut in found.observed.cut_off), *found.conflicts]
    lines.append(f"Written to {options.out}: {count} {'views with masks' if options.copy else 'masks'}.")
    report(options, summary(found), lines)
