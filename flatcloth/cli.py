"""The command line; ``app.py`` and the console script call it. Each command is a module of ``commands``."""

from __future__ import annotations

import argparse
import atexit
import contextlib
import os
import signal
import sys
import threading
from collections.abc import Sequence
from types import ModuleType
from typing import NoReturn

from flatcloth import __version__
from flatcloth.commands import (
    active,
    batch,
    evaluate,
    export,
    import_,
    record,
    run,
    segment,
    synthesize,
    view,
)
from flatcloth.core.errors import FlatclothError
from flatcloth.core.signals import handled_by

COMMANDS: dict[str, ModuleType] = {
    command.NAME: command
    for command in (view, run, active, segment, batch, export, evaluate, import_, record, synthesize)
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit code: 0, or 2 on bad input (one line on stderr).

    A command may have an exit code of its own, such as 1 of a goal that was not reached.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    if not given or (given[0] not in COMMANDS and given[0] not in ("-h", "--help", "--version")):
        given.insert(0, "view")
    options = _parser().parse_args(given)
    # Its matrices are small: BLAS threads cost more than they bring. numpy is not imported yet.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        # SIGTERM has the effect of Ctrl-C, so that child processes are ended and temporary files removed.
        with handled_by(signal.SIGTERM, signal.default_int_handler):
            status = int(options.run(options) or 0)
        sys.stdout.flush()
    except FlatclothError as error:
        print(f"flatcloth: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("flatcloth: stopped; what was decided is in the session folder.", file=sys.stderr)
        return 130
    except BrokenPipeError:
        # Who read the output has gone, as in "flatcloth run ... | head"; the work is done or of no use.
        _discard_output()
        return 141
    return status


def run_and_exit() -> NoReturn:
    """Run the command line as a process of its own, and end the process.

    A background thread may still compute. If Python ended it as usual, in the middle of compiled code,
    the C++ library would abort the process; all decisions are on disk, so the process ends at once. Before,
    child processes are ended as usual. It also spares taking all modules and compiled kernels apart, 0.2 s.
    """
    status = main()
    threads = threading.enumerate()
    if len(threads) == 1 or any(thread.daemon for thread in threads):
        atexit._run_exitfuncs()
        with contextlib.suppress(BrokenPipeError):
            sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
    sys.exit(status)


def _discard_output() -> None:
    """Let nothing more be written to the closed pipe, also not by Python when it ends."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="flatcloth",
        description="Integrate turned RGB-D views of a hanging garment into its canonical shape.",
        epilog="\n\n".join(command.EXAMPLES for command in COMMANDS.values()),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"flatcloth {__version__}")
    commands = parser.add_subparsers(required=True, metavar="{" + ",".join(COMMANDS) + "}")
    for name, command in COMMANDS.items():
        added = commands.add_parser(
            name,
            help=command.SUMMARY,
            description=command.SUMMARY[0].upper() + command.SUMMARY[1:] + ".",
            epilog=command.EXAMPLES,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        command.add_options(added)
        added.set_defaults(run=command.run)
    return parser
