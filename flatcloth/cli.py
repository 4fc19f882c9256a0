"""The command line: ``view``, ``run`` and ``evaluate``; ``app.py`` and the console script call it."""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flatcloth import __version__
from flatcloth.errors import FlatclothError

if TYPE_CHECKING:
    from flatcloth.integration import Integration

COMMANDS = ("view", "run", "evaluate")
METHODS = ("paper",)
DEFAULT_SAMPLE = "shirt-sleeve-clean"

_EXAMPLES = {
    "view": """examples:
  python app.py                                    the page, on a bundled recording
  python app.py view recordings/trousers-waist-d435
  python app.py view my-recording --port 9000 --session my-session
  python app.py view recordings/shirt-corner-d435 --live      play it as if the camera saw it now""",
    "run": """examples:
  python app.py run recordings/shirt-sleeve-clean --out result
  python app.py run my-recording --out result --method paper""",
    "evaluate": """examples:
  python app.py evaluate recordings/*-d435
  python app.py evaluate recordings/shirt-sleeve-clean --json figures.json --pictures pictures""",
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit code: 0, or 2 on bad input (one line on stderr)."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    if not given or (given[0] not in COMMANDS and given[0] not in ("-h", "--help", "--version")):
        given.insert(0, "view")
    options = _parser().parse_args(given)
    try:
        options.command(options)
    except FlatclothError as error:
        print(f"flatcloth: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("flatcloth: stopped; what was decided is in the session folder.", file=sys.stderr)
        return 130
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="flatcloth",
        description="Integrate turned RGB-D views of a hanging garment into its canonical shape.",
        epilog="\n\n".join(_EXAMPLES.values()),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"flatcloth {__version__}")
    commands = parser.add_subparsers(required=True, metavar="{" + ",".join(COMMANDS) + "}")

    view = _command(commands, "view", "open the operator page (the default command)", _view)
    view.add_argument(
        "source",
        nargs="?",
        default=DEFAULT_SAMPLE,
        metavar="SOURCE",
        help="recording folder, or the name of a bundled recording (default: %(default)s)",
    )
    _add_method(view)
    view.add_argument("--host", default="127.0.0.1", help="address to listen on (default: this machine only)")
    view.add_argument(
        "--port", type=_port, default=8080, help="port of the page, 0 for any free one (default: 8080)"
    )
    view.add_argument(
        "--session",
        type=Path,
        metavar="DIR",
        help="session folder, resumed if it exists (default: one per recording in the user's state folder)",
    )

    view.add_argument(
        "--live",
        action="store_true",
        help="play the recording as if live, flattening each frame; nothing is decided",
    )
    view.add_argument(
        "--fps",
        type=_fps,
        metavar="N",
        help="with --live: frames a second to begin with (default: 30)",
    )

    run = _command(commands, "run", "integrate unattended and export the result", _run)
    run.add_argument("source", metavar="SOURCE", help="recording folder, or the name of a bundled recording")
    run.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="session folder to write; resumed if it exists"
    )
    _add_method(run)

    evaluate = _command(commands, "evaluate", "integrate unattended and compare with the truth", _evaluate)
    evaluate.add_argument(
        "sources", nargs="+", metavar="SOURCE", help="synthetic recording folders, or bundled names"
    )
    _add_method(evaluate)
    evaluate.add_argument("--json", type=Path, metavar="FILE", help="write the figures to FILE")
    evaluate.add_argument(
        "--pictures", type=Path, metavar="DIR", help="write a picture of each result beside its truth to DIR"
    )
    return parser


def _command(commands: Any, name: str, text: str, function: Any) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(
        name,
        help=text,
        description=text[0].upper() + text[1:] + ".",
        epilog=_EXAMPLES[name],
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(command=function)
    return parser


def _add_method(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--method",
        choices=METHODS,
        default=METHODS[0],
        help="way of integrating the views (default: %(default)s)",
    )


def _port(text: str) -> int:
    if not text.isascii() or not text.isdigit() or int(text) > 65535:
        raise argparse.ArgumentTypeError(f"{text!r} is not a port; give a number from 0 to 65535")
    return int(text)


def _fps(text: str) -> float:
    try:
        fps = float(text)
    except ValueError:
        fps = math.nan
    if not 0 < fps <= 240:
        raise argparse.ArgumentTypeError(f"{text!r} is not a frame rate; give a number above 0, up to 240")
    return fps


def _integration(source: str, method: str) -> Integration:
    from flatcloth.integration import Integration
    from flatcloth.recordings import open_recording

    return Integration(open_recording(source), method=method)


def _view(options: argparse.Namespace) -> None:
    from flatcloth.journal import SessionFolder, default_session_folder
    from flatcloth.live import LivePlayer
    from flatcloth.viewer import serve

    if options.fps is not None and not options.live:
        raise FlatclothError("--fps is the rate of --live; give both, or neither.")
    integration = _integration(options.source, options.method)
    path = options.session or default_session_folder(
        integration.recording, options.method, integration.config
    )
    folder = SessionFolder.open(path, integration.recording, integration.config, options.method)
    try:
        serve(
            integration,
            folder,
            host=options.host,
            port=options.port,
            player=LivePlayer(integration) if options.live else None,
            fps=options.fps or 30.0,
        )
    finally:
        folder.close()


def _run(options: argparse.Namespace) -> None:
    from flatcloth.export import export_shape
    from flatcloth.journal import SessionFolder
    from flatcloth.pipeline import Run

    integration = _integration(options.source, options.method)
    folder = SessionFolder.open(options.out, integration.recording, integration.config, options.method)
    try:
        with _ProgressBar(integration.recording.name) as bar:
            state = Run(integration, folder.state, record=folder.record).finish(bar.show)
        files = export_shape(integration.canonical(state.document).view, folder.picks, options.out)
    finally:
        folder.close()
    used = sorted(state.document.used_views)
    print(f"{integration.recording.name}: {len(used)} views integrated ({', '.join(map(str, used))}).")
    print(state.document.finished)
    print(f"Written to {options.out}: {', '.join(f.name for f in files)}")


def _evaluate(options: argparse.Namespace) -> None:
    rows = []
    print(_table_head())
    for source in options.sources:
        row = _evaluate_one(source, options)
        rows.append(row)
        print(_table_row(row), flush=True)
    if options.json is not None:
        try:
            options.json.parent.mkdir(parents=True, exist_ok=True)
            options.json.write_text(json.dumps(rows, indent=1) + "\n")
        except OSError as error:
            raise FlatclothError(
                f"{options.json}: cannot be written ({error}); choose another file."
            ) from error


def _evaluate_one(source: str, options: argparse.Namespace) -> dict[str, Any]:
    from flatcloth.evaluation import compare
    from flatcloth.pipeline import Run
    from flatcloth.recordings.truth import read_truth
    from flatcloth.session import SessionState

    integration = _integration(source, options.method)
    recording = integration.recording
    truth = read_truth(recording.location)
    started = time.perf_counter()
    with _ProgressBar(recording.name) as bar:
        state = Run(integration, SessionState(len(recording))).finish(bar.show)
    view = integration.canonical(state.document).view
    seconds = time.perf_counter() - started
    comparison = compare(view, truth, recording)
    if options.pictures is not None:
        _write_picture(options.pictures, recording.name, comparison)
    return {
        "recording": recording.name,
        "method": options.method,
        **dataclasses.asdict(comparison.evaluation),
        "views": sorted(state.document.used_views),
        "seconds": round(seconds, 2),
    }


def _write_picture(folder: Path, name: str, comparison: Any) -> None:
    import cv2

    from flatcloth.evaluation import picture

    folder.mkdir(parents=True, exist_ok=True)
    file = folder / f"{name}.png"
    if not cv2.imwrite(str(file), picture(comparison)[..., ::-1]):
        raise FlatclothError(f"{file}: cannot be written; choose another folder.")


_COLUMNS: tuple[tuple[str, str, str], ...] = (
    ("absolute_median_mm", "abs med", "{:.1f}"),
    ("absolute_p95_mm", "p95", "{:.1f}"),
    ("absolute_rms_mm", "rms", "{:.1f}"),
    ("absolute_far_share", ">20mm", "{:.1%}"),
    ("relative_median_mm", "rel med", "{:.1f}"),
    ("relative_p95_mm", "p95", "{:.1f}"),
    ("relative_far_share", ">20mm", "{:.1%}"),
    ("wrong_side_share", "wrong side", "{:.2%}"),
    ("coverage", "coverage", "{:.3f}"),
)


def _table_head() -> str:
    return f"{'recording':<24}" + "".join(f"{head:>11}" for _, head, _ in _COLUMNS) + f"{'views':>7}{'s':>7}"


def _table_row(row: dict[str, Any]) -> str:
    cells = "".join(f"{form.format(row[key]):>11}" for key, _, form in _COLUMNS)
    return f"{row['recording']:<24}{cells}{len(row['views']):>7}{row['seconds']:>7.1f}"


class _ProgressBar:
    """A bar on stderr where that is a terminal; else nothing, so that logs stay readable."""

    def __init__(self, title: str) -> None:
        self._title = title
        self._shown = sys.stderr.isatty()

    def __enter__(self) -> _ProgressBar:
        return self

    def __exit__(self, *_: object) -> None:
        if self._shown:
            print("\r\033[K", end="", file=sys.stderr, flush=True)

    def show(self, share: float, text: str) -> None:
        if self._shown:
            filled = math.floor(20 * share)
            bar = "#" * filled + "." * (20 - filled)
            print(f"\r\033[K{self._title} [{bar}] {text}", end="", file=sys.stderr, flush=True)
