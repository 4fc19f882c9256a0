"""How probable it is that sets of places where rims meet are seams, and that cloth between them is true.

For each recording and each pair of pieces: all sets with what their probability rests on (strength, true
edges on cloth of the other sheet), that probability, and whether they are true; for each two that place the
pieces differently, the evidence of the cloth between them on either side. The odds of ``seams/links.py`` are
those by which all pairs of pieces are most probably as they truly are; figures are of garments left out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations

import numpy as np
from scipy.optimize import minimize
from scipy.spatial import cKDTree
from scipy.special import expit

from benchmarks.inputs import measure_each
from benchmarks.output import Options, Row, recordings_of, save_page
from benchmarks.unattended import unattended
from flatcloth.core.geometry import fit_rigid2
from flatcloth.core.types import MIRROR, FlattenedView, Float64
from flatcloth.engine.evaluation import FAR_RELATED_M, NEAR_SEAM_M, OtherTruth, Truth, look_up
from flatcloth.engine.garment import GarmentService, one_side
from flatcloth.methods.robust.method import RobustMethod
from flatcloth.methods.robust.seams import links as seam_links
from flatcloth.methods.robust.seams.links import Configuration, configured
from flatcloth.methods.robust.seams.rims import rim_of

_HELD = 0.05  # weight that draws the coefficients to 0: hardly
_MIXED = 0.3, 0.7  # a set with such a share of true places is neither true nor false


def run(options: Options) -> None:
    """Measure and print; write ``results/seams.json`` and ``.md`` unless ``quick``."""
    rows = measure_each("seams", rows_of, options, ordered=worst_first)
    if not options.quick:
        save_page("seams", page(rows), recordings_of(rows))


def rows_of(source: str) -> list[Row]:
    """Return the sets and the contradictions of one recording."""
    integration, document, truth = unattended(source)
    other, its = GarmentService(integration).integrated(document)
    assert isinstance(integration.algorithm, RobustMethod)
    assert isinstance(other.algorithm, RobustMethod)
    shapes = integration.algorithm.shapes.of(document), other.algorithm.shapes.of(its)
    sides = one_side(integration, document), one_side(other, its)
    pieces = [(each.canonical.view, *each.canonical.floating) for each in sides]
    truths: list[Truth] = [truth, OtherTruth(truth, len(integration.recording))]
    ends = sides[0].ends(), sides[1].ends()
    matches = seam_links.matches_of(*map(rim_of, pieces, ends))
    places = matches.this_uv_m, matches.other_uv_m
    true = [_true_at(*each) for each in zip(pieces, truths, places, strict=True)]
    off_m = np.linalg.norm(true[0] - true[1] * MIRROR, axis=1)
    sets = seam_links.sets_of(*shapes, matches)
    decided = seam_links.linked(*shapes, matches, sets, ends)[2]
    node = [seam_links.node_at(*each) for each in zip(shapes, places, strict=True)]
    name, rows = integration.recording.name, []
    for pieces_of in sorted({(each.this_piece, each.other_piece) for each in sets}):
        own = [n for n, each in enumerate(sets) if (each.this_piece, each.other_piece) == pieces_of]
        row: Row = {"recording": name, "sets": [], "between": []}
        edges = [seam_links.edges_against(matches, sets[n], ends) for n in own]
        for n, against in zip(own, edges, strict=True):
            known = np.isfinite(off_m[sets[n].members])
            share = float((off_m[sets[n].members][known] < FAR_RELATED_M).mean()) if known.any() else None
            row["sets"].append({
                "strength": round(sets[n].strength, 1),
                "against": round(float(against[2].sum()), 1),
                "probability": round(decided[n].probability, 4),
                "true_share": None if share is None else round(share, 2),
            })  # fmt: skip
        for one, two in combinations(range(len(own)), 2):
            links = sets[own[one]], sets[own[two]]
            if not seam_links.agree(matches, *links):
                both = edges[one], edges[two]
                joints = [seam_links.joint_between(k, shapes[k], node[k], links, both) for k in (0, 1)]
                known = [(round(j.evidence, 1), round(j.relief, 3)) for j in joints if j.evidence < math.inf]
                false = [_is_false(*each, *links) for each in zip(places, true, strict=True)]
                row["between"].append([one, two, known, false if len(known) == 2 else []])
        rows.append(row)
    return rows


def _true_at(pieces: Sequence[FlattenedView], truth: Truth, uv_m: Float64) -> Float64:
    """Return the true places (K, 2) of places of the plane; NaN where none is known near."""
    at = np.concatenate([piece.uv_from_rc(np.argwhere(piece.valid)) for piece in pieces])
    true = np.concatenate([look_up(piece, truth) for piece in pieces])
    known = np.isfinite(true[:, 0])
    away, nearest = cKDTree(at[known]).query(uv_m)
    found: Float64 = np.where((away < NEAR_SEAM_M)[:, None], true[known][nearest], np.nan)
    return found


def _is_false(uv_m: Float64, true_m: Float64, one: seam_links.SeamLink, other: seam_links.SeamLink) -> bool:
    """Return whether cloth between two sets joins falsely, by the places (K, 2) of all matches."""
    ends = [link.members[np.isfinite(true_m[link.members, 0])] for link in (one, other)]
    off_m = [
        np.linalg.norm(fit_rigid2(uv_m[a], true_m[a]).apply(uv_m[b]) - true_m[b], axis=1)
        for a, b in (ends, ends[::-1])
        if min(len(a), len(b)) > 2
    ]
    return bool(off_m and min(map(np.median, off_m)) > seam_links.MOST_DRIFT_M)


def worst_first(rows: Sequence[Row]) -> list[Row]:
    """Return the rows by the surest false set."""
    false = [[-s["probability"] for s in row["sets"] if _is_true(s) is False] for row in rows]
    return [rows[n] for n in sorted(range(len(rows)), key=lambda n: min(false[n], default=0.0))]


def _is_true(found: Row) -> bool | None:
    share = found["true_share"]
    return None if share is None or _MIXED[0] < share < _MIXED[1] else share > _MIXED[0]


def _false(known: Sequence[tuple[float, float]], odds: Float64) -> Float64:
    """Return how probably cloth of each evidence and relief joins falsely, by the odds (5,)."""
    evidence, relief = np.array(known, dtype=np.float64).reshape(-1, 2).T
    return np.asarray(expit(odds[3] + odds[4] * relief - np.log1p(evidence)))


def _configured(row: Row, odds: Float64) -> Configuration:
    """Return what all configurations of the sets of a row say, by the odds of a set and of cloth (5,)."""
    sets = np.array([(1.0, math.log(s["strength"]), math.log1p(s["against"])) for s in row["sets"]])
    between = row["between"]
    false = {(one, two): float(1.0 - np.prod(1.0 - _false(known, odds))) for one, two, known, _ in between}
    return configured((sets @ odds[:3]).tolist(), false)


def fitted(rows: Sequence[Row]) -> Float64:
    """Return the odds (5,), those of a set and of cloth, by which the rows are most probably as they are."""
    known = [[(k, t) for k, s in enumerate(row["sets"]) if (t := _is_true(s)) is not None] for row in rows]

    def loss(odds: Float64) -> float:
        total = _HELD * float(np.square(odds[[1, 2, 4]]).sum())
        for row, those in zip(rows, known, strict=True):
            found = _configured(row, odds)
            right = [found.all_true[:, k] == is_true for k, is_true in those]
            total -= math.log(float(found.chance[np.all(right, axis=0)].sum() if right else 1.0) + 1e-12)
            for one, two, sides, false in row["between"]:
                if any(false) and _is_true(row["sets"][one]) and _is_true(row["sets"][two]):
                    q = _false(sides, odds)  # which of the joints it is, as one of them is
                    total -= np.log(np.where(false, q, 1.0 - q)).sum() - math.log1p(-np.prod(1.0 - q))
        return total

    found: Float64 = minimize(loss, np.array([1.0, 1.5, -1.0, -0.5, 0.5]), tol=1e-3).x
    return found


def page(rows: Sequence[Row]) -> str:
    """Return the Markdown page."""
    garment = np.array([row["recording"].partition("-")[0] for row in rows])
    told = []
    for name in np.unique(garment):
        odds = fitted([rows[n] for n in np.flatnonzero(garment != name)])
        for row in (rows[n] for n in np.flatnonzero(garment == name)):
            for probability, each in zip(_configured(row, odds).probability, row["sets"], strict=True):
                if _is_true(each) is not None:
                    told.append((float(probability), bool(_is_true(each)), each["probability"]))
    p, y, now = np.array(told, dtype=np.float64).T
    y = y > 0.5
    sure, unlikely = p > 0.9, p < 0.1
    constant, strength, against, joint, relief = fitted(rows)
    brier, brier_now = (float(np.mean((each - y) ** 2)) for each in (p, now))
    return f"""# Seams: sets of places, true and false

{len(y)} sets of {len(rows)} pairs of pieces, {y.sum()} true. The odds that make them most probable: of a
set {constant:.2f}, {strength:.2f}, {against:.2f} (constant, strength, true edges against), of false cloth
{joint:.2f}, {relief:.2f} (constant, relief) over 1 plus its evidence. For garments left out the Brier score
is {brier:.3f} (by the constants in the source {brier_now:.3f}); of {sure.sum()} sets of .9 and more
{y[sure].mean():.1%} are true, of {unlikely.sum()} of .1 and less {1 - y[unlikely].mean():.1%} are false.
"""
