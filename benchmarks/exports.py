"""What the exports of a whole session cost: each alone, and one after another as the page makes them.

In processor seconds, and in units U of ``benchmarks.speed``, measured in the same run on the same core. The
shape itself is known, as it is in a server whose page has been looked at; its growth is not.
"""

from __future__ import annotations

import contextlib
import io
import tempfile
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from benchmarks.output import Options, recordings_of, save, say
from benchmarks.speed import unit_s
from flatcloth.cli import main
from flatcloth.core.resources import sample_recordings
from flatcloth.export.by_name import made
from flatcloth.export.kept import Kept
from flatcloth.export.session import of_page, open_session

RECORDING = "shirt-sleeve-clean"
"""The bundled recording of most views."""
NAMES = ("report.html", "page.html", "growth.mp4", "figures.zip")


def run(options: Options) -> None:
    """Measure and print; write ``results/exports.json`` unless ``quick``."""
    rows = []
    for source in options.recordings or [str(sample_recordings()[RECORDING])]:
        with tempfile.TemporaryDirectory() as folder:
            rows.append(row_of(source, Path(folder) / "session", NAMES[:1] if options.quick else NAMES))
        say("   ".join(f"{key} {value}" for key, value in rows[-1].items()))
    if not options.quick:
        save("exports", rows, recordings_of(rows))


def row_of(source: str, folder: Path, names: tuple[str, ...]) -> dict[str, Any]:
    """Integrate a recording unattended, and return what its exports cost."""
    with contextlib.redirect_stdout(io.StringIO()):
        if code := main(["run", source, "--out", str(folder)]):
            raise SystemExit(code)
    session = open_session(folder)
    begun = session.history.begun
    session.integration.canonical(begun)

    def spent_s(name: str, kept: Kept) -> tuple[float, int]:
        began_s = time.process_time()
        data = made(of_page(session.integration, SimpleNamespace(folder=folder), kept=kept), name)
        return time.process_time() - began_s, len(data)

    spent_s(names[0], Kept())  # imports, and compiled kernels from the disk
    row: dict[str, Any] = {"recording": session.history.header.recording.name, "views": len(begun.used_views)}
    unit, shared = unit_s(), Kept()
    for kind in ("alone", "after_those_before"):
        for name in names:
            seconds, size = spent_s(name, shared if kind != "alone" else Kept())
            row[f"{name} {kind} s"] = round(seconds, 2)
            row[f"{name} {kind} u"] = round(seconds / unit)
            row[f"{name} MB"] = round(size / 1e6, 1)
    row["unit_ms"] = round(1e3 * unit, 1)
    return row
