"""The command ``run``: unattended integration."""

from __future__ import annotations

from dataclasses import MISSING, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from flatcloth.commands.options import HandEye, Method, Output, Sides, Source, Strokes
from flatcloth.commands.output import ProgressBar, detail, loading, report
from flatcloth.recordings.options import option

if TYPE_CHECKING:
    from flatcloth.recordings import SourceOptions

SUMMARY = "integrate unattended and export the result"
EXAMPLES = """examples:
  flatcloth run shirt-sleeve-clean --out result
  flatcloth run my-recording --out result --method paper"""


@dataclass(kw_only=True)
class Options(Output, Strokes, HandEye, Sides, Method, Source):
    """The options of the command."""

    out: Path = option("session folder to write; resumed if it exists", "DIR", MISSING)


def run(options: Options) -> None:
    """Integrate, and write the result to the session folder."""
    with loading():
        from flatcloth.api.integrating import integrate
        from flatcloth.checking.check import checked
        from flatcloth.core.memory import return_freed_memory
        from flatcloth.engine.outcome import view_lines
        from flatcloth.recordings import open_recording

    base_from_camera, strokes = options.base_from_camera(), options.decisions()
    given = _with_kept_mends(options.source_options(), options.out)
    recording = open_recording(options.source, given)
    with ProgressBar(recording.name, steps=True) as bar:
        check = checked(recording, progress=bar.show)
        if not given.as_recorded:
            check.refuse(recording.location)
        return_freed_memory()
        shape = integrate(
            recording,
            method=options.method,
            session=options.out,
            strokes=strokes,
            progress=bar.show,
            sides=options.sides,
        )
        bar.show(1.0, "writing")
        files = shape.write(options.out, base_from_camera=base_from_camera)
    lines = [
        *recording.notes,
        *shape.lines(),
        f"Written to {options.out}: {', '.join(file.name for file in files)}",
    ]
    report(options, shape.report, lines)
    for line in view_lines(shape.report):
        detail(line)


def _with_kept_mends(options: SourceOptions, session: Path) -> SourceOptions:
    """Return options with the mends of a session that is continued, if none are given."""
    from flatcloth.core.errors import JournalError
    from flatcloth.recordings import SourceOptions
    from flatcloth.session.header import HEADER, read_header

    if options.mends is not None or not (session / HEADER).exists():
        return options
    try:
        kept = SourceOptions.from_dict(read_header(session).recording.options, str(session))
    except JournalError:
        return options  # it is reported when the session is opened
    return replace(options, mends=kept.mends)
