"""A large recording: how long it takes to open, and how much memory looking and a whole run take.

72 views of 720 x 1280 px of the bundled mesh, simulated with a D435's noise, or the recording that is asked
for. Each figure is of a process of its own, as ``flatcloth run`` is. What the machine was doing besides is
written with the figures: times on a busy machine are upper bounds, the processor's own times (``cpu``) hold
on any.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time

from benchmarks.output import Options, Row, save, say
from flatcloth.core.resources import sample_mesh

CAMERA = ("--size", "720", "1280", "--focal", "640", "--sensor", "d435")
STEP_DEG, QUICK_STEP_DEG = "5", "60"

OPEN = """
import json, sys, time
started = time.perf_counter()
from flatcloth.engine.integration import Integration
from flatcloth.recordings import open_recording
imported = time.perf_counter()
recording = open_recording(sys.argv[1])
Integration(recording)
found = {"import_s": imported - started, "open_s": time.perf_counter() - imported}
print(json.dumps({"views": len(recording), **found}))
"""

LOOK = """
import json, sys
from flatcloth.core.errors import FlatclothError
from flatcloth.engine.integration import Integration
from flatcloth.recordings import open_recording
made = Integration(open_recording(sys.argv[1]))
for view in range(len(made.recording)):
    made.views.cloud(view)
    try:
        made.views.flattening(view)
    except FlatclothError:
        pass
"""

COMMAND = """
import json, sys
from flatcloth.cli import main
assert main(sys.argv[1:]) == 0
"""


def run(options: Options) -> None:
    """Measure, print and write ``results/size.json`` unless ``quick``."""
    with tempfile.TemporaryDirectory() as place:
        folder = options.recordings[0] if options.recordings else f"{place}/large"
        if not options.recordings:
            step = QUICK_STEP_DEG if options.quick else STEP_DEG
            _child(COMMAND, "synthesize", str(sample_mesh()), "--out", folder, "--step", step, *CAMERA)
        before = os.getloadavg()
        opened = [_child(OPEN, folder) for _ in range(5)]
        # What else the machine does only makes one slower.
        found = min(opened, key=lambda each: float(each["open_s"]))
        looked, ran = _child(LOOK, folder), _child(COMMAND, "run", folder, "--out", f"{place}/result")
        for name, spent in (("looked_at_and_flattened", looked), ("run", ran)):
            found |= {f"{name}_{key}": value for key, value in spent.items()}
        found |= {"load": before, "load_after": os.getloadavg()}
    for key, value in found.items():
        say(f"{key} {value}")
    if not options.quick:
        save("size", found, [folder])


def _child(code: str, *arguments: str) -> Row:
    """Run Python code in a new process; return what it printed, its time and its peak memory."""
    started = time.perf_counter()
    wrapped = (
        f"{code}\nimport resource\n"
        "print(json.dumps({'peak_mib': resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024}))"
    )
    command = [sys.executable, "-c", wrapped, *arguments]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    found: Row = {"seconds": round(time.perf_counter() - started, 2)}
    for line in done.stdout.splitlines():
        if line.startswith("{"):
            found |= {key: round(value, 2) for key, value in json.loads(line).items()}
    return found
