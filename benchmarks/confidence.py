"""Does the confidence of a proposal tell right from wrong? And how its weights were learned.

For each proposal of an unattended integration, each component is scored at all places that the method
considered for it: *natural* cases, whose wrong ones are layers, folds and repeated texture. Places that
are wrong on purpose (moved, turned, or where another component belongs) are told apart from them.
Which are right is judged by the truth: right within 12 mm in the median, wrong beyond 20 mm; between,
neither. Weights are also learned without each garment in turn, and scored on that garment.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import minimize

from benchmarks.inputs import Remembered, sources
from benchmarks.output import Options
from flatcloth.core.config import RobustConfig
from flatcloth.core.geometry import fit_rigid2, project
from flatcloth.core.types import Float64, Rigid2
from flatcloth.engine.evaluation import bilinear_on_layer, of_interest
from flatcloth.engine.garment.deciding import place_sure_pieces
from flatcloth.engine.garment.recognition import GarmentService
from flatcloth.engine.headless import Run
from flatcloth.engine.integration import Integration
from flatcloth.methods.robust.method import RobustMethod
from flatcloth.methods.robust.scoring import CONFIDENCE_WEIGHTS, FEATURES, confidence_of, features_of
from flatcloth.recordings import open_recording
from flatcloth.recordings.truth import Truth, read_truth
from flatcloth.session.machine import Accept, Command, Document, Event, MemorySession, Reject, SessionState

RIGHT_M, WRONG_M, NEAR_M = 0.012, 0.020, 0.12
SAME_PIECE_M = 2.0
WRONG_PER_PART = 2


@dataclass(frozen=True)
class Laid:
    """A placement: its score's parts, the error by the truth (m), and whether it was moved on purpose."""

    recording: str
    garment: str
    parts: dict[str, float]
    error_m: float
    moved: bool


@dataclass(frozen=True)
class Watched:
    """An unattended integration: what computed, its final document and truth, and all its proposals."""

    integration: Integration
    document: Document
    truth: Any
    proposals: list[tuple[Document, int]]


def watched(source: str) -> Watched:
    """Integrate a recording; keep the document before each proposal, and the view that was proposed."""
    integration = Integration(Remembered(open_recording(source)))
    truth = Remembered(read_truth(integration.recording.location))
    proposals: list[tuple[Document, int]] = []

    def watch(event: Command | Event) -> None:
        if isinstance(event, Accept | Reject):
            proposals.append((before[0], event.view_index))
        before[0] = run.state.document

    session = MemorySession(SessionState(len(integration.recording)))
    run = Run(integration, session, watch=watch)
    before = [run.state.document]
    run.finish()
    place_sure_pieces(GarmentService(integration), session)  # as ``flatcloth run`` does
    return Watched(integration, session.state.document, truth, proposals)


def placements_of(found: Watched, random: np.random.Generator) -> list[Laid]:
    """Return right and wrong placements of one recording."""
    integration, truth = found.integration, found.truth
    robust = integration.algorithm
    assert isinstance(robust, RobustMethod)
    name = integration.recording.name
    laid: list[Laid] = []
    for document, view in found.proposals:
        shape, parts = robust.shapes.shape(document), robust.search.components(document, view)
        considered = robust.search.search(document, view).hypotheses
        node_truth = _truth_of_nodes(integration, document, truth)
        for component, hypotheses in considered.items():
            part = parts[component]
            held = robust.seen.associated(shape, view)[1]
            rc = project(held.inverse().apply(part.xyz_m), integration.recording.intrinsics)
            true = _truth_at(truth, view, rc)
            best = hypotheses[0].current_from_new
            motions = [(hypothesis.current_from_new, False) for hypothesis in hypotheses]
            motions += [(_disturbed(best, part.uv_m, random), True) for _ in range(WRONG_PER_PART)]
            motions += [(h[0].current_from_new, True) for c, h in considered.items() if c != component][:1]
            for motion, moved in motions:
                error = _error_m(motion.apply(part.uv_m), true, shape.all_uv_m, node_truth)
                if np.isfinite(error):
                    score = robust.score(document, view, component, motion)
                    laid.append(Laid(name, truth.garment, score.parts, error, moved))
    return laid


def _disturbed(
    motion: Rigid2, uv_m: Float64, random: np.random.Generator, least_m: float = 0.0, most_deg: float = 40.0
) -> Rigid2:
    """Move by 25 to 120 mm (or by ``least_m``), and turn by up to ``most_deg`` about the part's middle."""
    center = motion.apply(uv_m).mean(axis=0)
    direction, length = random.uniform(0, 2 * np.pi), least_m or random.uniform(0.025, 0.12)
    turn = np.radians(random.uniform(-most_deg, most_deg)) * random.integers(0, 2)
    shift = length * np.array([np.cos(direction), np.sin(direction)])
    return Rigid2(float(turn), float(shift[0]), float(shift[1])).about(center) @ motion


def _truth_at(truth: Truth, view: int, rc: Float64) -> Float64:
    true = truth[view]
    shown = of_interest(true, truth.panel_of_interest)
    flat = np.where(shown[..., None], true.flat_uv_m, np.nan)
    return bilinear_on_layer(flat, rc).astype(np.float64)


def _truth_of_nodes(integration: Integration, document: Document, truth: Truth) -> Float64:
    robust = integration.algorithm
    assert isinstance(robust, RobustMethod)
    shape = robust.shapes.shape(document)
    result = np.full((len(shape.nodes), 2), np.nan)
    for observation in shape.observations:
        offset = np.array(robust.seen.surfaces(shape)[observation.view_index].frame.offset_rc)
        result[observation.node] = _truth_at(truth, observation.view_index, observation.rc + offset)
    return result


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
    both = np.concatenate([right, wrong])
    order = np.argsort(both, kind="stable")
    _, first, count = np.unique(both[order], return_index=True, return_counts=True)
    rank = np.empty(both.size)
    rank[order] = np.repeat(first + 0.5 * (count + 1), count)
    total = rank[: right.size].sum() - right.size * (right.size + 1) / 2
    return float(total / (right.size * wrong.size))


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


def figures_of(laid: list[Laid], scores: Float64, accept: float, *, moved: bool) -> dict[str, Any]:
    """Return how well scores tell right from wrong among the natural placements, or the moved ones.

    Right placements are natural in both cases.
    """
    error, was_moved = np.array([p.error_m for p in laid]), np.array([p.moved for p in laid])
    known = np.isfinite(scores)
    right = scores[known & (error <= RIGHT_M) & ~was_moved]
    wrong = scores[known & (error >= WRONG_M) & (was_moved == moved)]
    found: dict[str, Any] = {"right": int(right.size), "wrong": int(wrong.size)}
    if right.size and wrong.size:
        found |= {
            "area_under_roc": round(area_under_roc(right, wrong), 4),
            "right_accepted": round(float((right >= accept).mean()), 4),
            "wrong_accepted": round(float((wrong >= accept).mean()), 4),
        }
    return found


def judged(laid: list[Laid], scores: Float64, left_out: Float64) -> dict[str, dict[str, Any]]:
    """Return :func:`figures_of` natural and moved placements, by scores as used and without their garment."""
    accept = RobustConfig().accept_confidence
    return {
        f"{kind}{suffix}": figures_of(laid, own, accept, moved=kind == "moved")
        for kind in ("natural", "moved")
        for suffix, own in (("", scores), ("_garment_left_out", left_out))
    }


def run(options: Options) -> None:
    """Measure and print; ``reliability`` writes the same figures."""
    random = np.random.default_rng(0)
    names = sources(options.recordings)
    laid = [placement for name in names for placement in placements_of(watched(name), random)]
    weights = CONFIDENCE_WEIGHTS
    if options.learn:
        weights = tuple(float(w) for w in learned_weights(laid))
        print("weights:", ", ".join(f"{n} {w:.2f}" for n, w in zip(FEATURES, weights, strict=True)))
    scored = np.array([confidence_of(p.parts, weights) for p in laid])
    figures = {"recordings": len(names), **judged(laid, scored, left_out_scores(laid))}
    print(json.dumps(figures, indent=1))
