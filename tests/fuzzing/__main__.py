"""Fuzz every input: ``PYTHONPATH=tests python -m fuzzing --count 2500``; see ``--help``."""

from __future__ import annotations

import argparse
import importlib
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
_HEAVY_SHARE = 0.25


def main() -> int:
    options = _options()
    _import_everything()
    if options.replay is not None:
        outcome = _replayed(options.replay)
        print(json.dumps(outcome.__dict__, indent=1))
        return int(outcome.is_fault)
    return fuzz(options.count, options.first, options.only, options.keep)


_TOLD_CASES = 250


def fuzz(count: int, first: int, only: list[str], keep: Path) -> int:
    """Run cases, keep those that fail, print a table; return 1 if any failed."""
    samples = [s for s in SAMPLES if not only or s.name in only]
    seen: list[Outcome] = []
    with tempfile.TemporaryDirectory(prefix="flatcloth-fuzz-") as place:
        originals = built(samples, Path(place) / "originals")
        for outcome in untouched(samples, originals, Path(place) / "case"):
            if outcome.verdict != "result":
                print(f"{outcome.case}: {outcome.verdict} {outcome.said}")
                return 1
        for sample, number in cases(samples, count, first):
            case = Path(place) / "case"
            outcome = run_case(sample, number, originals[sample.name], case)
            seen.append(outcome)
            if outcome.is_fault:
                _keep(outcome, sample, case, keep)
                print(f"{outcome.case}: {outcome.verdict} ({outcome.file}, {outcome.mutation})", flush=True)
            shutil.rmtree(case, ignore_errors=True)
            if len(seen) % _TOLD_CASES == 0:
                faults = sum(o.is_fault for o in seen)
                print(f"{len(seen)} of {count} cases, {faults} faults", file=sys.stderr, flush=True)
    print(table(seen))
    return int(any(outcome.is_fault for outcome in seen))


def cases(samples: list[Sample], count: int, first: int = 0) -> Iterator[tuple[Sample, int]]:
    """Yield the cases: all samples in turn, the heavy ones less often."""
    due = dict.fromkeys((s.name for s in samples), 0.0)
    numbers = dict.fromkeys(due, first)
    done = 0
    while done < count:
        for sample in samples:
            due[sample.name] += _HEAVY_SHARE if sample.heavy and len(samples) > 1 else 1.0
            if due[sample.name] >= 1.0 and done < count:
                due[sample.name] -= 1.0
                yield sample, numbers[sample.name]
                numbers[sample.name] += 1
                done += 1


def built(samples: list[Sample], folder: Path) -> dict[str, Path]:
    """Write the samples, each into a folder of its own."""
    places = {}
    made: dict[object, Path] = {}
    for sample in samples:
        place = folder / sample.name
        if sample.build in made:
            shutil.copytree(made[sample.build], place)
        else:
            place.mkdir(parents=True)
            sample.build(place)
            made[sample.build] = place
        places[sample.name] = place
    return places


def untouched(samples: list[Sample], originals: dict[str, Path], place: Path) -> Iterator[Outcome]:
    """Yield how the samples themselves are read: as long as that is no result, no mutation tells anything."""
    for sample in samples:
        shutil.copytree(originals[sample.name], place)
        yield observed(sample, sample.name, "", "", place)
        shutil.rmtree(place)


def table(seen: list[Outcome]) -> str:
    """Return a line a sample: how many cases ended how, and the slowest and largest of them."""
    heads = f"{'cases':>7}{'errors':>8}{'results':>9}{'faults':>8}{'most CPU s':>12}{'peak MiB':>10}"
    lines = [f"{'sample':<24}{heads}"]
    for name in [*dict.fromkeys(o.case.rsplit("-", 1)[0] for o in seen), ""]:
        of = [o for o in seen if not name or o.case.rsplit("-", 1)[0] == name]
        if not of:
            continue
        ends = Counter(o.verdict if not o.is_fault else "fault" for o in of)
        lines.append(
            f"{name or 'all':<24}{len(of):>7}{ends['error']:>8}{ends['result']:>9}{ends['fault']:>8}"
            f"{max(o.cpu_s for o in of):>12.2f}{max(o.peak_mib for o in of):>10}"
        )
    return "\n".join(lines)


def _keep(outcome: Outcome, sample: Sample, place: Path, keep: Path) -> None:
    kept = keep / outcome.case
    shutil.rmtree(kept, ignore_errors=True)
    kept.mkdir(parents=True)
    (kept / "outcome.json").write_text(json.dumps({"sample": sample.name, **outcome.__dict__}, indent=1))
    os.system(f"cp -a --sparse=always '{place}' '{kept / 'input'}'")


def _replayed(kept: Path) -> Outcome:
    told = json.loads((kept / "outcome.json").read_text())
    sample = next(s for s in SAMPLES if s.name == told["sample"])
    with tempfile.TemporaryDirectory(prefix="flatcloth-fuzz-") as folder:
        place = Path(folder) / "case"
        shutil.copytree(kept / "input", place, symlinks=True)
        return observed(sample, told["case"], told["file"], told["mutation"], place)


def _import_everything() -> None:
    """Load libraries and compiled kernels once: else each forked process does, in half a second of CPU."""
    from flatcloth.engine.warmup import warm_up
    from flatcloth.recordings.files.libraries import load_realsense
    from flatcloth.synthesis.rendering import load_open3d

    for name in _IMPORTED:
        importlib.import_module(name)
    load_realsense()
    load_open3d()
    warm_up()


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m fuzzing", description="Fuzz every input of flatcloth.")
    add = parser.add_argument
    add("--count", type=int, default=2500, metavar="N", help="cases (default: 2500)")
    add("--first", type=int, default=0, metavar="N", help="number of each sample's first case (default: 0)")
    add("--only", nargs="*", default=[], metavar="SAMPLE", help="these samples only")
    add("--keep", type=Path, default=Path("fuzz-failures"), metavar="DIR", help="place of inputs that failed")
    add("--replay", type=Path, metavar="DIR", help="a kept input, once more")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
