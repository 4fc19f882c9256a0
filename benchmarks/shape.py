"""The shape of a set of views: whether it is honest, accurate, the same each time, and fast; the worst first.

*Honest*: pixels of either side and of their relation within three of their deviations plus 1 mm, and reliable
ones beyond 20 mm, of both sides as ``run`` writes them. *Accurate*: this side against the truth; with
``--against FILE`` also over the figures of an earlier ``results/accuracy.json`` or ``shape.json``. *The
same*: the shape of the same views, decided in three random orders, to the last bit; and with depth off by a
millionth: nodes are the same if a view added them at the same pixel. *Fast*: the shape of all registered
views from nothing (``flatcloth/shape/algorithm.py``), in processor time over U (``benchmarks.speed``).
"""

from __future__ import annotations

import gc
import json
import random
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import accuracy, sides
from benchmarks.inputs import Remembered, measure_each
from benchmarks.markdown import of_recordings
from benchmarks.output import Options, Row
from benchmarks.speed import best_s, unit_s
from benchmarks.unattended import both_sides
from flatcloth.core.geometry import fit_rigid2
from flatcloth.core.types import Float64, RgbdFrame
from flatcloth.engine.integration import Integration
from flatcloth.methods.robust.method import RobustMethod
from flatcloth.session.document import Document
from flatcloth.shape.algorithm import shape
from flatcloth.shape.shape import Shape

ORDERS, REPEATS = 3, 3
FACTORS = (1.0 + 1e-6, 1.0 - 1e-6)
_COLUMNS = {
    "this_seen": "this side: share of seen cloth",
    "this_within_3_std_share": "within 3 std",
    "this_firm_share": "reliable",
    "this_firm_far_share": "> 20 mm",
    "other_seen": "other side: share of seen cloth",
    "other_within_3_std_share": "within 3 std",
    "other_firm_share": "reliable",
    "other_firm_far_share": "> 20 mm",
    "related_within_3_std_share": "in relation: within 3 std",
    "related_p95_mm": "95 % mm",
    "absolute_median_mm": "this side: median mm",
    "absolute_p95_mm": "95 % mm",
    "coverage": "coverage",
    "median_ratio": "median over before",
    "p95_ratio": "95 % over before",
    "orders_same": "any order: same bytes",
    "other_nodes_share": "depth off: other nodes",
    "other_piece_share": "of another piece",
    "moved_p999_mm": "moved, 99.9 % mm",
    "moved_most_mm": "most mm",
    "nodes": "nodes",
    "shape_u": "shape, U",
}


def run(options: Options) -> None:
    """Measure and print; write ``results/shape.json`` and ``.md`` unless ``quick``."""
    before = json.loads(Path(options.against).read_text())["figures"] if options.against else []
    earlier = {row["recording"]: row for row in before}
    measure_each("shape", partial(rows_of, earlier=earlier), options, ordered=worst_first, page=page)


def rows_of(source: str, earlier: dict[str, Row]) -> list[Row]:
    """Return the figures of one recording."""
    service, document, truth = both_sides(source)
    this, joined = sides.written(service, document)
    integration = service.integration
    name, figures = integration.recording.name, sides.figures_of(this, joined, truth, integration.recording)
    figures |= {k: v for k, v in accuracy.figures_of(integration, document, truth).items() if k in _COLUMNS}
    if name in earlier:
        for key in ("median", "p95"):
            figures[f"{key}_ratio"] = figures[f"absolute_{key}_mm"] / earlier[name][f"absolute_{key}_mm"]
    recording = integration.recording
    del service, integration, this, joined
    gc.collect()  # an integration and its caches refer to one another
    figures |= same_and_fast(recording, document)
    row: Row = {"recording": name}
    for key in _COLUMNS:
        value = figures.get(key)
        row[key] = None if value is None or value != value else round(value, 3 if "_mm" in key else 4)
    return [row]


def same_and_fast(recording: Any, document: Document) -> dict[str, float]:
    """Return whether the shape of a document's views is the same each time, and its time in U."""
    seen, once = _computed(recording, document)
    views, start = seen.seen.placed(sorted(document.used_views)), document.start_view
    assert start is not None
    (interval_px, *_) = seen._config.flattening.sampling_intervals_px[::-1]
    unit = unit_s(clock=time.process_time)
    seconds = best_s(lambda: shape(views, interval_px, start), REPEATS, time.process_time)
    unit = min(unit, unit_s(clock=time.process_time))
    del seen
    shuffled, order = random.Random(0), list(document.accepted)
    same = []
    for _ in range(ORDERS):
        shuffled.shuffle(order)
        other = _computed(recording, replace(document, accepted=tuple(order)))[1]
        same.append(_bytes_of(other) == _bytes_of(once))
        gc.collect()
    changed = [difference(once, _computed(Scaled(recording, factor), document)[1]) for factor in FACTORS]
    return {
        "orders_same": float(np.mean(same)),
        **{key: max(each[key] for each in changed) for key in changed[0]},
        "nodes": float(len(once.nodes)),
        "shape_u": seconds / unit,
    }


class Scaled(Remembered):
    """A recording whose depth is multiplied by ``factor``."""

    def __init__(self, original: Any, factor: float) -> None:
        super().__init__(original)
        self._factor = factor

    def __getitem__(self, view_index: int) -> RgbdFrame:
        frame: RgbdFrame = self._original[view_index]
        scaled = self._factor * frame.depth_m.astype(np.float64)
        return replace(frame, depth_m=scaled.astype(np.float32))


def _computed(recording: Any, document: Document) -> tuple[RobustMethod, Shape]:
    """Return the shape of a document, from the frames on, and the method that computed it."""
    method = Integration(recording).algorithm
    assert isinstance(method, RobustMethod)
    return method, method.shapes.of(document)


def _bytes_of(made: Shape) -> tuple[bytes, ...]:
    return made.all_uv_m.tobytes(), made.std_m.tobytes(), made.piece.tobytes()


def difference(one: Shape, other: Shape) -> dict[str, float]:
    """Return by how much two shapes differ: nodes of one only, nodes of another piece, and places, mm.

    Places are compared after the best rigid motion of each piece.
    """
    key_of = _added_at(one)
    node_of = {key: node for node, key in enumerate(_added_at(other))}
    both = np.array([(node, node_of[key]) for node, key in enumerate(key_of) if key in node_of]).reshape(
        -1, 2
    )
    of_one, of_other = one.piece[both[:, 0]], other.piece[both[:, 1]]
    agree = of_one == of_other
    total = len(key_of) + len(node_of) - len(both)
    apart = [np.zeros(1)]
    for piece in np.unique(of_one[agree & (of_one >= 0)]):
        first, second = both[agree & (of_one == piece)].T
        if first.size > 2:
            apart.append(_apart_m(one.all_uv_m[first], other.all_uv_m[second]))
    moved_mm = 1e3 * np.concatenate(apart)
    return {
        "other_nodes_share": 1.0 - len(both) / total,
        "other_piece_share": float((~agree).mean()),
        "moved_p999_mm": float(np.quantile(moved_mm, 0.999)),
        "moved_most_mm": float(moved_mm.max()),
    }


def _apart_m(one: Float64, other: Float64) -> Float64:
    apart: Float64 = np.linalg.norm(fit_rigid2(one, other).apply(one) - other, axis=1)
    return apart


def _added_at(made: Shape) -> list[tuple[int, float, float]]:
    """Return for each node the view that added it, and the pixel where it did."""
    found = [(-1, 0.0, 0.0)] * len(made.nodes)
    for seen in made.observations:
        for node, (row, col) in zip(seen.node[seen.is_new], seen.rc[seen.is_new], strict=True):
            found[node] = (seen.view_index, float(row), float(col))
    return found


def worst_first(rows: Sequence[Row]) -> list[Row]:
    """Return the rows by the least share within three deviations, of either side or their relation."""
    keys = [key for key in _COLUMNS if key.endswith("within_3_std_share")]
    return sorted(rows, key=lambda row: min((row[key] for key in keys if row[key] is not None), default=0.0))


def page(rows: Sequence[Row]) -> str:
    """Return the Markdown page."""
    shown = {key: name for key, name in _COLUMNS.items() if any(row[key] is not None for row in rows)}
    return f"""# The shape of a set of views

Method `robust`, unattended; the least share within three deviations plus 1 mm first. Depth off: multiplied by
1 + 1e-6 and by 1 - 1e-6, the larger difference. The time is that of the shape from registered views.

{of_recordings(rows, shown)}
"""
