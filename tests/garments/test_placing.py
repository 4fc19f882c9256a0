"""Floating pieces, placed by the fitted outline of the garment."""

import dataclasses

import numpy as np
from garment_evidence import at_mean, evidence_from

from flatcloth.core.types import Rigid2
from flatcloth.garments.evidence import PieceEvidence
from flatcloth.garments.fit import Fit, refine, starts
from flatcloth.garments.kinds import kind_named
from flatcloth.garments.placing import place_piece


def main_and_leg() -> tuple[Fit, PieceEvidence, PieceEvidence]:
    outline = at_mean("trousers")
    limit = 0.03
    main = evidence_from(outline, Rigid2(0.3, 0.0, 0.0), np.array([1.0, 0.0, limit]))
    leg = evidence_from(outline, Rigid2(-1.0, 5.0, 2.0), np.array([-1.0, 0.0, -limit]))
    kind = kind_named("trousers")
    fits = (refine(kind, (main,), p, (m,)) for p, m in starts(kind, main, 6))
    return max(fits, key=lambda fit: fit.log_evidence), main, leg


def test_a_floating_leg_is_laid_where_it_belongs() -> None:
    fit, main, leg = main_and_leg()
    placed = place_piece(fit, main, leg, 0)
    assert placed is not None
    wanted = Rigid2(0.3, 0.0, 0.0) @ Rigid2(-1.0, 5.0, 2.0).inverse()
    off = placed.shape_from_piece.apply(leg.inside_uv_m) - wanted.apply(leg.inside_uv_m)
    assert np.linalg.norm(off, axis=1).mean() < 0.03
    assert placed.probability > 0.5


def test_a_piece_is_as_unsure_as_the_edges_around_it_which_are_off_together() -> None:
    fit, main, leg = main_and_leg()
    sure = place_piece(fit, main, leg, 0)
    assert sure is not None
    laid = sure.shape_from_piece.apply(leg.edge_uv_m)
    off_m = np.linalg.norm(main.edge_uv_m[:, None] - laid[None], axis=2)
    around = np.isin(np.arange(len(main.edge_uv_m)), off_m.argmin(axis=0))
    found = [
        place_piece(fit, dataclasses.replace(main, edge_std_m=np.where(which, 0.03, 0.0)), leg, 0)
        for which in (around, ~around)
    ]
    # What they are off together does not average out; edges far away only make the fit less sure.
    assert [piece is not None and piece.std_m > 0.03 for piece in found] == [True, False]
    assert sure.std_m < 0.01
    assert all(piece is not None and piece.fit_std_m < 0.015 for piece in found)


def test_a_scrap_is_not_placed() -> None:
    main = evidence_from(at_mean("towel"))
    kind = kind_named("towel")
    parameters, pose = starts(kind, main, 1)[0]
    fit = refine(kind, (main,), parameters, (pose,))
    assert place_piece(fit, main, dataclasses.replace(main, area_m2=0.001), 0) is None
