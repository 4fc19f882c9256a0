"""Which sets of places where rims meet are seams, and what cloth between two sets that contradict is worth.

For each recording: all sets of at least ``LEAST`` places with their size and strength, whether they are true,
and how many true edges they lay on cloth of the other sheet; then each two sets on one piece of the other
side that contradict each other, with the evidence of the cloth of either side between them and how far that
cloth is truly bent. The limits of ``seams/links.py`` are chosen by these.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from benchmarks.output import Options
from benchmarks.unattended import measure_each, unattended
from flatcloth.core.geometry import fit_rigid2
from flatcloth.core.types import MIRROR, FlattenedView, Float64, Int64
from flatcloth.engine.both_sides import BothSides, one_side
from flatcloth.engine.evaluation import Truth, look_up
from flatcloth.engine.results.sides_truth import FAR_RELATED_M, NEAR_SEAM_M, OtherTruth
from flatcloth.methods.robust.method import RobustMethod
from flatcloth.methods.robust.seams import links as seam_links
from flatcloth.shape.shape import Shape

LEAST = 15
"""Smaller sets are not listed. Chosen: they join nothing."""


def run(options: Options) -> None:
    """Measure and print; write ``results/seams.json`` and ``.md`` unless ``quick``."""
    measure_each("seams", row_of, worst_first, page, options)


def row_of(source: str) -> dict[str, Any]:
    """Return the sets and the contradictions of one recording."""
    integration, document, truth = unattended(source)
    other, its = BothSides(integration).integrated(document)
    assert isinstance(integration.algorithm, RobustMethod)
    assert isinstance(other.algorithm, RobustMethod)
    this_shape, other_shape = (
        method.shapes.of(seen) for method, seen in ((integration.algorithm, document), (other.algorithm, its))
    )
    sides = one_side(integration, document), one_side(other, its)
    pieces = [(each.canonical.view, *each.canonical.floating) for each in sides]
    truths: list[Truth] = [truth, OtherTruth(truth, len(integration.recording))]
    matches = seam_links.matches_of(*pieces)
    true = [
        _true_at(own, seen, uv)
        for own, seen, uv in zip(pieces, truths, (matches.this_uv_m, matches.other_uv_m), strict=True)
    ]
    off_m = np.linalg.norm(true[0] - true[1] * MIRROR, axis=1)
    sets = [
        each for each in seam_links.sets_of(this_shape, other_shape, matches) if len(each.members) >= LEAST
    ]
    strongest = {each.other_piece: each for each in reversed(sets)}
    found = [
        {
            "places": len(each.members),
            "strength": round(each.strength, 1),
            "strongest": strongest[each.other_piece] is each,
            "contradicted": round(
                float(seam_links.contradicting(matches, each, (sides[0].ends, sides[1].ends))[0].sum())
                / len(each.members),
                2,
            ),
            "true_share": round(float(np.nanmean(off_m[each.members] < FAR_RELATED_M)), 2),
        }
        for each in sets
    ]
    contradictions = []
    node_of_match = [
        seam_links.node_at(shape, uv)
        for shape, uv in ((this_shape, matches.this_uv_m), (other_shape, matches.other_uv_m))
    ]
    for n, k in combinations(range(len(sets)), 2):
        if sets[n].other_piece != sets[k].other_piece or seam_links.agree(matches, sets[n], sets[k]):
            continue
        between = [
            _between(shape, node, uv, seen, [sets[each].members for each in (n, k)])
            for shape, node, uv, seen in zip(
                (this_shape, other_shape),
                node_of_match,
                (matches.this_uv_m, matches.other_uv_m),
                true,
                strict=True,
            )
        ]
        is_bridge = sets[n].this_piece != sets[k].this_piece
        contradictions.append(
            {"sets": [n, k], "bridge": is_bridge, **between[1], "this": None if is_bridge else between[0]}
        )
    return {"recording": integration.recording.name, "sets": found, "contradictions": contradictions}


def _between(
    shape: Shape, node: Int64, uv_m: Float64, true_uv_m: Float64, members: Sequence[Int64]
) -> dict[str, float]:
    """Return the evidence of a side's cloth between two sets of matches, and how far it is truly bent.

    ``node``, ``uv_m``, ``true_uv_m`` are of all matches (K,), the members are theirs.
    """
    evidence = seam_links.evidence_between(shape, *(np.unique(node[each]) for each in members))[1]
    one, two = (each[np.isfinite(true_uv_m[each, 0])] for each in members)
    bent = fit_rigid2(uv_m[one], true_uv_m[one]).apply(uv_m[two]) - true_uv_m[two]
    return {
        "evidence": round(evidence, 1),
        "bent_mm": round(1e3 * float(np.median(np.linalg.norm(bent, axis=1))), 1),
    }


def _true_at(pieces: Sequence[FlattenedView], truth: Truth, uv_m: Float64) -> Float64:
    """Return the true places (K, 2) of places of the plane; NaN where none is known near."""
    at = np.concatenate([piece.uv_from_rc(np.argwhere(piece.valid)) for piece in pieces])
    true = np.concatenate([look_up(piece, truth) for piece in pieces])
    known = np.isfinite(true[:, 0])
    away, nearest = cKDTree(at[known]).query(uv_m)
    found: Float64 = np.where((away < NEAR_SEAM_M)[:, None], true[known][nearest], np.nan)
    return found


def worst_first(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the rows by the strongest false set."""
    return sorted(
        rows, key=lambda row: -max((s["strength"] for s in row["sets"] if s["true_share"] < 0.5), default=0)
    )


def page(rows: Sequence[dict[str, Any]]) -> str:
    """Return the Markdown page."""
    lines = []
    for row in rows:
        sets = row["sets"]

        def of(kind: bool, sets: Sequence[dict[str, Any]] = sets) -> str:
            own = [s for s in sets if (s["true_share"] >= 0.5) == kind]
            return ", ".join(
                f"{'**' * s['strongest']}{s['places']}{'**' * s['strongest']} "
                f"({s['strength']:.0f}, {s['contradicted']:.2f})"
                for s in own
            )

        between = ", ".join(
            f"{'bridge ' if c['bridge'] else ''}{c['evidence']:.0f} "
            f"(strength {sets[c['sets'][1]]['strength']:.0f}, bent {c['bent_mm']:.0f} mm"
            + (
                f"; this side {c['this']['evidence']:.0f}, bent {c['this']['bent_mm']:.0f} mm)"
                if c["this"]
                else ")"
            )
            for c in row["contradictions"]
        )
        lines.append(f"| {row['recording']} | {of(False)} | {of(True)} | {between} |")
    text = "\n".join(lines)
    return f"""# Seams: sets of places, true and false

Places of each set of at least {LEAST}, bold where it is the strongest of its piece of the other side; in
brackets its strength, and the true edges that it lays on cloth of the other sheet for each of its places.
Then the evidence of the other side's cloth between two sets that contradict each other, and that of this
side's if both are on one piece of it. The strongest false set comes first.

| recording | false sets | true sets | contradictions |
|---|---|---|---|
{text}
"""
