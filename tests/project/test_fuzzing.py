"""Damaged and hostile inputs end in a clear error or a valid result; ``make fuzz`` runs thousands more."""

import os
import subprocess
import sys
from pathlib import Path

TESTS = Path(__file__).parents[1]
KINDS = """folder-manifest folder-jpeg truth tum-lists intrinsic tiff-16 npy pcd camera-file yaml angles
    ros1-bag mcap ros2-folder obj ply-binary journal session hand-eye npz"""
"""A sample of each kind of file that is read."""

SELF_TEST = """
import ctypes, os, sys, tempfile, time
from pathlib import Path
import flatcloth.cli
from fuzzing import cases
from fuzzing.samples import Sample

def told(text, code=2):
    def run(arguments):
        print(text.replace("PLACE", arguments[0]), file=sys.stderr)
        return code
    return run

def late(arguments):
    time.sleep(60)

def busy(arguments):
    while True:
        pass

def crash(arguments):
    ctypes.string_at(0)

def large(arguments):
    data = bytearray(2 ** 31 + 2 ** 28)
    data[:: 4096] = bytes(len(data[:: 4096]))
    return 0

def wrong(arguments):
    raise KeyError("views")

ends = [
    ("result", told("", 0)),
    ("error", told("flatcloth: PLACE/a.png: damaged. Export it again.")),
    ("unclear error", told("flatcloth: damaged. Export it again.")),
    ("error of several lines", told("flatcloth: PLACE/a.png: damaged.\\nExport it again.")),
    ("exit code 1", told("", 1)),
    ("hang", late),
    ("hang", busy),
    ("killed by SIGSEGV", crash),
    ("memory", large),
    ("traceback", wrong),
]
sample = Sample("self", lambda place: None, ("{}",))
for wanted, main in ends:
    flatcloth.cli.main = main
    with tempfile.TemporaryDirectory() as folder:
        cases.TIME_LIMIT_S = 1.0 if main is late else 300.0
        cases.CPU_LIMIT_S = 1 if main is busy else 300
        found = cases.observed(sample, "self-0", "", "", Path(folder)).verdict
    assert found == wanted, (wanted, found)
print("all told apart")
"""


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


def test_each_fault_of_the_program_would_be_noticed(tmp_path: Path) -> None:
    done = run("-c", SELF_TEST, folder=tmp_path)
    assert done.stdout == "all told apart\n", done.stdout + done.stderr
