"""The command ``import``: copies any source into a recording folder."""

from __future__ import annotations

from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from flatcloth.commands.options import Output, Source
from flatcloth.commands.output import ProgressBar, refuse_full, report
from flatcloth.core.errors import RecordingError
from flatcloth.recordings.options import option

if TYPE_CHECKING:
    from flatcloth.recordings import Recording

SUMMARY = "copy a RealSense file, or any other source, into a recording folder"
EXAMPLES = """examples:
  flatcloth import turned.db3 --out my-recording --step 10        stops every 10 degrees
  flatcloth import turned.db3 --out my-recording --angles turntable.csv --align color"""


@dataclass(kw_only=True)
class Options(Output, Source):
    """The options of the command."""

    out: Path = option("new folder to write", "DIR", MISSING)
    name: str | None = option("title of the recording (default: the source's own)", "TEXT")
    align: Literal["depth", "color"] | None = option(
        "RealSense file: the camera whose pixels are kept (default: depth, which is then unchanged)"
    )


def run(options: Options) -> None:
    """Read the source, write the folder, and print a summary."""
    from flatcloth.checking.check import check_recording
    from flatcloth.recordings import open_recording
    from flatcloth.recordings.writer import copy_recording

    refuse_full(options.out)
    with ProgressBar(Path(options.source).name) as bar:
        recording = _opened(options, bar)
        count = copy_recording(recording, options.out, options.name, bar.show)
        check = check_recording(open_recording(options.out), progress=bar.show)
    angles, notes = recording.angles_deg, list(recording.notes)
    notes += [finding.line for finding in check.findings]
    views = "1 view" if count == 1 else f"{count} views, {min(angles):g} to {max(angles):g} degrees,"
    line = f"{views} written to {options.out}. Open it with: flatcloth view {options.out}"
    document = {"folder": str(options.out), "angles_deg": list(angles), "notes": notes}
    report(options, document, [*notes, line])


def _opened(options: Options, bar: ProgressBar) -> Recording:
    from flatcloth.recordings import open_recording
    from flatcloth.recordings.isolated import open_isolated
    from flatcloth.recordings.mending import Mends, mended
    from flatcloth.recordings.realsense.player import is_realsense

    path = Path(options.source).expanduser()
    if not is_realsense(path):
        if options.align is not None:
            raise RecordingError(f"{path}: not a RealSense file. --align applies only to those.")
        return open_recording(options.source, options.source_options())
    said = options.source_options()
    opened = open_isolated("realsense", path, said, options.align, bar.show)
    return mended(opened, said.mends or Mends())
