"""Fuzz every input: ``PYTHONPATH=tests python -m fuzzing --count 2500``; see ``--help``."""

import argparse
import importlib
import itertools
import json
import os
import shutil
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # a process with threads cannot be forked

from fuzzing.cases import Outcome, observed, run_case
from fuzzing.samples import SAMPLES, Sample

_IMPORTED = (
    "cv2", "numba", "scipy.sparse.linalg", "rosbags.rosbag1", "rosbags.rosbag2", "trimesh",
    "flatcloth.cli", "flatcloth.recordings.ros.mcap_file", "flatcloth.recordings.ros.rvl",
    "flatcloth.engine.integration", "flatcloth.recordings.ros.recording",
    "flatcloth.recordings.realsense.turned",
    "flatcloth.recordings.registry", "flatcloth.recordings.folder", "flatcloth.recordings.writer",
    "flatcloth.synthesis.recording", "flatcloth.export.session", "flatcloth.engine.outcome",
    "flatcloth.engine.headless", "flatcloth.engine.evaluation",
    "flatcloth.methods.paper.method", "flatcloth.methods.robust.method",
    "flatcloth.commands.evaluate", "flatcloth.commands.export", "flatcloth.commands.import_",
    "flatcloth.commands.run", "flatcloth.commands.synthesize",
)  # fmt: skip
_TOLD_CASES = 250


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m fuzzing", description="Fuzz every input of flatcloth.")
    add = parser.add_argument
    add("--count", type=int, default=2500, metavar="N", help="cases (default: 2500)")
    add("--only", nargs="*", default=[], metavar="SAMPLE", help="these samples only")
    add("--keep", type=Path, default=Path("fuzz-failures"), metavar="DIR", help="place of inputs that failed")
    add("--replay", type=Path, metavar="DIR", help="a kept input, once more")
    options = parser.parse_args()
    _import_everything()
    if options.replay is None:
        return fuzz(options.count, options.only, options.keep)
    told = json.loads((options.replay / "outcome.json").read_text())
    sample = next(s for s in SAMPLES if s.name == told["sample"])
    with tempfile.TemporaryDirectory(prefix="flatcloth-fuzz-") as folder:
        place = Path(folder) / "case"
        shutil.copytree(options.replay / "input", place, symlinks=True)
        outcome = observed(sample, told["case"], told["file"], told["mutation"], place)
    print(json.dumps(outcome.__dict__, indent=1))
    return int(outcome.is_fault)


def fuzz(count: int, only: list[str], keep: Path) -> int:
    """Run cases, keep those that fail, print a table; return 1 if any failed."""
    samples = [s for s in SAMPLES if not only or s.name in only]
    seen: list[Outcome] = []
    originals: dict[object, Path] = {}
    with tempfile.TemporaryDirectory(prefix="flatcloth-fuzz-") as folder:
        case = Path(folder) / "case"
        for sample in samples:
            if sample.build not in originals:
                originals[sample.build] = place = Path(folder) / sample.name
                place.mkdir()
                sample.build(place)
            # As long as that is no result, no mutation tells anything.
            shutil.copytree(originals[sample.build], case)
            outcome = observed(sample, sample.name, "", "", case)
            shutil.rmtree(case)
            if outcome.verdict != "result":
                print(f"{outcome.case}: {outcome.verdict} {outcome.said}")
                return 1
        for sample, number in cases(samples, count):
            outcome = run_case(sample, number, originals[sample.build], case)
            seen.append(outcome)
            if outcome.is_fault:
                kept = keep / outcome.case
                shutil.rmtree(kept, ignore_errors=True)
                kept.mkdir(parents=True)
                told = json.dumps({"sample": sample.name, **outcome.__dict__}, indent=1)
                (kept / "outcome.json").write_text(told)
                os.system(f"cp -a --sparse=always '{case}' '{kept / 'input'}'")
                print(f"{outcome.case}: {outcome.verdict} ({outcome.file}, {outcome.mutation})", flush=True)
            shutil.rmtree(case, ignore_errors=True)
            if len(seen) % _TOLD_CASES == 0:
                faults = sum(o.is_fault for o in seen)
                print(f"{len(seen)} of {count} cases, {faults} faults", file=sys.stderr, flush=True)
    print(table(seen))
    return int(any(outcome.is_fault for outcome in seen))


def cases(samples: list[Sample], count: int) -> Iterator[tuple[Sample, int]]:
    """Yield the cases: all samples in turn, the heavy ones in every fourth round."""
    rounds = ((s, n) for n in itertools.count() for s in samples if n % 4 == 0 or not s.heavy)
    return itertools.islice(rounds, count)


def table(seen: list[Outcome]) -> str:
    """Return a line a sample: how many cases ended how."""
    lines = [f"{'sample':<24}{'cases':>7}{'errors':>8}{'results':>9}{'faults':>8}"]
    for name in [*dict.fromkeys(o.case.rsplit("-", 1)[0] for o in seen), ""]:
        ends = Counter(
            "fault" if o.is_fault else o.verdict for o in seen if o.case.rsplit("-", 1)[0] == name or not name
        )
        numbers = f"{ends['error']:>8}{ends['result']:>9}{ends['fault']:>8}"
        lines.append(f"{name or 'all':<24}{ends.total():>7}{numbers}")
    return "\n".join(lines)


def _import_everything() -> None:
    """Load libraries and compiled kernels once: else each forked process does, in half a second of CPU."""
    from flatcloth.engine.warmup import compile_share
    from flatcloth.recordings.files.libraries import load_realsense
    from flatcloth.synthesis.rendering import load_open3d

    for name in _IMPORTED:
        importlib.import_module(name)
    load_realsense()
    load_open3d()
    compile_share(0, 1)


if __name__ == "__main__":
    sys.exit(main())
