"""``python -m benchmarks [NAME ...]``, all by default: most write their results."""

from __future__ import annotations

import argparse
import os

BENCHMARKS = ("size", "flattening", "page", "canvas", "confidence", "fused", "growth", "reach", "speed")


def pin_to_one_core() -> None:
    """Keep this process on one core; to be called before anything starts threads."""
    for library in ("OMP", "OPENBLAS", "MKL", "NUMBA"):
        os.environ[f"{library}_NUM_THREADS"] = "1"
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("name", nargs="*", choices=[*BENCHMARKS, []], help="which; all by default")
    parser.add_argument(
        "--recordings", nargs="+", default=[], metavar="FOLDER", help="instead of the bundled recordings"
    )
    parser.add_argument("--quick", action="store_true", help="few problems, one repetition, nothing written")
    parser.add_argument("--learn", action="store_true", help="confidence: learn and print new weights")
    arguments = parser.parse_args()
    chosen = arguments.name or BENCHMARKS
    if "size" in chosen:
        from benchmarks import size

        size.run(quick=arguments.quick)  # in processes of its own, with all cores
    if "canvas" in chosen:
        from benchmarks import canvas

        canvas.run(write=not arguments.quick)  # a browser and a server, with all cores
    pin_to_one_core()
    # Imported late: the libraries read their number of threads when they are loaded.
    if "flattening" in chosen:
        from benchmarks.flattening import run

        run(arguments.recordings, quick=arguments.quick)
    if "page" in chosen:
        from benchmarks import page

        page.run()
    if "confidence" in chosen:
        from benchmarks import confidence

        confidence.run(arguments.recordings, learn=arguments.learn)
    if "fused" in chosen:
        from benchmarks import fused

        fused.run(arguments.recordings)
    if "growth" in chosen:
        from benchmarks import growth

        growth.run(arguments.recordings)
    if "reach" in chosen:
        from benchmarks import reach

        reach.run(arguments.recordings, quick=arguments.quick)
    if "speed" in chosen:
        from benchmarks import speed

        speed.run(arguments.recordings, quick=arguments.quick)


if __name__ == "__main__":
    main()
