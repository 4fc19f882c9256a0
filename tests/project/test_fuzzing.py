"""Damaged and hostile inputs end in a clear error or a valid result; ``make fuzz`` runs thousands more."""

import os
import subprocess
import sys
from pathlib import Path

TESTS = Path(__file__).parents[1]
KINDS = """folder-manifest folder-jpeg truth tum-lists intrinsic tiff-16 npy pcd camera-file yaml angles
    ros1-bag mcap ros2-folder obj ply-binary journal session hand-eye npz"""
"""A sample of each kind of file that is read."""


def run(*arguments: str, folder: Path) -> subprocess.CompletedProcess[str]:
    path = os.pathsep.join([str(TESTS), str(TESTS.parent), os.environ.get("PYTHONPATH", "")])
    return subprocess.run(
        [sys.executable, *arguments],
        env={**os.environ, "PYTHONPATH": path, "OPENBLAS_NUM_THREADS": "1"},
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )


def test_inputs_that_are_damaged_or_hostile_end_in_a_clear_error_or_a_valid_result(tmp_path: Path) -> None:
    options = ["--count", "20", "--keep", str(tmp_path / "failures"), "--only", *KINDS.split()]
    done = run("-m", "fuzzing", *options, folder=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    name, cases, errors, results, faults, *_ = done.stdout.splitlines()[-1].split()
    assert (name, int(cases), int(faults)) == ("all", 20, 0)
    assert int(errors) > 5  # the inputs were really spoiled; the others stayed readable
    assert int(results) > 2
