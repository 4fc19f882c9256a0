"""How long a recording takes unattended, and its parts, in units U that hold on any machine.

U is the time in which SciPy's SuperLU (symmetric mode, MMD_AT_PLUS_A) factors the five-point Laplacian
of a grid of 110 x 110, measured in the same run on the same core. Warm times include the reading of the
files. Proposals are those of a session that decides about one view at a time: from *Step* to the picture of
the proposal.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np
from scipy.sparse import csc_matrix, diags_array, eye_array, kron
from scipy.sparse.linalg import splu

from benchmarks.inputs import measure_each
from benchmarks.output import Options, Row
from flatcloth.core.errors import FlatclothError
from flatcloth.engine.headless import Run
from flatcloth.engine.integration import Integration
from flatcloth.recordings import open_recording
from flatcloth.session.document import UNSURE, Document
from flatcloth.session.machine import Accept, MemorySession, Propose, Reject, SessionState, apply
from flatcloth.viewer.protocol.picture import make_picture

REPEATS = 3
GRID = 110


def unit_s(repeats: int = 9, clock: Callable[[], float] = time.perf_counter) -> float:
    """Return U in seconds, the least of several."""
    along = diags_array([-np.ones(GRID - 1), 2 * np.ones(GRID), -np.ones(GRID - 1)], offsets=[-1, 0, 1])
    one = eye_array(GRID)
    matrix = csc_matrix(kron(along, one) + kron(one, along) + 1e-6 * eye_array(GRID * GRID))
    options = {"SymmetricMode": True}
    return best_s(
        lambda: splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options),
        repeats,
        clock,
    )


def best_s(work: Callable[[], Any], repeats: int, clock: Callable[[], float] = time.perf_counter) -> float:
    """Return the least time of some calls."""
    times = []
    for _ in range(repeats):
        began_s = clock()
        work()
        times.append(clock() - began_s)
    return min(times)


def run(options: Options) -> None:
    """Measure and print; write ``results/speed.json`` unless ``quick``."""
    repeats = 1 if options.quick else REPEATS
    measure_each("speed", lambda source: [row_of(source, repeats)], options)


def row_of(source: str, repeats: int) -> Row:
    """Return the best of several times after one run to warm up, in units U of the same minutes."""
    views = whole_s(source)[1]
    unit, steps, whole = unit_s(), [], []
    for _ in range(repeats):
        steps.append(proposals_s(source))
        whole.append(whole_s(source)[0])
        unit = min(unit, unit_s())
    proposals = np.min(steps, axis=0)
    return {
        "recording": open_recording(source).name,
        "unit_ms": round(1e3 * unit, 1),
        "flatten a frame, U": round(frame_s(source) / unit, 2),
        "from *Step* to the picture of the proposal, at the second view, U": round(
            float(proposals[0]) / unit, 2
        ),
        "a proposal, median, U": round(float(np.median(proposals)) / unit, 2),
        "at the last view, U": round(float(proposals[-1]) / unit, 2),
        "the slowest proposal, U": round(float(proposals.max()) / unit, 2),
        "views": views,
        "integrate all views of one side, U": round(min(whole) / unit, 1),
    }


def whole_s(source: str) -> tuple[float, int]:
    """Integrate from the files to the canonical view; return seconds and the number of views."""
    began_s = time.perf_counter()
    integration = Integration(recording := open_recording(source))
    document = Run(integration, MemorySession(SessionState(len(recording)))).finish().document
    integration.canonical(document)
    return time.perf_counter() - began_s, len(document.used_views)


def proposals_s(source: str) -> list[float]:
    """Return how long each proposal took, drawn, one after the other; they are decided by their scores."""
    integration, times = Integration(open_recording(source)), list[float]()
    state = SessionState(len(integration.recording), Document(integration.algorithm.start_view()))
    while True:
        began_s = time.perf_counter()
        asked = apply(state, Propose())
        state = apply(asked, integration.answer(asked.document, asked.request))
        if state.document.pending is None:
            return times
        make_picture(integration, state.document, None)
        times.append(time.perf_counter() - began_s)
        view = state.document.pending.view_index
        is_sure = integration.score(state.document).total >= integration.accept_score
        state = apply(state, Accept(view) if is_sure else Reject(view, UNSURE))


def frame_s(source: str) -> float:
    """Return the median time from a frame that was read to its flattened view with all attributes."""
    integration, times = Integration(open_recording(source)), list[float]()
    for view in range(len(integration.recording)):
        integration.views.frame(view)
        began_s = time.perf_counter()
        try:
            for component in integration.views.flattening(view).components:
                for attribute in fields(component.view):
                    getattr(component.view, attribute.name)
        except FlatclothError:
            continue  # it shows too little
        times.append(time.perf_counter() - began_s)
    return float(np.median(times))
