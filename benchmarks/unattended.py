"""What the benchmarks of whole recordings share: the unattended result, and the loop over recordings."""

from __future__ import annotations

import gc
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from benchmarks.inputs import Remembered, sources
from benchmarks.output import Options, recordings_of, save, save_page, say
from flatcloth.engine.both_sides import BothSides
from flatcloth.engine.garment.deciding import place_sure_pieces
from flatcloth.engine.garment.recognition import GarmentService
from flatcloth.engine.headless import Run
from flatcloth.engine.integration import Integration
from flatcloth.recordings import open_recording
from flatcloth.recordings.truth import Truth
from flatcloth.session.machine import Document, MemorySession, SessionState


def unattended(source: str) -> tuple[Integration, Document, Remembered]:
    """Integrate a recording by ``robust`` without an operator; return also its truth."""
    integration, document = integrated(Remembered(open_recording(source)))
    return integration, document, Remembered(Truth(integration.recording.location))


def integrated(recording: Any, method: str | None = None) -> tuple[Integration, Document]:
    """Integrate one side of an open recording without an operator, by default by ``robust``."""
    integration = Integration(recording, method=method)
    service = GarmentService(integration)
    return integration, _placed(service, Run(integration, MemorySession(SessionState(len(recording)))))


def both_sides(source: str) -> tuple[GarmentService, BothSides, Document, Remembered]:
    """Integrate both sides of a recording by ``robust`` without an operator; return also its truth."""
    recording = Remembered(open_recording(source))
    return *integrated_sides(recording), Remembered(Truth(recording.location))


def integrated_sides(recording: Any) -> tuple[GarmentService, BothSides, Document]:
    """Integrate both sides of an open recording by ``robust`` without an operator."""
    integration = Integration(recording)
    both = BothSides(integration)
    service = GarmentService(integration, both)
    run = Run(integration, MemorySession(SessionState(len(recording))))
    both.of(run.finish().document)
    return service, both, _placed(service, run)


def _placed(service: GarmentService, run: Run) -> Document:
    """Return the decisions of a run, with the pieces whose place is sure, as ``flatcloth run`` makes them."""
    run.finish()
    place_sure_pieces(service, run.session)
    return run.session.state.document


Row = dict[str, Any]


def measure_each(
    name: str,
    row_of: Callable[[str], Row],
    ordered: Callable[[Sequence[Row]], list[Row]],
    page: Callable[[Sequence[Row]], str],
    options: Options,
) -> None:
    """Measure and print one recording after another; write the rows and their page unless ``quick``.

    With ``keep``, a recording that was measured before is not measured again.
    """
    rows: list[Row] = []
    for source in sources(options.recordings):
        file = Path(options.keep) / f"{Path(source).name}.json" if options.keep else None
        if file is not None and file.exists():
            rows.append(json.loads(file.read_text()))
        else:
            rows.append(row_of(source))
            gc.collect()  # an integration and its caches refer to one another
            if file is not None:
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_text(json.dumps(rows[-1]))
        say("   ".join(f"{key} {value}" for key, value in rows[-1].items()))
        if not options.quick:
            save(name, ordered(rows), recordings_of(rows))
            save_page(name, page(ordered(rows)))
