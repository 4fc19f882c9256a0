"""``python -m benchmarks NAME ...``: measures, prints, and writes ``benchmarks/results``.

A module of this folder that has ``run(options)`` can be named.
"""

from __future__ import annotations

import argparse
import importlib
import os
from pathlib import Path

ON_ONE_CORE = ("garments", "registration", "segmentation", "speed")
"""Their times are those of one core; they are run last."""
BUNDLED = ("accuracy", "flattening", "page", "reliability", "segmentation", "speed")
"""Run if none is named: on the bundled recordings they take minutes, and replace the results of others. Those
left out are about other recordings, take hours, or write what the program reads (``compiling``)."""
NAMES = tuple(
    sorted(path.stem for path in Path(__file__).parent.glob("*.py") if "\ndef run(" in path.read_text())
)


def pin_to_one_core() -> None:
    """Keep this process on one core; to be called before anything starts threads."""
    for library in ("OMP", "OPENBLAS", "MKL", "NUMBA"):
        os.environ[f"{library}_NUM_THREADS"] = "1"
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("name", nargs="*", choices=[*NAMES, []], help=f"by default {', '.join(BUNDLED)}")
    parser.add_argument(
        "--recordings", nargs="+", default=[], metavar="FOLDER", help="instead of the bundled recordings"
    )
    parser.add_argument("--quick", action="store_true", help="few problems, one repetition, nothing written")
    parser.add_argument(
        "--keep",
        default="",
        metavar="DIR",
        help="where what is measured of each recording, constant or mutant is kept; states: its recordings",
    )
    parser.add_argument(
        "--meshes", nargs="+", default=[], metavar="OBJ", help="active, states: hanging meshes"
    )
    parser.add_argument("--against", default="", metavar="FILE", help="shape: figures of another commit")
    parser.add_argument(
        "--sensor", default="stereo", choices=("d435", "stereo"), help="active: noise (default: stereo)"
    )
    parser.add_argument("--starts", type=int, default=3, help="active: start angles of each (default: 3)")
    arguments = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as flatcloth itself does
    # Imported late: the libraries read their number of threads when they are loaded.
    for name in sorted(arguments.name or BUNDLED, key=lambda name: name in ON_ONE_CORE):
        if name in ON_ONE_CORE:
            pin_to_one_core()
        importlib.import_module(f"benchmarks.{name}").run(arguments)


if __name__ == "__main__":
    main()
