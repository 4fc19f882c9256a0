"""One case: a sample, changed as its number tells, read by the command line in a process of its own.

The process is forked from one that has everything imported, may take 10 s of CPU time and 2 GiB, and its end
is looked at: a clear error, a valid result, or a fault of the program. CPU time, so that other work on the
machine makes no faults; one that only waits is ended after a minute.
"""

import contextlib
import io
import os
import random
import resource
import shutil
import signal
import sys
import time
import traceback
from dataclasses import dataclass
from pathlib import Path

from fuzzing.mutations import mutated
from fuzzing.samples import Sample

CPU_LIMIT_S = 10
TIME_LIMIT_S = 300.0  # a busy machine once made two seconds of CPU a minute; loops end by the CPU limit
MEMORY_LIMIT_BYTES = 2 * 2**30
_ADDRESS_SPARE_BYTES = 3 * 2**30
"""A bomb must not take the machine down before it is measured."""
_TRACEBACK = 97


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """How a case ended: ``verdict`` is ``result``, ``error`` or the fault; ``said`` is what was printed."""

    case: str
    file: str
    mutation: str
    verdict: str
    said: str

    @property
    def is_fault(self) -> bool:
        return self.verdict not in ("result", "error")


def run_case(sample: Sample, number: int, original: Path, place: Path) -> Outcome:
    """Copy the sample to ``place``, change it, and read it."""
    shutil.copytree(original, place, symlinks=True)
    rng = random.Random(f"{sample.name}/{number}")
    files = sorted({f for pattern in sample.files for f in place.glob(pattern) if f.is_file()})
    file = rng.choice(files)
    told = file.relative_to(place).as_posix()
    mutation = mutated(file, rng)
    return observed(sample, f"{sample.name}-{number}", told, mutation, place)


def observed(sample: Sample, case: str, file: str, mutation: str, place: Path) -> Outcome:
    """Read the sample at ``place`` in a forked process and say how it ended."""
    words = place.with_name(place.name + ".said")
    started = time.monotonic()
    sys.stdout.flush()
    sys.stderr.flush()
    pid = os.fork()
    if pid == 0:
        _child(sample, place, words)
    status, usage = _waited(pid, started)
    waited_s = time.monotonic() - started
    said = words.read_text(errors="backslashreplace") if words.exists() else ""
    words.unlink(missing_ok=True)
    peak = usage.ru_maxrss * 1024
    verdict = _verdict(sample, status, waited_s, peak, said, place)
    return Outcome(case=case, file=file, mutation=mutation, verdict=verdict, said=said)


def _waited(pid: int, started: float) -> tuple[int, resource.struct_rusage]:
    while True:
        found, status, usage = os.wait4(pid, os.WNOHANG)
        if found:
            return status, usage
        if time.monotonic() - started > TIME_LIMIT_S:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(pid, signal.SIGKILL)
            _, status, usage = os.wait4(pid, 0)
            return status, usage
        time.sleep(0.002)


def _verdict(sample: Sample, status: int, waited_s: float, peak: int, said: str, place: Path) -> str:
    if os.WIFSIGNALED(status):
        number = os.WTERMSIG(status)
        late = number == signal.SIGXCPU or (number == signal.SIGKILL and waited_s >= TIME_LIMIT_S)
        return "hang" if late else f"killed by {signal.Signals(number).name}"
    if peak > MEMORY_LIMIT_BYTES:
        return "memory"
    code = os.WEXITSTATUS(status)
    if code == _TRACEBACK or "Traceback" in said:
        return "traceback"
    if code == 0:
        return "result"
    if code != 2:
        return f"exit code {code}"
    errors = [line for line in said.splitlines() if line.startswith("flatcloth: ")]
    if len(errors) != 1 or said.rstrip("\n").splitlines()[-1] != errors[0]:
        return "error of several lines"
    text = errors[0]
    if str(place) not in text or not text.isprintable() or len(text) > 1500 or not text.endswith((".", ")")):
        return "unclear error"
    return "error"


def _child(sample: Sample, place: Path, words: Path) -> None:
    """Run the command with limits; never returns."""
    code = _TRACEBACK
    try:
        os.setpgid(0, 0)
        with open("/proc/self/statm") as file:
            used = int(file.read().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + _ADDRESS_SPARE_BYTES,) * 2)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_CPU, (CPU_LIMIT_S, CPU_LIMIT_S + 1))
        fd = os.open(words, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
        native = os.open(os.devnull, os.O_WRONLY)
        os.dup2(native, 1)
        os.dup2(native, 2)
        sys.stdout = io.StringIO()
        sys.stderr = open(fd, "w", buffering=1, errors="backslashreplace")  # noqa: SIM115
        code = _read(sample, place)
    except BaseException:  # noqa: BLE001
        traceback.print_exc()
    finally:
        sys.stderr.flush()
        os._exit(code)


def _read(sample: Sample, place: Path) -> int:
    from flatcloth.cli import main

    if sample.command[0] == "read_shape":
        return _read_shape(place)
    code = main([word.replace("{}", str(place)) for word in sample.command])
    if code == 0 and sample.command[0] in ("import", "synthesize"):
        from flatcloth.recordings import open_recording

        made = open_recording(place / ("imported" if sample.command[0] == "import" else "made"))
        for view in range(len(made)):
            assert made[view].depth_m.dtype.kind == "f"
    return code


def _read_shape(place: Path) -> int:
    """Read the exported shape as a program that uses the package does."""
    from flatcloth.core.errors import FlatclothError
    from flatcloth.export.data import read_shape

    try:
        view = read_shape(place / "session/flattened.npz")
    except FlatclothError as error:
        sys.stderr.write(f"flatcloth: {error}\n")
        return 2
    assert view.xyz_m.shape == (*view.valid.shape, 3)
    return 0
