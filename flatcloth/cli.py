"""The command line; ``app.py`` and the console script call it. Each command is a module of ``commands``."""

from __future__ import annotations

import argparse
import atexit
import contextlib
import difflib
import importlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NoReturn

from flatcloth import __version__
from flatcloth.core.errors import FlatclothError
from flatcloth.core.plain_files import is_text
from flatcloth.core.resources import sample_recordings

COMMANDS = (
    "view",
    "run",
    "check",
    "active",
    "segment",
    "batch",
    "export",
    "evaluate",
    "import",
    "record",
    "synthesize",
    "kit",
    "validate",
)
_OWN_OPTIONS = ("-h", "--help", "--version", "--print-completion")
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_STOPPED = 130
"""The exit code after one of them; see docs/commands.md."""
_WORDS = "stopped; what was decided is in the session folder."
_AGAIN_S = 0.05
"""From a lost interrupt to the next. Chosen."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit code: 0, or 2 on bad input (one line on stderr).

    A command may have an exit code of its own, such as 1 of a goal that was not reached.
    """
    from flatcloth.commands.options import options_of
    from flatcloth.commands.output import error, escape_what_cannot_be_encoded, speaking

    escape_what_cannot_be_encoded()
    given = list(sys.argv[1:] if arguments is None else arguments)
    for word in (*given, os.environ.get("PWD", "")):
        if not is_text(word):  # nor could a session or a recording name it
            encoding = sys.getfilesystemencoding()
            remedy = "Rename the file or folder." if encoding == "utf-8" else "Set PYTHONUTF8=1."
            error(f"{word!a}: not a name in the encoding {encoding}. {remedy}")
            return 2
    if given and (meant := _meant_command(given[0])):
        error(f"{given[0]}: no such command or recording; did you mean 'flatcloth {meant}'?")
        return 2
    if not given or (given[0] not in COMMANDS and given[0].partition("=")[0] not in _OWN_OPTIONS):
        given.insert(0, "view")
    parsed, unknown = _parser(given[0]).parse_known_args(given)
    if unknown:
        parsed.parser.error(_unknown(parsed.parser, unknown))
    options = options_of(parsed.command.Options, parsed)
    # Its matrices are small: BLAS threads cost more than they bring. numpy is not imported yet.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    stop = _Stop()
    try:
        with stop.heard(), speaking(options):
            return _carried_out(lambda: parsed.command.run(options), stop)
    except FlatclothError as failed:  # the log file cannot be written
        error(str(failed))
        return 2
    except KeyboardInterrupt:  # before the command has begun, or after its end
        error(_WORDS)
        return _STOPPED


def _carried_out(run: Callable[[], int | None], stop: _Stop) -> int:
    from flatcloth.commands.output import error

    try:
        status = int(run() or 0)
        sys.stdout.flush()
        return status
    except BrokenPipeError:
        # Who read the output has gone, as in "flatcloth run ... | head"; the work is done or of no use.
        _discard_output()
        return 141
    except SystemExit:  # a command has ended by itself, with words of its own
        raise
    except BaseException as failed:
        # What the signal has interrupted may have made another error of it, as compiled functions do.
        if stop.asked or isinstance(failed, KeyboardInterrupt):
            error(_WORDS)
            return _STOPPED
        if isinstance(failed, FlatclothError):
            error(str(failed))
            return 2
        raise


class _Stop:
    """Ends a command at a signal, so that child processes are ended and temporary files removed."""

    asked = False
    _timer: threading.Timer | None = None

    @contextlib.contextmanager
    def heard(self) -> Iterator[None]:
        """Raise ``KeyboardInterrupt`` in the block at a signal; only the main thread can."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        # A signal that is ignored, as by nohup, stays so.
        before = {n: h for n in _SIGNALS if (h := signal.getsignal(n)) is not signal.SIG_IGN}
        unraisable, in_thread = sys.unraisablehook, threading.excepthook
        try:
            sys.unraisablehook = lambda lost: self._again(lost) if self.asked else unraisable(lost)
            threading.excepthook = lambda lost: None if self.asked else in_thread(lost)
            for number in before:
                signal.signal(number, self._ask)
            yield
        finally:
            if self._timer is not None:
                self._timer.cancel()
            for number, handler in before.items():
                signal.signal(number, handler)
            sys.unraisablehook, threading.excepthook = unraisable, in_thread

    def _ask(self, _number: int, _frame: object) -> None:
        self.asked = True
        raise KeyboardInterrupt

    def _again(self, lost: sys.UnraisableHookArgs) -> None:
        """Ask again if a callback of compiled code has lost the interrupt, once that has returned."""
        if isinstance(lost.exc_value, KeyboardInterrupt):
            here = threading.get_ident()
            self._timer = threading.Timer(_AGAIN_S, signal.pthread_kill, [here, signal.SIGINT])
            self._timer.daemon = True
            self._timer.start()


def run_and_exit() -> NoReturn:
    """Run the command line as a process of its own, and end the process.

    Before, child processes are ended as usual. Unloading modules and kernels would take 0.2 s.
    """
    for number in _SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(
                number, lambda *_: os._exit(_STOPPED)
            )  # until a command runs, nothing is to be ended
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


def _parser(word: str) -> argparse.ArgumentParser:
    """Return the parser of a command, or of all of them if the first word is none."""
    from flatcloth.commands.options import add_options

    # Loaded only now: a signal in the first milliseconds is not heard yet.
    modules = {
        name: importlib.import_module(f"flatcloth.commands.{'import_' if name == 'import' else name}")
        for name in ((word,) if word in COMMANDS else COMMANDS)
    }
    parser = argparse.ArgumentParser(
        prog="flatcloth",
        description="Integrate turned RGB-D views of a hanging garment into its canonical shape.",
        epilog="\n\n".join(command.EXAMPLES for command in modules.values()),
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
    for name, command in modules.items():
        added = commands.add_parser(
            name,
            help=command.SUMMARY,
            description=command.SUMMARY[0].upper() + command.SUMMARY[1:] + ".",
            epilog=command.EXAMPLES,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        add_options(added, command.Options)
        added.set_defaults(command=command, parser=added)
    return parser
