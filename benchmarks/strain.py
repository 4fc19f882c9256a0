"""How much longer or shorter flattened cloth is than true cloth, beside its ripples.

A noisy sensor smooths ripples away, and their lengths with them. In circles of cloth a similarity is fitted
to the true places of the nodes: its scale, less 1, is the strain, before the program lengthens anything.
``ripples`` are those that the program sees there under noise, from the angles between normals, rad^2. The
share ``lost`` is that of the ripples in the strain, and ``share`` that of the ripples in what is left of it,
fitted to all garments, and to all but each; recordings count alike. A circle averages much of the strain
away: what is left is divided by what circles leave of the random strain by which the program computes
deviations. Pairs of neighbours teach nothing: true places by pixels are off by a tenth of their length.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
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
from flatcloth.methods.robust.joint import settled
from flatcloth.methods.robust.joint_shape import JointShape
from flatcloth.methods.robust.method import RobustMethod
from flatcloth.session.document import Document

_RADIUS_M = 0.12
"""Of the circles: 3 times the distance over which strain is alike. Chosen: 300 nodes are in one, so that true
places that are off by 2 mm make its scale unsure by 0.1 %."""
_LEAST_NODES = 100
"""Places with fewer nodes around them are left out. Chosen: a third of a circle."""
_MOST_OFF_M = 0.01
"""Nodes farther off their true places, by the similarity, lie on other cloth. Chosen."""


@dataclass(frozen=True)
class Strained:
    """The strain and the ripples (K,) of the circles of a recording; ``left`` of a random strain in them."""

    strain: Float64
    ripples: Float64
    left: float


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
    }
    return {"recording": name, **{key: round(float(value), 5) for key, value in figures.items()}}


def fitted(some: Sequence[Strained]) -> dict[str, float]:
    """Fit ``strain = -lost ripples``, and ``left^2 = constant^2 + (share ripples)^2``.

    Means over the circles of each recording are summed.
    """
    square = max(sum(float(np.square(own.ripples).mean()) for own in some), 1e-12)
    lost = -sum(float((own.ripples * own.strain).mean()) for own in some) / square
    left = [(own.strain + lost * own.ripples) / own.left for own in some if own.ripples.any()]
    beyond = sum(max(float(np.square(each).mean()) - uncertainty._STRAIN**2, 0.0) for each in left)
    return {"lost": round(lost, 3), "share": round(math.sqrt(beyond / square), 3)}


def strains(integration: Integration, document: Document, truth: Any) -> Strained:
    """Return the strain and the ripples of circles of a shape, where its cloth is not gathered."""
    algorithm = integration.algorithm
    assert isinstance(algorithm, RobustMethod)
    shape = settled(algorithm.shapes.shape(document))
    true = _true_places(algorithm, shape, truth)
    below_m = np.linalg.norm(shape.nodes.xyz_m - integration.views.held_point_m, axis=1)
    known = np.flatnonzero(
        shape.placed & np.isfinite(true[:, 0]) & (below_m > uncertainty._GATHERED_EXTENT_M)
    )
    ripples = uncertainty.ripples_under_noise(shape)[known]
    random = uncertainty._smooth(shape.uv_m[known], 1, np.random.default_rng(0))[:, 0]
    tree, found = cKDTree(shape.uv_m[known]), []
    for place in shape.uv_m[known][:: len(known) // 400 + 1]:
        near = tree.query_ball_point(place, _RADIUS_M)
        if len(near) >= _LEAST_NODES:
            strain, kept = _strain(shape.uv_m[known[near]], true[known[near]])
            if kept >= _LEAST_NODES:
                found.append((strain, ripples[near].mean(), *random[near].mean(axis=0)))
    strain, there, *left = np.array(found).T if found else np.zeros((3, 1))
    return Strained(strain, there, max(float(np.std(left)), 1e-9))


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


def _true_places(algorithm: RobustMethod, shape: JointShape, truth: Any) -> Float64:
    """Return the true place (N, 2) of each node, the median of all views that see it; NaN if none does."""
    seen: list[list[Float64]] = [[] for _ in range(len(shape.nodes))]
    for observation in shape.observations:
        view = truth[observation.view_index]
        offset = algorithm.seen.surfaces(shape)[observation.view_index].frame.offset_rc
        shown = np.where(of_interest(view, truth.panel_of_interest)[..., None], view.flat_uv_m, np.nan)
        for node, place in zip(
            observation.node, bilinear_on_layer(shown, observation.rc + offset), strict=True
        ):
            if np.isfinite(place[0]):
                seen[node].append(place)
    return np.array([np.median(places, axis=0) if places else (np.nan, np.nan) for places in seen])
