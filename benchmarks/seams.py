"""How probable it is that sets of places where rims meet are seams, and that cloth between them is true.

For each recording: all sets with what their probability is fitted to (strength, true edges on cloth of the
other sheet), that probability, and whether they are true; then the cloth of either side between each two true
sets of a piece, with its evidence and how far it is truly bent. The odds of ``seams/links.py`` are fitted to
these, and reported for garments left out of the fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, pairwise

import numpy as np
from scipy.spatial import cKDTree

from benchmarks.inputs import measure_each
from benchmarks.output import Options, Row
from benchmarks.unattended import logistic, unattended
from flatcloth.core.geometry import fit_rigid2
from flatcloth.core.types import MIRROR, FlattenedView, Float64, Int64
from flatcloth.engine.both_sides import BothSides, one_side
from flatcloth.engine.evaluation import Truth, look_up
from flatcloth.engine.results.sides_truth import FAR_RELATED_M, NEAR_SEAM_M, OtherTruth
from flatcloth.methods.robust.method import RobustMethod
from flatcloth.methods.robust.seams import links as seam_links

BENT_MM = 100.0
"""Cloth that is bent more between two seams is joined falsely. Chosen: drift is less."""
HELD = 0.02
"""Weight that draws the coefficients to 0. Chosen: hardly."""


def run(options: Options) -> None:
    """Measure and print; write ``results/seams.json`` and ``.md`` unless ``quick``."""
    measure_each("seams", rows_of, options, ordered=worst_first, page=page)


def rows_of(source: str) -> list[Row]:
    """Return the sets and the contradictions of one recording."""
    integration, document, truth = unattended(source)
    other, its = BothSides(integration).integrated(document)
    assert isinstance(integration.algorithm, RobustMethod)
    assert isinstance(other.algorithm, RobustMethod)
    shapes = integration.algorithm.shapes.of(document), other.algorithm.shapes.of(its)
    sides = one_side(integration, document), one_side(other, its)
    pieces = [(each.canonical.view, *each.canonical.floating) for each in sides]
    truths: list[Truth] = [truth, OtherTruth(truth, len(integration.recording))]
    matches = seam_links.matches_of(*pieces)
    places = matches.this_uv_m, matches.other_uv_m
    true = [_true_at(*each) for each in zip(pieces, truths, places, strict=True)]
    off_m = np.linalg.norm(true[0] - true[1] * MIRROR, axis=1)
    sets = seam_links.sets_of(*shapes, matches)
    ends = sides[0].ends, sides[1].ends
    decided = seam_links.linked(*shapes, matches, sets, ends)[2]
    found = [
        {
            "places": len(each.members),
            "strength": round(each.strength, 1),
            "against": round(float(seam_links.contradicting(matches, each, ends)[0].sum()), 1),
            "probability": round(link.probability, 4),
            "joins": not link.why,
            "true_share": round(float(np.nanmean(off_m[each.members] < FAR_RELATED_M)), 2),
        }
        for each, link in zip(sets, decided, strict=True)
        if np.isfinite(off_m[each.members]).any()
    ]
    true_sets = [each for each in sets if np.nanmean(off_m[each.members] < FAR_RELATED_M) >= 0.5]
    joints = []
    for side, (shape, uv) in enumerate(zip(shapes, places, strict=True)):
        cloth, node = seam_links.Cloth(shape), seam_links.node_at(shape, uv)
        for one, other_set in combinations(true_sets, 2):
            pieces_of = [(each.this_piece, each.other_piece)[side] for each in (one, other_set)]
            joint = seam_links.joint_between(side, cloth, node[one.members], node[other_set.members])
            if pieces_of[0] == pieces_of[1] and np.isfinite(joint.evidence):
                bent = _bent_mm(uv, true[side], one.members, other_set.members)
                joints.append({"side": side, "evidence": round(joint.evidence, 1), "bent_mm": bent})
    is_noisy = any(view.is_noisy for view in shapes[0].observations)
    name = integration.recording.name
    return [{"recording": name, "noisy": is_noisy, "sets": found, "joints": joints}]


def _bent_mm(uv_m: Float64, true_uv_m: Float64, one: Int64, other: Int64) -> float:
    """Return how far the cloth between two sets of matches is truly bent; NaN if too little is known."""
    one, two = (each[np.isfinite(true_uv_m[each, 0])] for each in (one, other))
    if min(one.size, two.size) < 3:
        return float("nan")
    off_m = fit_rigid2(uv_m[one], true_uv_m[one]).apply(uv_m[two]) - true_uv_m[two]
    return round(1e3 * float(np.median(np.linalg.norm(off_m, axis=1))), 1)


def _true_at(pieces: Sequence[FlattenedView], truth: Truth, uv_m: Float64) -> Float64:
    """Return the true places (K, 2) of places of the plane; NaN where none is known near."""
    at = np.concatenate([piece.uv_from_rc(np.argwhere(piece.valid)) for piece in pieces])
    true = np.concatenate([look_up(piece, truth) for piece in pieces])
    known = np.isfinite(true[:, 0])
    away, nearest = cKDTree(at[known]).query(uv_m)
    found: Float64 = np.where((away < NEAR_SEAM_M)[:, None], true[known][nearest], np.nan)
    return found


def worst_first(rows: Sequence[Row]) -> list[Row]:
    """Return the rows by the surest false set."""
    return sorted(
        rows,
        key=lambda row: -max((s["probability"] for s in row["sets"] if s["true_share"] < 0.5), default=0),
    )


def page(rows: Sequence[Row]) -> str:
    """Return the Markdown page."""
    sets = [(row["recording"].partition("-")[0], each) for row in rows for each in row["sets"]]
    features = np.array([(1.0, np.log(s["strength"]), np.log1p(s["against"])) for _, s in sets])
    true = np.array([s["true_share"] >= 0.5 for _, s in sets])
    garment = np.array([name for name, _ in sets])
    left_out = np.zeros(len(sets))
    for name in np.unique(garment):
        own = garment == name
        left_out[own] = 1.0 / (1.0 + np.exp(-features[own] @ logistic(features[~own], true[~own], HELD)))
    sure = left_out > 0.9
    joints = {(row["recording"], j["side"], j["evidence"]): j["bent_mm"] for row in rows if row["noisy"]
              for j in row["joints"]}  # fmt: skip
    bins = [0.0, 1.0, 4.0, 16.0, 64.0, np.inf]
    by_evidence = "\n".join(
        f"| {low:g} to {high:g} | {len(own)} | {sum(bent > BENT_MM for bent in own)} |"
        for low, high in pairwise(bins)
        for own in [[bent for (*_, evidence), bent in joints.items() if low <= evidence < high]]
    )
    lines = "\n".join(
        f"| {row['recording']} | " + " | ".join(
            ", ".join(f"{s['probability']:.3g} ({s['strength']:.0f}, {s['against']:.0f})"
                      for s in row["sets"] if (s["true_share"] >= 0.5) == kind)
            for kind in (False, True)
        ) + " |"
        for row in rows
    )  # fmt: skip
    odds = ", ".join(f"{value:.2f}" for value in logistic(features, true, HELD))
    return f"""# Seams: sets of places, true and false

{len(sets)} sets, {true.sum()} true. Their odds are fitted as {odds} (constant, strength, true edges against);
for garments left out of the fit the Brier score is {np.mean((left_out - true) ** 2):.3f}, and of {sure.sum()}
sets of .9 and more {true[sure].mean() if sure.any() else 0:.1%} are true.

Cloth between two true sets, of noisy recordings, by its evidence, and how much of it is bent by more than
{BENT_MM:g} mm:

| evidence | joints | false |
|---|---|---|
{by_evidence}

The probability of each set, in brackets its strength and the true edges against it; the surest false set
comes first.

| recording | false sets | true sets |
|---|---|---|
{lines}
"""
