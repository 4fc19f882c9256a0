"""What compiling the numerics costs on a fresh machine, and which kernels a typical integration needs.

An empty cache of numba: the warm-up's two processes first, then a bundled recording unattended, a proposal,
and its sides found without its masks, with a stroke, which compiles what the table of kernels
(flatcloth/engine/kernels/table.json) lacks. The table is written from what was seen. Processor seconds
depend little on what else the machine does; the clock does.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.output import Options, save
from flatcloth.core.resources import sample_recordings

RECORDING = "recordings/shirt-corner-d435"
"""It has floating pieces and layers over each other, so most parts of the method are needed."""
_SHORT = {"float64": "f8", "float32": "f4", "int64": "i8", "int32": "i4", "int16": "i2", "uint8": "u1"}
_SHORT |= {"bool": "b1", "int8": "i1", "complex128": "c16"}


def run(options: Options) -> None:
    """Compile with an empty cache, print the figures, write them and the table."""
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "NUMBA_CACHE_DIR": f"{folder}/cache"}
        beside = _spent([sys.executable, "-m", "flatcloth.engine.warmup"], environment)
        lines = Path(folder) / "seen.json"
        watch = [sys.executable, "-m", "benchmarks.compiling"]
        missing = _watched([*watch, str(lines), f"{folder}/more"], environment)
        empty = {**environment, "NUMBA_CACHE_DIR": f"{folder}/alone"}
        alone = _watched([*watch, str(lines), f"{folder}/all"], empty)
    specialised = [line["name"] for line in alone["seen"]]
    found = {
        "two_processes_s": beside["clock_s"],
        "two_processes_cpu_s": beside["cpu_s"],
        "one_process_compile_cpu_s": sum(line["compile_s"] for line in alone["seen"] if line["depth"] == 0),
        "kernels": len(set(specialised)),
        "specialisations": len(specialised),
        "missing_in_table": sorted({line["name"] for line in missing["seen"]}),
        "missing_cpu_s": sum(line["compile_s"] for line in missing["seen"] if line["depth"] == 0),
    }
    for key, text in (
        ("two_processes_s", "two processes compile their shares, then the warm-up, s"),
        ("two_processes_cpu_s", "  processor seconds of all three"),
        ("one_process_compile_cpu_s", "processor seconds of compiling, everything in one process"),
        ("kernels", "compiled functions of an integration"),
        ("specialisations", "  their specialisations"),
        ("missing_cpu_s", "processor seconds of compiling what the table lacked"),
    ):
        print(f"{text:<66}{found[key]:10.1f}")
    if found["missing_in_table"]:
        print("the table lacked " + ", ".join(found["missing_in_table"]))
    if not options.quick:
        save("compiling", found, [RECORDING])
        _write_table(alone["seen"])


def _spent(command: list[str], environment: Mapping[str, str]) -> dict[str, float]:
    before, started = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(command, env=dict(environment), check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {"clock_s": time.perf_counter() - started, "cpu_s": cpu_s}


def _watched(command: list[str], environment: Mapping[str, str]) -> dict[str, Any]:
    _spent(command, environment)
    return {"seen": json.loads(Path(command[3]).read_text())}


def _write_table(seen: list[dict[str, Any]]) -> None:
    from flatcloth.engine.kernels.table import TABLE

    keys = ("name", "arguments", "compile_s", "first")
    called = sorted((line for line in seen if line["depth"] == 0), key=lambda line: str(line["name"]))
    lines = [json.dumps({key: line[key] for key in keys}) for line in called]
    TABLE.write_text("[\n" + ",\n".join(lines) + "\n]\n")


def _watch(written: Path, out: str) -> None:
    """Integrate the recording; write which kernels were compiled, for what, how long, called by whom."""
    from numba.core import event

    seen: list[dict[str, Any]] = []
    is_first = True

    class Listener(event.Listener):  # type: ignore[misc]
        began: list[float] = []  # noqa: RUF012 - one listener

        def on_start(self, _event: Any) -> None:
            self.began.append(time.process_time())

        def on_end(self, event: Any) -> None:
            compile_s = time.process_time() - self.began.pop()
            function = event.data["dispatcher"].py_func
            module, _, below = function.__module__.partition(".")
            if module == "flatcloth":
                seen.append(
                    {
                        "name": f"{below}.{function.__qualname__}",
                        "arguments": [_told(argument) for argument in event.data["args"]],
                        "compile_s": round(compile_s, 2),
                        "depth": len(self.began),
                        "first": is_first,
                    }
                )

    event.register("numba:compile", Listener())
    from flatcloth.cli import main
    from flatcloth.engine.warmup import warm_up

    for name in sample_recordings():
        _first_picture(name)
    is_first = False
    warm_up()
    main(["run", RECORDING, "--out", out])
    _propose()
    _segment()
    written.write_text(json.dumps(seen))


def _first_picture(recording: str) -> None:
    """Compute what the page of a recording shows first."""
    from flatcloth.engine.integration import Integration
    from flatcloth.recordings import open_recording
    from flatcloth.session.machine import SessionState, Start, apply
    from flatcloth.viewer.protocol.picture import make_picture

    integration = Integration(open_recording(recording))
    state = apply(SessionState(len(integration.recording)), Start())
    assert state.request is not None
    state = apply(state, integration.answer(state.document, state.request))
    make_picture(integration, state.document, None)


def _propose() -> None:
    """Compute the first proposal of a session, which a run without an operator does not."""
    from flatcloth.engine.integration import Integration
    from flatcloth.recordings import open_recording
    from flatcloth.session.machine import Propose, SessionState, Start, apply
    from flatcloth.viewer.protocol.picture import make_picture

    integration = Integration(open_recording(RECORDING))
    state = SessionState(len(integration.recording))
    for command in (Start(), Propose()):
        state = apply(state, command)
        assert state.request is not None
        state = apply(state, integration.answer(state.document, state.request))
    make_picture(integration, state.document, None)


def _segment() -> None:
    """Find the sides of some views, and contradict them: what a recording without masks needs."""
    from flatcloth.core.config import Config
    from flatcloth.core.strokes import ImageStroke
    from flatcloth.engine.integration import Integration
    from flatcloth.recordings import open_recording
    from flatcloth.segmentation.observed import gather_evidence, observe
    from flatcloth.segmentation.solver import SideSolver

    recording = open_recording(RECORDING)
    integration = Integration(recording)
    frames = [recording[n] for n in range(0, len(recording), 6)]
    solver = SideSolver(
        observe(gather_evidence(frames, integration.axis, integration.views.held_point_m, Config()))
    )
    view = solver.observed.views[solver.observed.start_view]
    shown = solver.solve(()).view(view.view_index)
    assert shown is not None
    row, col = np.median(np.argwhere((shown.side == 1) & view.surface), axis=0) + view.offset_rc
    solver.solve([ImageStroke(side="other", view_index=view.view_index, points_rc=((row, col),))])


def _told(argument: Any) -> Any:
    """Return a type as the table has it; see :class:`flatcloth.engine.kernels.Kernel`."""
    from numba import types

    if isinstance(argument, types.Array):
        colons = [":"] * argument.ndim
        if argument.layout != "A":
            colons[-1 if argument.layout == "C" else 0] = "::1"
        return f"{_SHORT[str(argument.dtype)]}[{','.join(colons)}]"
    if isinstance(argument, types.BaseTuple):
        fields = [_told(one) for one in argument]  # type: ignore[attr-defined]
        kind = getattr(argument, "instance_class", None)
        if kind is None:
            return fields
        return {f"{kind.__module__.partition('.')[2]}.{kind.__qualname__}": fields}
    return _SHORT[str(argument)] if str(argument) in _SHORT else str(argument)


if __name__ == "__main__":
    _watch(Path(sys.argv[1]), sys.argv[2])
