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
from flatcloth.core.types import MIRROR, FlattenedView, Float64
from flatcloth.engine.evaluation import FAR_RELATED_M, NEAR_SEAM_M, OtherTruth, Truth, look_up
from flatcloth.engine.garment import GarmentService, one_side
from flatcloth.methods.robust.method import RobustMethod
from flatcloth.methods.robust.seams import links as seam_links
from flatcloth.methods.robust.seams.configuration import Configuration, configured

_HELD = 0.05  # weight that draws the coefficients to 0: hardly


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
    matches = seam_links.matches_of(*pieces)
    places = matches.this_uv_m, matches.other_uv_m
    true = [_true_at(*each) for each in zip(pieces, truths, places, strict=True)]
    off_m = np.linalg.norm(true[0] - true[1] * MIRROR, axis=1)
    sets = seam_links.sets_of(*shapes, matches)
    ends = sides[0].ends(), sides[1].ends()
    decided = seam_links.linked(*shapes, matches, sets, ends)[2]
    cloth = [seam_links.Cloth(shape) for shape in shapes]
    node = [seam_links.node_at(*each) for each in zip(shapes, places, strict=True)]
    name, rows = integration.recording.name, []
    for pieces_of in sorted({(each.this_piece, each.other_piece) for each in sets}):
        own = [n for n, each in enumerate(sets) if (each.this_piece, each.other_piece) == pieces_of]
        row: Row = {"recording": name, "sets": [], "between": []}
        for n in own:
            known = np.isfinite(off_m[sets[n].members])
            share = float((off_m[sets[n].members][known] < FAR_RELATED_M).mean()) if known.any() else None
            row["sets"].append({
                "strength": round(sets[n].strength, 1),
                "against": round(seam_links.trust_against(matches, sets[n], ends), 1),
                "probability": round(decided[n].probability, 4),
                "joins": not decided[n].why,
                "true_share": None if share is None else round(share, 2),
            })  # fmt: skip
        for one, two in combinations(range(len(own)), 2):
            ends_of = [sets[own[one]].members, sets[own[two]].members]
            if not seam_links.agree(matches, sets[own[one]], sets[own[two]]):
                joints = [
                    seam_links.joint_between(k, cloth[k], *(node[k][each] for each in ends_of))
                    for k in (0, 1)
                ]
                evidence = [round(j.evidence, 1) if math.isfinite(j.evidence) else None for j in joints]
                row["between"].append([one, two, *evidence])
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


def worst_first(rows: Sequence[Row]) -> list[Row]:
    """Return the rows by the surest false set."""
    false = [[-s["probability"] for s in row["sets"] if _is_true(s) is False] for row in rows]
    return [rows[n] for n in sorted(range(len(rows)), key=lambda n: min(false[n], default=0.0))]


def _is_true(found: Row) -> bool | None:
    share = found["true_share"]
    return None if share is None else share >= 0.5


def _configured(row: Row, odds: Float64) -> Configuration:
    """Return what all configurations of the sets of a row say, by the odds of a set and of cloth (4,)."""
    sets = np.array([(1.0, math.log(s["strength"]), math.log1p(s["against"])) for s in row["sets"]])
    false = {}
    for one, two, *evidence in row["between"]:
        joined = [expit(odds[3] - math.log1p(each)) for each in evidence if each is not None]
        false[one, two] = float(1.0 - np.prod(1.0 - np.array(joined)))
    return configured((sets @ odds[:3]).tolist(), false)


def fitted(rows: Sequence[Row]) -> Float64:
    """Return the odds (4,), those of a set and of cloth, by which the rows are most probably as they are."""
    known = [[(k, t) for k, s in enumerate(row["sets"]) if (t := _is_true(s)) is not None] for row in rows]

    def loss(odds: Float64) -> float:
        total = _HELD * float(np.square(odds[1:3]).sum())
        for row, those in zip(rows, known, strict=True):
            found = _configured(row, odds)
            right = [found.all_true[:, k] == is_true for k, is_true in those]
            total -= math.log(float(found.chance[np.all(right, axis=0)].sum() if right else 1.0) + 1e-12)
        return total

    found: Float64 = minimize(loss, np.array([-1.0, 1.5, -0.5, 0.0]), tol=1e-3).x
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
    constant, strength, against, joint = fitted(rows)
    brier, brier_now = (float(np.mean((each - y) ** 2)) for each in (p, now))
    return f"""# Seams: sets of places, true and false

{len(y)} sets of {len(rows)} pairs of pieces, {y.sum()} true. The odds that make them most probable: of a
set {constant:.2f}, {strength:.2f}, {against:.2f} (constant, strength, true edges against), of false cloth
{math.exp(joint):.2f} over 1 plus its evidence. For garments left out the Brier score is {brier:.3f}
(by the constants in the source {brier_now:.3f}); of {sure.sum()} sets of .9 and more
{y[sure].mean():.1%} are true, of {unlikely.sum()} of .1 and less {1 - y[unlikely].mean():.1%} are false.
"""
