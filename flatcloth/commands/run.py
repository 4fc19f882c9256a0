"""The command ``run``: unattended integration."""

from __future__ import annotations

import argparse
from pathlib import Path

from flatcloth.commands.common import (
    ProgressBar,
    add_method,
    add_sides,
    add_source,
    kept_mends,
    loading,
    source_options_of,
)
from flatcloth.commands.export import add_hand_eye, hand_eye_of
from flatcloth.commands.output import detail, report
from flatcloth.commands.segment import add_strokes, strokes_of

NAME = "run"
SUMMARY = "integrate unattended and export the result"
EXAMPLES = """examples:
  flatcloth run shirt-sleeve-clean --out result
  flatcloth run my-recording --out result --method paper"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    add_source(parser)
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="session folder to write; resumed if it exists"
    )
    add_method(parser)
    add_sides(parser)
    add_hand_eye(parser)
    add_strokes(parser)


def run(options: argparse.Namespace) -> None:
    """Integrate, and write the result to the session folder."""
    with loading():
        from flatcloth.api.integrating import integrate
        from flatcloth.checking.check import checked
        from flatcloth.core.memory import return_freed_memory
        from flatcloth.engine.outcome import view_lines
        from flatcloth.recordings import open_recording

    base_from_camera, strokes = hand_eye_of(options), strokes_of(options)
    recording = open_recording(options.source, kept_mends(source_options_of(options), options.out))
    with ProgressBar(recording.name, steps=True) as bar:
        check = checked(recording, progress=bar.show)
        if not options.as_recorded:
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
