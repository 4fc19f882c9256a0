"""The command ``run``: unattended integration."""

from __future__ import annotations

import argparse
from pathlib import Path

from flatcloth.commands.common import ProgressBar, add_method, integration_of

NAME = "run"
SUMMARY = "integrate unattended and export the result"
EXAMPLES = """examples:
  python app.py run recordings/shirt-sleeve-clean --out result
  python app.py run my-recording --out result --method paper"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument(
        "source", metavar="SOURCE", help="recording folder, or the name of a bundled recording"
    )
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="session folder to write; resumed if it exists"
    )
    add_method(parser)


def run(options: argparse.Namespace) -> None:
    """Integrate, and write the result to the session folder."""
    from flatcloth.export import export_shape
    from flatcloth.journal import SessionFolder
    from flatcloth.pipeline import Run

    integration = integration_of(options.source, options.method)
    folder = SessionFolder.open(options.out, integration.recording, integration.config, options.method)
    try:
        with ProgressBar(integration.recording.name) as bar:
            state = Run(integration, folder.state, record=folder.record).finish(bar.show)
        files = export_shape(integration.canonical(state.document).view, folder.picks, options.out)
    finally:
        folder.close()
    used = sorted(state.document.used_views)
    print(f"{integration.recording.name}: {len(used)} views integrated ({', '.join(map(str, used))}).")
    print(state.document.finished)
    print(f"Written to {options.out}: {', '.join(f.name for f in files)}")
