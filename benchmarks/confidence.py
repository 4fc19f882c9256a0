"""Does the confidence of a placement tell right from wrong? And how its weights were learned.

Each third view of an unattended result is taken out of its shape, and its components are scored where the
shape with the view has them, and where they are wrong on purpose: moved, turned, or where another component
of the view belongs. Which are right is judged by the truth: right within 12 mm in the median, wrong beyond
20 mm; between, neither. Weights are also learned without each garment in turn, and scored on that garment.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any
from zlib import crc32

import numpy as np
from scipy.optimize import minimize

from benchmarks.inputs import sources
from benchmarks.node_truth import true_at, true_places
from benchmarks.output import Options, save, say
from benchmarks.unattended import unattended
from flatcloth.core.config import RobustConfig
from flatcloth.core.errors import AlignmentError
from flatcloth.core.geometry import fit_rigid2, project
from flatcloth.core.types import Float64, Rigid2
from flatcloth.methods.robust.method import RobustMethod
from flatcloth.methods.robust.scoring import CONFIDENCE_WEIGHTS, FEATURES, confidence_of, features_of

RIGHT_M, WRONG_M, NEAR_M = 0.012, 0.020, 0.12
SAME_PIECE_M = 2.0
EVERY = 3
WRONG_PER_PART = 2


@dataclass(frozen=True)
class Laid:
    """A placement: its score's parts, and the error by the truth (m)."""

    garment: str
    parts: dict[str, float]
    error_m: float


def placements_of(source: str) -> Iterator[Laid]:
    """Yield right and wrong placements of one recording."""
    integration, document, truth = unattended(source)
    robust, intrinsics = integration.algorithm, integration.recording.intrinsics
    assert isinstance(robust, RobustMethod)
    random = np.random.default_rng(crc32(integration.recording.name.encode()))
    for added in document.accepted[::EVERY]:
        view = added.view_index
        others = replace(document, accepted=tuple(a for a in document.accepted if a.view_index != view))
        try:
            placement = robust.propose(others, view, None)
        except AlignmentError:
            continue
        shape = robust.shapes.of(others)
        node_truth = true_places(shape, robust.seen.surfaces(shape), truth)
        held = robust.seen.poses((*shape.views, view))[-1]
        found = {part.component: part.hypothesis.initial for part in placement.parts if part.hypothesis}
        for component, motion in found.items():
            sampled = robust._sampled(others, view)[component]
            true = true_at(truth, view, project(held.inverse().apply(sampled.xyz_m), intrinsics))
            motions = [motion, *(_disturbed(motion, sampled.uv_m, random) for _ in range(WRONG_PER_PART))]
            motions += [other for number, other in found.items() if number != component][:1]
            for own in motions:
                error_m = _error_m(own.apply(sampled.uv_m), true, shape.all_uv_m, node_truth)
                if np.isfinite(error_m):
                    score = robust.score(others, view, component, own)
                    yield Laid(truth.garment, score.parts, error_m)


def _disturbed(motion: Rigid2, uv_m: Float64, random: np.random.Generator) -> Rigid2:
    """Move by 25 to 120 mm, and turn by up to 40 degrees about the part's middle, or not."""
    center = motion.apply(uv_m).mean(axis=0)
    direction, length = random.uniform(0, 2 * np.pi), random.uniform(0.025, 0.12)
    turn = np.radians(random.uniform(-40.0, 40.0)) * random.integers(0, 2)
    shift = length * np.array([np.cos(direction), np.sin(direction)])
    return Rigid2(float(turn), float(shift[0]), float(shift[1])).about(center) @ motion


def _error_m(placed: Float64, true: Float64, node_uv: Float64, node_truth: Float64) -> float:
    """Median distance from where the part belongs, beside the cloth that is there: swings cancel."""
    known = np.isfinite(true[:, 0])
    nodes = np.isfinite(node_truth[:, 0]) & np.isfinite(node_uv[:, 0])
    # Floating pieces lie far off on the plane; only the one that the part is laid on counts.
    nodes[nodes] = np.linalg.norm(node_uv[nodes] - np.median(placed, axis=0), axis=1) < SAME_PIECE_M
    if known.sum() < 10 or nodes.sum() < 10:
        return float("nan")
    middle = np.median(true[known], axis=0)
    apart = np.linalg.norm(node_truth - middle, axis=1)
    near = nodes & (apart <= max(NEAR_M, float(np.sort(apart[nodes])[9])))
    motion = fit_rigid2(node_uv[near], node_truth[near])
    return float(np.median(np.linalg.norm(motion.apply(placed[known]) - true[known], axis=1)))


def area_under_roc(right: Float64, wrong: Float64) -> float:
    """Return the share of (right, wrong) pairs in which the right one scores higher; ties count half."""
    return float(((right[:, None] > wrong) + 0.5 * (right[:, None] == wrong)).mean())


def learned_weights(laid: list[Laid]) -> Float64:
    """Return the weights of the logistic regression, lightly held near 0."""
    used = [x for x in laid if x.error_m <= RIGHT_M or x.error_m >= WRONG_M]
    x = np.array([features_of(p.parts) for p in used])
    y = np.array([p.error_m <= RIGHT_M for p in used])
    balance = np.where(y, 0.5 / y.mean(), 0.5 / (1 - y.mean()))

    def loss(w: Float64) -> float:
        margin = np.where(y, 1.0, -1.0) * (x @ w)
        return float((balance * np.logaddexp(0.0, -margin)).mean() + 3e-4 * np.square(w[1:]).sum())

    return np.asarray(minimize(loss, np.zeros(x.shape[1]), method="L-BFGS-B").x)


def left_out_scores(laid: list[Laid]) -> Float64:
    """Return the confidence of each placement by weights learned from all other garments; NaN if none."""
    scores = np.full(len(laid), np.nan)
    for garment in sorted({p.garment for p in laid}):
        others = [p for p in laid if p.garment != garment]
        if not any(p.error_m <= RIGHT_M for p in others) or not any(p.error_m >= WRONG_M for p in others):
            continue
        weights = tuple(float(w) for w in learned_weights(others))
        for n, placement in enumerate(laid):
            if placement.garment == garment:
                scores[n] = confidence_of(placement.parts, weights)
    return scores


def figures_of(laid: list[Laid], scores: Float64, accept: float) -> dict[str, Any]:
    """Return how well scores tell right from wrong placements."""
    error, known = np.array([p.error_m for p in laid]), np.isfinite(scores)
    right, wrong = scores[known & (error <= RIGHT_M)], scores[known & (error >= WRONG_M)]
    found: dict[str, Any] = {"right": int(right.size), "wrong": int(wrong.size)}
    if right.size and wrong.size:
        found |= {
            "area_under_roc": round(area_under_roc(right, wrong), 4),
            "right_accepted": round(float((right >= accept).mean()), 4),
            "wrong_accepted": round(float((wrong >= accept).mean()), 4),
        }
    return found


def run(options: Options) -> None:
    """Measure and print; write ``results/confidence.json`` unless ``quick``."""
    names = sources(options.recordings)
    laid = [placement for name in names for placement in placements_of(name)]
    weights = CONFIDENCE_WEIGHTS
    if options.learn:
        weights = tuple(float(w) for w in learned_weights(laid))
        say("weights: " + ", ".join(f"{n} {w:.2f}" for n, w in zip(FEATURES, weights, strict=True)))
    accept = RobustConfig().accept_confidence
    scores = np.array([confidence_of(p.parts, weights) for p in laid])
    figures = {
        "as_used": figures_of(laid, scores, accept),
        "garment_left_out": figures_of(laid, left_out_scores(laid), accept),
    }
    say(str(figures))
    if not options.quick:
        save("confidence", figures, names)
