"""``python -m benchmarks [NAME ...]``, all by default: most write their results."""

from __future__ import annotations

import argparse
import importlib
import os

# Modules with ``run(options)``. Those of ``ON_ALL_CORES`` start processes of their own, or measure what the
# page's threads do together.
ON_ALL_CORES = ("size", "compiling", "page", "canvas", "batch", "strokes")
ASKED_FOR = (
    *("soak", "states", "shape", "confidence", "accuracy", "paper_steps"),
    *("same", "sides", "seams", "strain", "constants", "mutants", "mistakes", "unmended"),
    *("mended_results", "active", "operating", "sensor", "validation", "tables"),
)
"""Run only if named: ``soak`` takes an hour, ``states`` makes recordings, the others are about given ones."""
ON_ONE_CORE = (
    *("flattening", "reliability", "axis", "registration", "noise", "segmentation", "segmented"),
    *("fused", "reach", "garments", "speed", "exports"),
)


def pin_to_one_core() -> None:
    """Keep this process on one core; to be called before anything starts threads."""
    for library in ("OMP", "OPENBLAS", "MKL", "NUMBA"):
        os.environ[f"{library}_NUM_THREADS"] = "1"
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument(
        "name", nargs="*", choices=[*ON_ALL_CORES, *ON_ONE_CORE, *ASKED_FOR, []], help="which; all by default"
    )
    parser.add_argument(
        "--recordings", nargs="+", default=[], metavar="FOLDER", help="instead of the bundled recordings"
    )
    parser.add_argument("--quick", action="store_true", help="few problems, one repetition, nothing written")
    parser.add_argument(
        "--learn",
        action="store_true",
        help="confidence, segmentation: also learn the weights anew, and print them",
    )
    parser.add_argument(
        "--other",
        action="store_true",
        help="segmentation: the operator wants the other panel; writes segmentation_other.json",
    )
    parser.add_argument("--copies", type=int, default=200, help="batch: recordings in all (default: 200)")
    parser.add_argument(
        "--timed", type=int, default=200, help="batch: of them for the throughput (default: 200)"
    )
    parser.add_argument("--views", type=int, default=0, help="batch: views of each (default: all)")
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
    for name in (name for name in ASKED_FOR if name in arguments.name):
        importlib.import_module(f"benchmarks.{name}").run(arguments)
    for group, prepare in ((ON_ALL_CORES, None), (ON_ONE_CORE, pin_to_one_core)):
        chosen = [name for name in group if name in (arguments.name or group)]
        if chosen and prepare is not None:
            prepare()
        for name in chosen:
            importlib.import_module(f"benchmarks.{name}").run(arguments)


if __name__ == "__main__":
    main()
