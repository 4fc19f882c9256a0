"""Recognition of a garment: all kinds are fitted and compared by evidence; dimensions and named points.

Kinds are compared by the Laplace approximation of their evidence (MacKay 2003, chapter 27), so that a
kind with more freedom needs to explain more. Errors of the evidence are correlated over some centimetres, so
differences are divided by a temperature (:func:`temperature_of`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import cv2
import numpy as np
from scipy.special import expit

from flatcloth.core.errors import GarmentError
from flatcloth.core.geometry import widest_gap_deg
from flatcloth.core.types import FlattenedView, Float64, Rigid2
from flatcloth.flattening.borders import SPACING_M
from flatcloth.garments.evidence import LEAST_AREA_M2, PieceEvidence
from flatcloth.garments.fit import OUTLINE_STD_M, STARTS, TEMPERATURE, Fit, Pull, refine, starts
from flatcloth.garments.kinds import known_kinds
from flatcloth.garments.model import Kind
from flatcloth.garments.named_points import KNOWN_STD_M, Measure, Point, dimensions_of, points_of
from flatcloth.garments.placing import Placed, place_pieces
from flatcloth.segmentation.settings import SURE
from flatcloth.shape.joints import false_share

NONE = "none of these"
MISFIT, MISFIT_STD = 0.135, 0.016
"""Misfit (:func:`misfit_of`) at which a garment is as likely an unknown one, and the width of the transition.
The first was measured (docs/tried.md), the width was set by hand."""
HOLE_M = 0.03
"""Length of true edges round holes that makes an unknown garment e times as likely: no kind has an opening
inside its outline. Chosen; in no recording of the development is an inner border a true edge all round
(``python -m benchmarks garments``)."""
THINNED = 3
"""Of so many edges and places inside, one counts in the first fits. Chosen for speed."""


@dataclass(frozen=True, kw_only=True)
class Recognition:
    """What a shape is.

    ``probabilities`` of every known kind and of :data:`NONE`; ``fits`` the best fit of each kind, the
    most probable first; ``pieces`` the floating pieces that the most probable kind has a place for.
    ``by_hand`` is the kind that an operator set, ``held`` the named points that one holds in their places;
    ``temperature`` is that of the probabilities.
    """

    probabilities: dict[str, float]
    fits: tuple[Fit, ...]
    dimensions: dict[str, Measure]
    points: dict[str, Point]
    pieces: tuple[Placed, ...] = ()
    by_hand: str | None = None
    held: frozenset[str] = frozenset()
    temperature: float = TEMPERATURE

    @property
    def fit(self) -> Fit:
        """The most probable fit of a kind."""
        return self.fits[0]

    @property
    def likeliest(self) -> tuple[str, float]:
        """The most probable of the known kinds, with its probability."""
        return self.fit.kind.name, self.probabilities[self.fit.kind.name]

    @property
    def kind(self) -> str:
        """The kind set by hand, else the most probable answer: a kind, or :data:`NONE`."""
        return self.by_hand or max(self.probabilities, key=lambda name: self.probabilities[name])

    @property
    def probability(self) -> float:
        """The probability of :attr:`kind`."""
        return self.probabilities[self.kind]

    @property
    def outline_uv_m(self) -> Float64:
        """(V, 2) the fitted outline on the plane of the shape."""
        return self.fit.garment_from_piece[0].inverse().apply(self.fit.outline)

    @property
    def apart_m(self) -> float:
        """The root mean square distance of two places of the item, whichever of the kinds it is."""
        # Central moments of the area of each outline; all kinds count alike if it is surely none of them.
        areas = [cv2.moments(fit.outline[:, None].astype(np.float32)) for fit in self.fits]
        squared_m2 = [2.0 * (area["mu20"] + area["mu02"]) / area["m00"] for area in areas]
        shares = [self.probabilities[fit.kind.name] + 1e-9 for fit in self.fits]
        return math.sqrt(float(np.average(squared_m2, weights=shares)))


def is_sure(piece: Placed) -> bool:
    """Return whether a piece may be placed without asking the operator, as unsure as the cloth around it."""
    most_m = math.sqrt(2) * KNOWN_STD_M  # of both axes together
    return piece.probability >= SURE and piece.fit_std_m <= most_m


def is_offered(piece: Placed) -> bool:
    """Return whether an operator is asked about the place of a piece: unless it is surely wrong."""
    return piece.probability >= 1.0 - SURE


def temperature_of(angles_deg: Sequence[float]) -> float:
    """Return by what differences in the evidence of kinds are divided, for views at some angles (V,).

    What no view shows may be of another kind. The evidence counts in proportion to the part of a full turn
    that the views surround; those of half a turn count as ``TEMPERATURE`` says.
    """
    surrounded_deg = 360.0 - widest_gap_deg(angles_deg)
    return TEMPERATURE * 180.0 / surrounded_deg if surrounded_deg > 0.0 else math.inf


def recognise(
    shape: FlattenedView, evidence: Sequence[PieceEvidence], temperature: float = TEMPERATURE
) -> Recognition:
    """Find which garment a shape is.

    Cloth on doubtful joints may be anywhere, which its deviations say, and tells little; but more probably it
    is where it lies. The kinds are compared both ways. The second has the prior of a joint that hardly any
    evidence holds, and does not count if none of the kinds fits.

    Parameters
    ----------
    shape : FlattenedView
        The canonical view, for the pixels of the named points.
    evidence : sequence of PieceEvidence
        Of the canonical view first, then of each floating piece.
    temperature : float
        By what differences in the evidence of kinds are divided: :func:`temperature_of`.

    Raises
    ------
    GarmentError
        If there is too little cloth or border.
    """
    main = evidence[0]
    if lack := _lacks(main):
        raise GarmentError(lack)
    fits, placed, chances = _compared(evidence, temperature)
    if any((piece.edge_std_m > OUTLINE_STD_M).any() for piece in evidence):
        laid = [piece.as_laid(OUTLINE_STD_M) for piece in evidence]
        right, prior = _compared(laid, temperature, fits)[2], 1.0 - float(false_share(np.zeros(1))[0])
        rest = 1.0 - prior * (1.0 - right[NONE])
        chances = {name: rest * p + prior * right[name] * (name != NONE) for name, p in chances.items()}
        fits.sort(key=lambda fit: -chances[fit.kind.name])
    best = fits[0]
    pieces = [  # a place is as sure as the kind
        replace(each, probability=chances[best.kind.name] * each.probability)
        for each in placed.get(best.kind.name) or place_pieces(best, evidence)
    ]
    if sure := [piece for piece in pieces if is_sure(piece)]:  # the largest belongs to it
        best = fits[0] = replace(sure[0].fit, energy=best.energy, log_evidence=best.log_evidence)
    points = points_of(best, shape, main)
    return Recognition(
        probabilities=chances,
        fits=tuple(fits),
        dimensions=dimensions_of(best, points),
        points=points,
        pieces=tuple(pieces),
        temperature=temperature,
    )


def _compared(
    evidence: Sequence[PieceEvidence], temperature: float, before: Sequence[Fit] = ()
) -> tuple[list[Fit], dict[str, list[Placed]], dict[str, float]]:
    """Return the fit of every kind, the most probable first; where likely kinds have the floating pieces; and
    the probabilities of all kinds. The optima of fits ``before`` are starts.
    """
    main = evidence[0]
    fits = _with_witnesses(fits_of(main, before=before), [piece.sheets[0] for piece in evidence[1:]])
    placed: dict[str, list[Placed]] = {}
    gains: dict[str, float] = {}
    for fit in fits:
        if fit.log_evidence < fits[0].log_evidence - 4 * TEMPERATURE:
            continue
        placed[fit.kind.name] = place_pieces(fit, evidence)
        # What pieces cost at their best places beyond the main piece alone, or as what belongs to nothing.
        gains[fit.kind.name] = sum(
            float(np.logaddexp(-max(p.fit.energy - fit.energy, 0.0), -evidence[1 + p.index].measurements))
            for p in placed[fit.kind.name]
        )
    least = min(gains.values(), default=0.0)
    fits.sort(key=lambda f: -(f.log_evidence + gains.get(f.kind.name, least)))
    return fits, placed, probabilities_by(fits, main, temperature, gains)


def _with_witnesses(fits: list[Fit], others: Sequence[PieceEvidence]) -> list[Fit]:
    """Return the fits with the evidence of the other large pieces added, the most probable first.

    A piece that is large enough to be recognised by itself is evidence of the kind, wherever it lies; or it
    belongs to nothing. An unlikely kind is given the worst fit of the other kinds.
    """
    for piece in sorted(others, key=lambda piece: -piece.area_m2):
        if not _lacks(piece):
            likely = [fit.kind for fit in fits if _is_likely(fit, fits[0])]
            coarse = piece.thinned(THINNED)  # by fewer starts and points
            alone = [_roughly(kind, coarse, starts(kind, piece, STARTS // 2))[0] for kind in likely]
            best = max(alone, key=lambda fit: fit.log_evidence)
            nothing = best.log_evidence + best.energy - piece.measurements
            own = {f.kind.name: float(np.logaddexp(f.log_evidence, nothing)) for f in alone}
            worst = min(own.values())
            fits = _most_probable_first(
                replace(f, log_evidence=f.log_evidence + own.get(f.kind.name, worst)) for f in fits
            )
    return fits


def _is_likely(fit: Fit, best: Fit) -> bool:
    """Return whether a kind is at most e^8 (3000) times less probable: only such kinds get the slow steps."""
    return fit.log_evidence >= best.log_evidence - 8 * TEMPERATURE


def _lacks(piece: PieceEvidence) -> str:
    """Return what a piece lacks to be recognised: cloth, or true edges as long as two sides of its square."""
    edges_m = SPACING_M * len(piece.edge_uv_m)
    if piece.area_m2 < LEAST_AREA_M2:
        return (
            f"The shape has {1e4 * piece.area_m2:.0f} cm2 of cloth; a garment is not recognised below "
            f"{1e4 * LEAST_AREA_M2:.0f} cm2. Add views."
        )
    if edges_m < 2 * math.sqrt(LEAST_AREA_M2):
        return (
            f"Only {100 * edges_m:.0f} cm of the shape's border are true edges; a garment is not recognised "
            "by so few. Add views that face its edges."
        )
    return ""


def fits_of(main: PieceEvidence, kinds: Sequence[Kind] = (), before: Sequence[Fit] = ()) -> list[Fit]:
    """Return the fit of every kind, or of these, to one piece, the most probable first.

    Half of the starts, with some of the edges, decide which kinds are likely; these get all starts and edges.
    The optima of fits ``before`` are starts.
    """
    coarse, found = main.thinned(THINNED), []
    begun = [(f.kind, [(g.parameters, g.garment_from_piece[0]) for _, g in f.others]) for f in before]
    begun = begun or [(kind, starts(kind, main, STARTS)) for kind in kinds or known_kinds()]
    tried = [_roughly(kind, coarse, some[: STARTS // 2]) for kind, some in begun]
    best = max((fits[0] for fits in tried), key=lambda f: f.log_evidence)
    for (kind, some), fits in zip(begun, tried, strict=True):
        fit = fits[0]
        if _is_likely(fit, best):
            fits = _most_probable_first([*fits, *_roughly(kind, coarse, some[STARTS // 2 :])])
            fit = refine(kind, (main,), fits[0].parameters, fits[0].garment_from_piece, annealed=(1.0,))
        others = tuple((f.log_evidence - fits[0].log_evidence, f) for f in fits)
        found.append(replace(fit, others=others))
    return _most_probable_first(found)


def _roughly(kind: Kind, coarse: PieceEvidence, some: Sequence[tuple[Float64, Rigid2]]) -> list[Fit]:
    """Return the fits of one kind from some starts, the most probable first."""
    return _most_probable_first(
        refine(kind, (coarse,), begin, (pose,), annealed=(4.0, 1.0)) for begin, pose in some
    )


def _most_probable_first(fits: Iterable[Fit]) -> list[Fit]:
    return sorted(fits, key=lambda fit: -fit.log_evidence)


def held_fit(fit: Fit, main: PieceEvidence, pulls: tuple[Pull, ...]) -> Fit:
    """Return the fit with named points held where they were put; the rest follows."""
    coarse = main.thinned(THINNED)
    poses = fit.garment_from_piece[:1]
    return refine(fit.kind, (coarse,), fit.parameters, poses, pulls=pulls, annealed=(1.0,))


def probabilities_by(
    fits: list[Fit],
    main: PieceEvidence,
    temperature: float = TEMPERATURE,
    gains: Mapping[str, float] = MappingProxyType({}),
) -> dict[str, float]:
    """Return the probabilities of the kinds and of :data:`NONE` by the fits to a piece.

    ``gains`` are what further pieces add to the evidence of kinds; other kinds get the least of them.
    """
    least = min(gains.values(), default=0.0)
    logs = np.array([f.log_evidence + gains.get(f.kind.name, least) for f in fits]) / temperature
    shares = np.exp(logs - logs.max())
    shares /= shares.sum()
    misfit = misfit_of(fits[0], main)
    none = float(expit((misfit - MISFIT) / MISFIT_STD + main.hole_edge_m / HOLE_M))
    found = {f.kind.name: float(share * (1.0 - none)) for f, share in zip(fits, shares, strict=True)}
    return {**found, NONE: none}


def misfit_of(fit: Fit, main: PieceEvidence) -> float:
    """Return the energy of a fit per true edge that can be trusted."""
    return fit.energy / max(float(main.edge_trust.sum()), 1.0)
