"""Errors of lengths against the truth: strain beside ripples, and those of pairs by the views that saw them.

A noisy sensor smooths ripples away, and their lengths with them. In circles of cloth a similarity is fitted
to the true places of the nodes: its scale, less 1, is the strain, before the program lengthens anything.
``ripples`` are those that the program sees there under noise, from the angles between normals, rad^2. The
share ``lost`` is that of the ripples in the strain, and ``share`` that of the ripples in what is left of it,
fitted to all garments, and to all but each; recordings count alike. A circle averages much of the strain
away: what is left is divided by what circles leave of the random fields by which the program computes
deviations.

``layer_mm`` is the error of a pair that one noisy view sees, if n views leave an n-th of it: fitted to the
errors of the lengths of pairs (68 % of them are smaller) that 1, 2, 3 and 4 views saw, beyond that of pairs
that at least eight saw. True places by pixels are off by a tenth of a pair's length, too; both have that.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from benchmarks.inputs import sources
from benchmarks.node_truth import true_places
from benchmarks.output import Options, save, say
from benchmarks.unattended import unattended
from flatcloth.core.types import Float64
from flatcloth.engine.integration import Integration
from flatcloth.methods.robust.method import RobustMethod
from flatcloth.session.document import Document
from flatcloth.shape.deviations import STRAIN_M, _smooth_fields
from flatcloth.shape.ripples import ripples_of
from flatcloth.shape.shape import Shape

_RADIUS_M = 0.12
"""Of the circles: 3 times the distance over which strain is alike. Chosen: 300 nodes are in one, so that true
places that are off by 2 mm make its scale unsure by 0.1 %."""
_LEAST_NODES = 100
"""Places with fewer nodes around them are left out. Chosen: a third of a circle."""
_MOST_OFF_M = 0.01
"""Nodes farther off their true places, by the similarity, lie on other cloth. Chosen."""
_ONE_STD = 0.683
"""Share of the errors that are smaller than one deviation."""
_FEW, _MANY = (1, 2, 3, 4), 8
"""Numbers of views of pairs. Chosen."""


@dataclass(frozen=True)
class Strained:
    """The strain and the ripples (K,) of the circles of a recording; ``left`` of a random strain in them.

    ``known`` is the strain of pairs that the program expects besides. ``by_views`` is the error of pairs that
    so many views saw, m: :data:`_FEW`, then at least :data:`_MANY`.
    """

    strain: Float64
    ripples: Float64
    left: float
    known: float
    by_views: Float64


def run(options: Options) -> None:
    """Measure, fit and print; write ``results/strain.json`` unless ``quick``."""
    seen: dict[str, Strained] = {}
    for source in sources(options.recordings):
        integration, document, truth = unattended(source)
        seen[integration.recording.name] = strains(integration, document, truth)
        say(str(_row(integration.recording.name, seen[integration.recording.name], 0.0)))
    garments = sorted({name.split("-")[0] for name in seen})
    fits = {
        garment: fitted([own for name, own in seen.items() if name.split("-")[0] != garment])
        for garment in (garments if len(garments) > 1 else [])
    }
    found = {**fitted([*seen.values()]), "without": fits}
    say(str(found))
    if not options.quick:
        rows = [_row(name, own, fits.get(name.split("-")[0], found)["lost"]) for name, own in seen.items()]
        rows.sort(key=lambda row: -row["rms_left"])
        save("strain", {**found, "rows": rows}, sorted(seen))


def _row(name: str, own: Strained, lost: float) -> dict[str, Any]:
    left = own.strain + lost * own.ripples
    figures = {
        "mean": own.strain.mean(),
        "ripples": own.ripples.mean(),
        "mean_left": left.mean(),
        "rms_left": math.sqrt(np.square(left).mean()) / own.left,
        "known": own.known,
        **{f"pairs_{n}_mm": 1e3 * off for n, off in zip((*_FEW, _MANY), own.by_views, strict=True)},
    }
    return {"recording": name, **{key: round(float(value), 5) for key, value in figures.items()}}


def fitted(some: Sequence[Strained]) -> dict[str, float]:
    """Fit ``strain = -lost ripples``, and ``left^2 = constant^2 + (share ripples)^2``.

    Means over the circles of each recording are summed.
    """
    square = max(sum(float(np.square(own.ripples).mean()) for own in some), 1e-12)
    lost = -sum(float((own.ripples * own.strain).mean()) for own in some) / square
    noisy = [own for own in some if own.ripples.any()]
    left = [np.square((own.strain + lost * own.ripples) / own.left).mean() - own.known**2 for own in noisy]
    share = math.sqrt(sum(max(float(each), 0.0) for each in left) / square)
    few = np.array([np.square(own.by_views[:-1]) - np.square(own.by_views[-1]) for own in noisy])
    layer_m2 = np.square(_FEW) * np.maximum(few, 0.0)
    layer_mm = 1e3 * math.sqrt(float(np.nanmedian(layer_m2))) if noisy else 0.0
    return {"lost": round(lost, 3), "share": round(share, 3), "layer_mm": round(layer_mm, 2)}


def strains(integration: Integration, document: Document, truth: Any) -> Strained:
    """Return the strain and the ripples of circles of a shape, and errors of its pairs."""
    algorithm = integration.algorithm
    assert isinstance(algorithm, RobustMethod)
    shape = algorithm.shapes.of(document)
    true = true_places(shape, algorithm.seen.surfaces(shape), truth)
    known = np.flatnonzero(shape.placed & np.isfinite(true[:, 0]))
    flat_m, is_noisy = shape.uv_m[known] / shape.scale, any(seen.is_noisy for seen in shape.observations)
    ripples = ripples_of(flat_m, shape.nodes.xyz_m[known], shape.nodes.normal[known]) * is_noisy
    fields = _smooth_fields(shape.nodes.xyz_m[known], np.random.default_rng(0))
    random = 0.5 * (fields[:, 0] + fields[:, 2])  # of a similarity: the mean of both strains
    tree, found = cKDTree(flat_m), []
    for place in flat_m[:: len(known) // 400 + 1]:
        near = tree.query_ball_point(place, _RADIUS_M)
        if len(near) >= _LEAST_NODES:
            strain, kept = _strain(flat_m[near], true[known[near]])
            if kept >= _LEAST_NODES:
                found.append((strain, ripples[near].mean(), *random[near].mean(axis=0)))
    strain, there, *left = np.array(found).T if found else np.zeros((3, 1))
    graph, own = shape.graph, shape.holds & shape.placed[shape.graph.pairs].all(axis=1)
    variance = (graph.variance_m2[own] + STRAIN_M**2) / np.square(graph.length_m[own])
    return Strained(
        strain=strain,
        ripples=there,
        left=max(float(np.std(left)), 1e-9),
        known=math.sqrt(float(np.median(variance))),
        by_views=_errors_by_views(shape, true),
    )


def _errors_by_views(shape: Shape, true: Float64) -> Float64:
    """Return the error of the lengths of pairs that few views saw, and of those that many did, m."""
    graph = shape.graph
    way = np.diff(true[graph.pairs], axis=1)[:, 0]
    off_m = np.abs(np.linalg.norm(way, axis=1) - shape.scale * graph.length_m)
    known = shape.holds & np.isfinite(off_m) & (off_m < _MOST_OFF_M)
    chosen = [known & (graph.views == n) for n in _FEW] + [known & (graph.views >= _MANY)]
    return np.array(
        [np.quantile(off_m[own], _ONE_STD) if own.sum() >= _LEAST_NODES else np.nan for own in chosen]
    )


def _strain(flat_m: Float64, true_m: Float64) -> tuple[float, int]:
    """Return by how much places (K, 2) are farther apart than true ones, and how many of them say so.

    The scale is that from the flat to the true places, which alone have errors.
    """
    flat, true = (places @ np.array([1.0, 1j]) for places in (flat_m, true_m))
    off_m = np.abs(true - flat - np.median(true - flat))
    kept, turned = off_m <= np.median(off_m), 1.0 + 0.0j
    for _ in range(5):
        middle = flat[kept].mean(), true[kept].mean()
        turned = np.vdot(flat[kept] - middle[0], true[kept] - middle[1]) / np.vdot(
            flat[kept] - middle[0], flat[kept] - middle[0]
        )
        off_m = np.abs(true - middle[1] - turned * (flat - middle[0]))
        kept = off_m <= max(_MOST_OFF_M, float(np.median(off_m)))
    return float(1.0 / np.abs(turned) - 1.0), int((off_m < _MOST_OFF_M).sum())
