"""Whether ``flatcloth run`` still gives the results of another commit, file by file and to the last bit.

``--keep DIR`` names a folder of reference results: a recording that it does not hold yet is integrated and
kept there; any other is integrated and compared with what is kept. So a reference is made at one commit, and
a change is compared with it at another, on the same machine (another processor rounds differently).
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.inputs import sources
from benchmarks.output import Options, say

NOT_RESULTS = {"seconds", "created", "written", "version", "versions", "date"}
"""Keys of JSON files that differ between runs of the same commit."""


def run(options: Options) -> None:
    """Compare each recording; end with exit code 1 if any differs."""
    if not options.keep:
        raise SystemExit("same: --keep DIR names the folder of the reference results.")
    differing = 0
    for source in sources(options.recordings):
        kept = Path(options.keep) / Path(source).name
        if kept.exists():
            with tempfile.TemporaryDirectory() as folder:
                integrate(source, Path(folder) / "result")
                found = differences(kept, Path(folder) / "result")
            differing += bool(found)
            say(f"{kept.name}: {'; '.join(found) or 'the same'}")
        else:
            integrate(source, kept)
            say(f"{kept.name}: kept")
    if differing:
        raise SystemExit(f"{differing} recordings differ from {options.keep}.")


def integrate(source: str, out: Path) -> None:
    """Run the command in a process of its own, as a user does."""
    command = [sys.executable, "app.py", "run", source, "--out", str(out)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)


def differences(before: Path, after: Path) -> list[str]:
    """Return a line for each file of results that differs."""
    found = []
    names = {path.name for folder in (before, after) for path in folder.glob("*.npz")}
    for name in sorted({*names, "outcome.json", "garment.json", "grasps.json"}):
        if not (before / name).exists() or not (after / name).exists():
            if (before / name).exists() != (after / name).exists():
                found.append(f"{name} exists only {'before' if (before / name).exists() else 'after'}")
        elif name.endswith(".npz"):
            found += [f"{name}: {line}" for line in array_differences(before / name, after / name)]
        elif without_times(before / name) != without_times(after / name):
            found.append(f"{name} differs")
    return found


def array_differences(before: Path, after: Path) -> list[str]:
    """Return a line for each array that differs, with how much."""
    found = []
    with np.load(before) as old, np.load(after) as new:
        for key in sorted({*old.files, *new.files}):
            if key not in old or key not in new or old[key].shape != new[key].shape:
                found.append(f"{key} has another shape")
            elif not np.array_equal(old[key], new[key], equal_nan=old[key].dtype.kind == "f"):
                changed = old[key] != new[key]
                if old[key].dtype.kind == "f":
                    changed &= ~(np.isnan(old[key]) & np.isnan(new[key]))
                    most = np.nanmax(np.abs(old[key].astype(float) - new[key].astype(float)), initial=0.0)
                    found.append(f"{key} {changed.mean():.2%} by up to {most:.3g}")
                else:
                    found.append(f"{key} {changed.mean():.2%}")
    return found


def without_times(path: Path) -> Any:
    """Return the content of a JSON file without what differs between runs of the same commit."""

    def stripped(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: stripped(v) for key, v in value.items() if key not in NOT_RESULTS}
        return [stripped(v) for v in value] if isinstance(value, list) else value

    return stripped(json.loads(path.read_text()))
