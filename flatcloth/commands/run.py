"""The command ``run``: unattended integration."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from flatcloth.commands.common import (
    ProgressBar,
    add_method,
    add_source,
    integration_of,
    loading,
    source_options_of,
)
from flatcloth.commands.export import add_hand_eye, hand_eye_of
from flatcloth.commands.segment import add_strokes, strokes_of

NAME = "run"
SUMMARY = "integrate unattended and export the result"
EXAMPLES = """examples:
  python app.py run recordings/shirt-sleeve-clean --out result
  python app.py run my-recording --out result --method paper"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    add_source(parser)
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="session folder to write; resumed if it exists"
    )
    add_method(parser)
    add_hand_eye(parser)
    add_strokes(parser)


def run(options: argparse.Namespace) -> None:
    """Integrate, and write the result to the session folder."""
    with loading():
        from flatcloth.batch.integrate import integrate
        from flatcloth.engine.outcome import told
        from flatcloth.export.garment import told as garment_told
        from flatcloth.session.header import kept_config

    base_from_camera, decisions = hand_eye_of(options), strokes_of(options)
    kept = kept_config(options.out, options.method)
    integration = integration_of(options.source, options.method, source_options_of(options), kept)
    with ProgressBar(integration.recording.name) as bar:
        done = integrate(
            integration,
            options.out,
            base_from_camera=base_from_camera,
            strokes=decisions,
            progress=bar.show,
            cores=len(os.sched_getaffinity(0)),
        )
    for line in (*told(done.outcome), *garment_told(done.garment)):
        print(line)
    print(f"Written to {options.out}: {', '.join(f.name for f in done.files)}")
