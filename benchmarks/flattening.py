"""The figures of flattening: solver against peers, whole frames, accuracy against the truth."""

from __future__ import annotations

import os
import platform
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from typing import TypeVar

import numpy as np

from benchmarks.developable import AXIS, sheets, view_of
from benchmarks.output import RESULTS, Options, processor, save, save_page, say
from benchmarks.peers import BOUND, Method, least_known_energy, methods
from benchmarks.problems import Problem, problem_of, signed_areas
from benchmarks.single_views import accuracy_of_sheets, accuracy_of_views, frame_times
from flatcloth.core.resources import sample_recordings
from flatcloth.core.types import Float64
from flatcloth.engine.warmup import warm_up
from flatcloth.flattening.minimisation import energy_of
from flatcloth.recordings import Recording, open_recording
from flatcloth.recordings.truth import Truth

INTERVALS_PX = (12, 6, 2, 1)
LARGE_PROBLEMS = ("S-curve",)
"""Surfaces that are also sampled at every pixel."""
TIME_LIMIT_S = 15.0
GARMENT_VIEW = 0

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class Row:
    """One method on one problem; ``None`` where it was skipped or failed (``note`` says why).

    ``energy_ratio`` is H over the best H that any method found; ``similarity_fit`` tells that the
    error was measured after a fit with scale, because the method loses it.
    """

    method: str
    surface: str
    garment: bool
    noise_mm: float | None
    sampling_interval_px: int
    n_points: int
    n_pairs: int
    ms: float | None
    rms_mm: float | None
    flips: int | None
    energy_ratio: float | None
    similarity_fit: bool = False
    note: str = ""


def run(options: Options) -> None:
    """Measure everything and write ``results/flattening.{json,md,png}``."""
    from benchmarks.report import draw, table

    opened = [open_recording(source) for source in options.recordings or sample_recordings()]
    quick = options.quick
    say("warming up")
    warm_up()
    rows = solver_rows(opened, quick=quick)
    say("whole frames")
    frames = [frame_times(r, quick=quick) for r in opened if "d435" in r.name]
    say("accuracy on sheets")
    on_sheets = accuracy_of_sheets(sheets().values())
    on_views = []
    for recording in opened:
        say(f"accuracy on {recording.name}")
        on_views.append(accuracy_of_views(recording, quick=quick))
    result = {
        "benchmark": "flattening",
        "machine": machine(),
        "rows": [asdict(row) for row in rows],
        "frame_ms": statistics.median(f["frame_ms"] for f in frames) if frames else None,
        "frames": frames,
        "sheets": on_sheets,
        "views": on_views,
        "notes": {m.name: m.note for m in methods() if m.note},
    }
    text = table(result)
    if not quick:
        save("flattening", result, [r.name for r in opened])
        save_page("flattening", text, [r.name for r in opened])
        draw(result, RESULTS / "flattening.png")
    print(text)


def machine() -> dict[str, str]:
    """Return what the times depend on."""
    packages = ("numpy", "scipy", "numba", "libigl", "open3d", "scikit-learn")
    return {
        "cpu": processor(),
        "cores_used": "1",
        "load_before": f"{os.getloadavg()[0]:.1f}",
        "python": platform.python_version(),
        **{package: version(package) for package in packages},
    }


def problems(recordings: Sequence[Recording], *, quick: bool) -> Iterator[tuple[float | None, Problem]]:
    """Yield the noise (mm) with each problem: sheets without and with noise, one view of each recording."""
    intervals = (12, 6) if quick else INTERVALS_PX
    for sheet in list(sheets().values())[: 2 if quick else None]:
        for seed in (None, 1):
            view = view_of(sheet, noise_seed=seed)
            for d in intervals:
                if d > 1 or sheet.name in LARGE_PROBLEMS:
                    yield (
                        0.0 if seed is None else 1.5,
                        problem_of(sheet.name, view.frame, AXIS, view.flat_uv_m, d),
                    )
    for recording in recordings:
        frame, axis = recording[GARMENT_VIEW], recording.rotation_axis
        if axis is None:
            continue
        truth = Truth(recording.location)[GARMENT_VIEW]
        for d in intervals:
            if d > 1:
                yield None, problem_of(recording.name, frame, axis, truth.flat_uv_m, d, garment=True)


def solver_rows(recordings: Sequence[Recording], *, quick: bool) -> list[Row]:
    """Time every method on every problem, and measure its result."""
    rows: list[Row] = []
    last: dict[tuple[str, str, float | None], tuple[int, float]] = {}
    for noise_mm, problem in problems(recordings, quick=quick):
        say(
            f"{problem.surface}, noise {noise_mm or 0} mm, d = {problem.sampling_interval_px}, "
            f"N = {problem.size}"
        )
        best = least_known_energy(problem)
        found: list[tuple[Method, float | None, Float64 | None, str]] = []
        for method in methods():
            key = (method.name, problem.surface, noise_mm)
            expected = _expected_s(last.get(key), problem.size)
            if problem.size > method.largest:
                found.append((method, None, None, f"skipped: more than {method.largest} points"))
                continue
            if expected > TIME_LIMIT_S:
                found.append((method, None, None, f"skipped: would take about {expected:.0f} s"))
                last[key] = (problem.size, expected)
                continue
            try:
                seconds, uv = timed(
                    lambda method=method, problem=problem, best=best: method.solve(problem, 1.01 * best),
                    once=quick,
                )
            except (RuntimeError, ValueError, np.linalg.LinAlgError) as error:
                found.append((method, None, None, f"failed: {error}"))
                continue
            last[key] = (problem.size, seconds)
            cut = "" if uv is not None or method.name == BOUND else "cut into several charts"
            found.append((method, seconds, uv, cut))
        energies = [
            energy_of(uv, problem.edges, problem.edge_length_m) for _, _, uv, _ in found if uv is not None
        ]
        best = min([best, *energies])
        rows += [_row(problem, noise_mm, best, *item) for item in found]
    return rows


def _expected_s(last: tuple[int, float] | None, size: int) -> float:
    """Guess a time from the last one, smaller, of the same method on the same surface."""
    return 0.0 if last is None else last[1] * (size / last[0]) ** 1.3


def timed(solve: Callable[[], T], *, once: bool = False) -> tuple[float, T]:
    """Return the median time in seconds of several runs after a first one, and the result."""
    started = time.perf_counter()
    result = solve()
    first = time.perf_counter() - started
    if once or first > 2.0:
        return first, result
    times = []
    for _ in range(9 if first < 0.1 else 5 if first < 0.5 else 3):
        started = time.perf_counter()
        result = solve()
        times.append(time.perf_counter() - started)
    return statistics.median(times), result


def _row(
    problem: Problem,
    noise_mm: float | None,
    best: float,
    method: Method,
    seconds: float | None,
    uv: Float64 | None,
    note: str,
) -> Row:
    rms_mm, flips, ratio = None, None, None
    if uv is not None:
        rms_mm, mirrored = error_mm(uv, problem.true_uv_m, method)
        areas = signed_areas(uv * [1.0, -1.0 if mirrored else 1.0], problem.triangles)
        flips = int((areas <= 0).sum())
        if method.keeps_scale:
            ratio = energy_of(uv, problem.edges, problem.edge_length_m) / best
    return Row(
        method=method.name,
        surface=problem.surface,
        garment=problem.garment,
        noise_mm=noise_mm,
        sampling_interval_px=problem.sampling_interval_px,
        n_points=problem.size,
        n_pairs=len(problem.edges),
        ms=None if seconds is None else round(1e3 * seconds, 3),
        rms_mm=None if rms_mm is None else round(rms_mm, 4),
        flips=flips,
        energy_ratio=None if ratio is None else float(f"{ratio:.5g}"),
        similarity_fit=not method.keeps_scale,
        note=note,
    )


def error_mm(uv_m: Float64, true_uv_m: Float64, method: Method) -> tuple[float, bool]:
    """Return the RMS error after the best rigid motion, and whether that mirrors.

    A method that loses the scale is given it back, one that loses the side may be mirrored.
    """
    known = np.isfinite(true_uv_m[:, 0])
    p, q = uv_m[known] - uv_m[known].mean(axis=0), true_uv_m[known] - true_uv_m[known].mean(axis=0)
    target = q[:, 0] + 1j * q[:, 1]
    results = []
    for side in (1.0,) if method.keeps_side else (1.0, -1.0):
        place = p[:, 0] + 1j * side * p[:, 1]
        turn = np.vdot(place, target)
        factor = turn / np.vdot(place, place).real if not method.keeps_scale else turn / abs(turn)
        results.append((1e3 * float(np.sqrt(np.mean(np.abs(factor * place - target) ** 2))), side < 0))
    return min(results)
