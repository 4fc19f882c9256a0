"""Programs forked from a process that has loaded the libraries: each start saves about two seconds.

``multiprocessing`` keeps that process. A program started so differs from ``python app.py view`` only in what
was imported before; ``tests/commands/test_cli.py`` starts that as a user does.
"""

import multiprocessing
import os
import signal
import sys
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerProcess

PRELOADED = "tests.preloaded_program"
"""By its name from the checkout, where tests are run: it knows no other path when it imports this."""


def forked(arguments: list[str], folder: str) -> tuple[ForkServerProcess, int]:
    """Start ``flatcloth`` in a folder; return its process, and a file descriptor of all that it prints."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([PRELOADED])
    read, write = os.pipe()
    with Connection(write, readable=False) as output:
        process = context.Process(target=_main, args=(arguments, folder, dict(os.environ), output))
        process.start()
    return process, read


def _main(arguments: list[str], folder: str, environment: dict[str, str], output: Connection) -> None:
    assert PRELOADED in sys.modules, "multiprocessing has not imported it, and does not tell"
    os.dup2(output.fileno(), 1)
    os.dup2(output.fileno(), 2)
    output.close()
    os.chdir(folder)
    os.environ.update(environment)  # of the test; the process that is forked has that of the first one
    signal.signal(signal.SIGINT, signal.default_int_handler)
    from flatcloth.cli import main

    raise SystemExit(main(arguments))
