"""How much the flattened lengths of each garment are off within a few centimetres, beside its ripples.

A sensor smooths ripples away, and their lengths with them. ``rms`` is that of the relative error of lengths
within the distance over which the program takes them as independent, against the truth; ``ripples`` are
those that the program sees, from the angles between normals of neighbouring nodes, rad^2. The share of the
one in the other is fitted to all garments, and to all but each.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from benchmarks.inputs import sources
from benchmarks.output import Options, save, say
from benchmarks.unattended import unattended
from flatcloth.core.types import Float64
from flatcloth.engine.evaluation import bilinear_on_layer, of_interest
from flatcloth.engine.integration import Integration
from flatcloth.methods.robust import uncertainty
from flatcloth.methods.robust.method import RobustMethod
from flatcloth.session.document import Document

_MOST_OFF = 0.3
"""Pairs whose length is off by more join different cloth. Chosen."""
_LEAST_PAIRS = 60
"""Places with fewer pairs around them are left out. Chosen."""


def run(options: Options) -> None:
    """Measure, fit and print; write ``results/strain.json`` unless ``quick``."""
    rows = []
    for source in sources(options.recordings):
        integration, document, truth = unattended(source)
        off, ripples = strains(integration, document, truth)
        rows.append(
            {
                "recording": integration.recording.name,
                "rms": round(float(np.sqrt(np.square(off).mean())), 5),
                "mean": round(float(off.mean()), 5),
                "ripples": round(ripples, 4),
            }
        )
        say("   ".join(f"{key} {value}" for key, value in rows[-1].items()))
    fits = {
        garment: share_of([row for row in rows if row["recording"].split("-")[0] != garment])
        for garment in sorted({row["recording"].split("-")[0] for row in rows})
    }
    found = {"share": share_of(rows), "without": fits if len(fits) > 1 else {}}
    say(str(found))
    if not options.quick:
        rows.sort(key=lambda row: -float(row["rms"]))
        save("strain", {**found, "rows": rows}, [Path(str(row["recording"])).name for row in rows])


def share_of(rows: Sequence[dict[str, Any]]) -> float | None:
    """Fit ``rms^2 = constant^2 + (share ripples)^2`` to recordings with the program's constant."""
    beyond = [max(float(row["rms"]) ** 2 - uncertainty._STRAIN**2, 0.0) ** 0.5 for row in rows]
    ripples = [float(row["ripples"]) for row in rows]
    return round(float(np.dot(beyond, ripples) / np.dot(ripples, ripples)), 3) if any(ripples) else None


def strains(integration: Integration, document: Document, truth: Any) -> tuple[Float64, float]:
    """Return the relative error of lengths around places (K,) of the shape, and its ripples."""
    algorithm = integration.algorithm
    assert isinstance(algorithm, RobustMethod)
    shape = algorithm.shapes.settled(document)
    true = [np.zeros((0, 2)) for _ in range(len(shape.nodes))]
    for observation in shape.observations:
        view = truth[observation.view_index]
        offset = algorithm.seen.surfaces(shape)[observation.view_index].frame.offset_rc
        shown = np.where(of_interest(view, truth.panel_of_interest)[..., None], view.flat_uv_m, np.nan)
        for node, place in zip(
            observation.node, bilinear_on_layer(shown, observation.rc + offset), strict=True
        ):
            if np.isfinite(place[0]):
                true[node] = np.vstack([true[node], place])
    placed = np.flatnonzero(shape.placed)
    known = np.full((len(shape.nodes), 2), np.nan)
    for node in placed:
        if len(true[node]):
            known[node] = np.median(true[node], axis=0)
    one, other = shape.links.once.T
    flat_m = np.linalg.norm(shape.uv_m[one] - shape.uv_m[other], axis=1)
    true_m = np.linalg.norm(known[one] - known[other], axis=1)
    below_m = np.linalg.norm(shape.nodes.xyz_m[one] - integration.views.held_point_m, axis=1)
    with np.errstate(invalid="ignore"):
        good = np.abs(flat_m - true_m) < _MOST_OFF * true_m
    pair = np.flatnonzero(good & (below_m > uncertainty._GATHERED_EXTENT_M))
    middle = 0.5 * (shape.uv_m[one] + shape.uv_m[other])[pair]
    tree = cKDTree(middle)
    places, around = middle[:: len(middle) // 1000 + 1], []
    for near in tree.query_ball_point(places, uncertainty.CORRELATED_M):
        own = pair[near]
        around.append(flat_m[own].sum() / true_m[own].sum() - 1.0 if len(near) >= _LEAST_PAIRS else np.nan)
    off = np.array(around)
    nodes = shape.nodes
    ripples = uncertainty.ripples_of(shape.uv_m[placed], nodes.xyz_m[placed], nodes.normal[placed])
    return off[np.isfinite(off)], ripples
