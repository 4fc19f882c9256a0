"""The command ``run``: unattended integration."""

from __future__ import annotations

import argparse
from pathlib import Path

from flatcloth.commands.common import ProgressBar, add_method, add_source, integration_of, source_options_of
from flatcloth.commands.export import add_hand_eye, hand_eye_of

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


def run(options: argparse.Namespace) -> None:
    """Integrate, and write the result to the session folder."""
    from flatcloth.engine.garments import garment_of
    from flatcloth.engine.headless import Run
    from flatcloth.engine.outcome import earlier_scores, outcome_of, told, write_outcome
    from flatcloth.export.data import export_shape
    from flatcloth.export.garment import garment_points, keep_garment, outcome_entry
    from flatcloth.export.garment import told as garment_told
    from flatcloth.export.session import frames_of
    from flatcloth.grasping.grips import read_grips
    from flatcloth.session.axis_file import settle_axis
    from flatcloth.session.store import SessionFolder

    base_from_camera = hand_eye_of(options)
    integration = integration_of(options.source, options.method, source_options_of(options))
    folder = SessionFolder.open(options.out, integration.recording, integration.config, options.method)
    try:
        settle_axis(folder.folder, integration)
        with ProgressBar(integration.recording.name) as bar:
            unattended = Run(integration, folder)
            state = unattended.finish(bar.show)
        frames = frames_of(integration, state.document, read_grips(options.out), base_from_camera)
        canonical = integration.canonical(state.document)
        garment = garment_of(integration, state.document)
        named = () if isinstance(garment, str) else garment_points(garment, canonical.view)
        files = export_shape(canonical.view, folder.picks, options.out, frames, canonical.floating, named)
        outcome = outcome_of(integration, unattended, earlier_scores(options.out))
        outcome["garment"] = outcome_entry(garment)
        files.append(write_outcome(outcome, options.out))
        files += keep_garment(garment, canonical.view, canonical.floating, options.out)
    finally:
        folder.close()
    for line in (*told(outcome), *garment_told(garment)):
        print(line)
    print(f"Written to {options.out}: {', '.join(f.name for f in files)}")
