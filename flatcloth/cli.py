"""The command line; ``app.py`` and the console script call it. Each command is a module of ``commands``."""

from __future__ import annotations

import argparse
import atexit
import contextlib
import difflib
import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, NoReturn

from flatcloth import __version__
from flatcloth.commands import (
    active,
    batch,
    check,
    evaluate,
    export,
    import_,
    record,
    run,
    schema,
    segment,
    synthesize,
    view,
)
from flatcloth.commands.output import add_output, error, speaking
from flatcloth.core.errors import FlatclothError
from flatcloth.core.resources import sample_recordings

COMMANDS: dict[str, ModuleType] = {
    command.NAME: command
    for command in (
        view,
        run,
        check,
        active,
        segment,
        batch,
        export,
        evaluate,
        import_,
        record,
        synthesize,
        schema,
    )
}
_OWN_OPTIONS = ("-h", "--help", "--version", "--print-completion")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit code: 0, or 2 on bad input (one line on stderr).

    A command may have an exit code of its own, such as 1 of a goal that was not reached.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    if given and (meant := _meant_command(given[0])):
        error(f"{given[0]}: no such command or recording; did you mean 'flatcloth {meant}'?")
        return 2
    if not given or (given[0] not in COMMANDS and given[0].partition("=")[0] not in _OWN_OPTIONS):
        given.insert(0, "view")
    options, unknown = _parser().parse_known_args(given)
    if unknown:
        options.parser.error(_unknown(options.parser, unknown))
    # Its matrices are small: BLAS threads cost more than they bring. numpy is not imported yet.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        # SIGTERM has the effect of Ctrl-C, so that child processes are ended and temporary files removed.
        with _terminated_as_interrupted(), speaking(options):
            return _carried_out(options)
    except FlatclothError as failed:  # the log file cannot be written
        error(str(failed))
        return 2


@contextlib.contextmanager
def _terminated_as_interrupted() -> Iterator[None]:
    """Let SIGTERM do what Ctrl-C does while the block runs; only the main thread can."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _carried_out(options: argparse.Namespace) -> int:
    try:
        status = int(options.run(options) or 0)
        sys.stdout.flush()
    except FlatclothError as failed:
        error(str(failed))
        return 2
    except KeyboardInterrupt:
        error("stopped; what was decided is in the session folder.")
        return 130
    except BrokenPipeError:
        # Who read the output has gone, as in "flatcloth run ... | head"; the work is done or of no use.
        _discard_output()
        return 141
    return status


def run_and_exit() -> NoReturn:
    """Run the command line as a process of its own, and end the process.

    Before, child processes are ended as usual. Unloading modules and kernels would take 0.2 s.
    """
    status = main()
    threads = threading.enumerate()
    if len(threads) == 1 or any(thread.daemon for thread in threads):
        # Not sys.exit: a daemon thread may be in compiled code, which cannot be asked to stop, and may need a
        # minute (kernels that are compiled ahead), so it is not joined. Python before 3.14 unwinds the stack
        # of such a thread when it next asks for the interpreter, and the C++ library in the middle of that
        # stack then aborts the process (status 134 in place of its own). All decisions are on disk by now.
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


def _meant_command(word: str) -> str | None:
    """Return the command that a mistyped first word is like; None if it may be a recording or an option."""
    if word in COMMANDS or word.startswith("-") or word in sample_recordings() or os.path.lexists(word):
        return None
    return next(iter(difflib.get_close_matches(word, COMMANDS, n=1)), None)


def _unknown(parser: argparse.ArgumentParser, words: Sequence[str]) -> str:
    """Return what is wrong with words that no option takes, and which options are like them."""
    known = [name for action in parser._actions for name in action.option_strings]
    text = f"unrecognized arguments: {' '.join(words)}"
    for word in words:
        name = word.partition("=")[0]
        like = difflib.get_close_matches(name, known, n=5) if name.startswith("-") else []
        if like:  # of equally close ones that with the same letters: they are often swapped
            text += f"; did you mean {max(like, key=lambda one: sorted(one) == sorted(name))}?"
    return text


class _PrintCompletion(argparse.Action):
    """Prints the completion script of a shell."""

    def __call__(
        self, parser: argparse.ArgumentParser, _namespace: Any, values: Any, _option: Any = None
    ) -> None:
        """Print the script, and end the program."""
        import shtab

        for command in parser._subparsers._group_actions[0].choices.values():  # type: ignore[union-attr]
            for action in command._actions:
                if action.type is Path:
                    action.complete = shtab.DIRECTORY if action.metavar == "DIR" else shtab.FILE
                elif action.metavar == "SOURCE":
                    action.complete = shtab.FILE
        print(shtab.complete(parser, values))
        parser.exit()


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="flatcloth",
        description="Integrate turned RGB-D views of a hanging garment into its canonical shape.",
        epilog="\n\n".join(command.EXAMPLES for command in COMMANDS.values()),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"flatcloth {__version__}")
    parser.add_argument(
        "--print-completion",
        action=_PrintCompletion,
        choices=("bash", "zsh", "tcsh"),
        help='print the completion script of a shell: eval "$(flatcloth --print-completion bash)"',
    )
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
        add_output(added, has_json="--json" not in added._option_string_actions)
        added.set_defaults(run=command.run, parser=added)
    return parser
