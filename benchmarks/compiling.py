"""Which kernels a typical integration needs: writes flatcloth/engine/kernels.json.

With an empty cache of numba: the first pictures of the bundled recordings, a recording
unattended, a proposal, and its sides found without its masks, with a stroke.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from numba import types
from numba.core import event

from benchmarks.output import Options, say
from benchmarks.unattended import side_solver
from flatcloth.cli import main
from flatcloth.core.resources import sample_recordings
from flatcloth.core.strokes import ImageStroke
from flatcloth.engine.integration import Integration
from flatcloth.engine.warmup import TABLE, kernels
from flatcloth.recordings import open_recording
from flatcloth.session.machine import Command, Propose, SessionState, Start, apply
from flatcloth.viewer.protocol.picture import make_picture

RECORDING = "recordings/shirt-corner-d435"
"""It has floating pieces and layers over each other, so most parts of the method are needed."""
_SHORT = {"float64": "f8", "float32": "f4", "int64": "i8", "int32": "i4", "int16": "i2", "uint8": "u1"}
_SHORT |= {"bool": "b1", "int8": "i1", "complex128": "c16", "uint32": "u4"}


def run(options: Options) -> None:
    """Compile with an empty cache; print what the table lacked, and write the table unless ``quick``."""
    with tempfile.TemporaryDirectory() as folder:
        written = Path(folder) / "seen.json"
        command = [sys.executable, "-m", "benchmarks.compiling", str(written), f"{folder}/session"]
        environment = {**os.environ, "NUMBA_CACHE_DIR": f"{folder}/cache"}
        subprocess.run(command, env=environment, check=True, stdout=subprocess.DEVNULL)
        seen = json.loads(written.read_text())
    called = sorted((line for line in seen if line["depth"] == 0), key=lambda line: str(line["name"]))
    lacked = sorted({line["name"] for line in called} - {kernel.name for kernel in kernels()})
    seconds = sum(line["compile_s"] for line in called)
    say(f"{len(called)} kernels take {seconds:.0f} s of the processor; the table lacked {lacked or 'none'}")
    if not options.quick:
        keys = ("name", "arguments", "compile_s", "first")
        lines = [json.dumps({key: line[key] for key in keys}) for line in called]
        TABLE.write_text("[\n" + ",\n".join(lines) + "\n]\n")


def _watch(written: Path, out: str) -> None:
    """Integrate the recording; write which kernels were compiled, for what, how long, called by whom."""
    seen: list[dict[str, Any]] = []
    is_first = True

    class Listener(event.Listener):  # type: ignore[misc]
        began: list[float] = []  # noqa: RUF012 - one listener

        def on_start(self, _event: Any) -> None:
            self.began.append(time.process_time())

        def on_end(self, ended: Any) -> None:
            compile_s = time.process_time() - self.began.pop()
            function = ended.data["dispatcher"].py_func
            module, _, below = function.__module__.partition(".")
            if module == "flatcloth":
                seen.append(
                    {
                        "name": f"{below}.{function.__qualname__}",
                        "arguments": [_told(argument) for argument in ended.data["args"]],
                        "compile_s": round(compile_s, 2),
                        "depth": len(self.began),
                        "first": is_first,
                    }
                )

    event.register("numba:compile", Listener())
    for name in sample_recordings():
        _drawn(name, Start())
    is_first = False
    main(["run", RECORDING, "--out", out])
    _drawn(RECORDING, Start(), Propose())
    _segment()
    written.write_text(json.dumps(seen))


def _drawn(recording: str, *commands: Command) -> None:
    """Draw what the page of a recording shows after some commands."""
    integration = Integration(open_recording(recording))
    state = SessionState(len(integration.recording))
    for command in commands:
        state = apply(state, command)
        assert state.request is not None
        state = apply(state, integration.answer(state.document, state.request))
    make_picture(integration, state.document, None)


def _segment() -> None:
    """Find the sides of some views, and contradict them: what a recording without masks needs."""
    solver = side_solver(open_recording(RECORDING), every=6)
    view = solver.observed.views[solver.observed.start_view]
    shown = solver.solve(()).view(view.view_index)
    assert shown is not None
    row, col = np.median(np.argwhere((shown.side == 1) & view.surface), axis=0) + view.offset_rc
    solver.solve([ImageStroke(side="other", view_index=view.view_index, points_rc=((row, col),))])


def _told(argument: Any) -> Any:
    """Return a type as the table has it; see :class:`flatcloth.engine.warmup.Kernel`."""
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
