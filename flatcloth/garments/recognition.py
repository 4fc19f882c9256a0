"""Recognition of a garment: all kinds are fitted and compared by evidence; dimensions and named points.

Kinds are compared by the Laplace approximation of their evidence (MacKay 2003, chapter 27), so that a
kind with more freedom needs to explain more. Errors of the evidence are correlated over some centimetres, so
differences are divided by ``TEMPERATURE``.
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
from flatcloth.core.types import FlattenedView, Float64, Rigid2
from flatcloth.flattening.borders import SPACING_M
from flatcloth.flattening.sampling import LEAST_INTERVAL_M
from flatcloth.garments.distance import to_edges
from flatcloth.garments.evidence import LEAST_AREA_M2, PieceEvidence
from flatcloth.garments.fit import (
    APART_M,
    OUTLINE_STD_M,
    STARTS,
    TEMPERATURE,
    Fit,
    Pull,
    refine,
    robust_weight,
    starts,
)
from flatcloth.garments.kinds import known_kinds
from flatcloth.garments.model import Kind, with_slope
from flatcloth.garments.placing import Placed, place_pieces
from flatcloth.segmentation.settings import SURE

NONE = "none of these"
MISFIT, MISFIT_STD = 0.135, 0.016
"""Misfit (:func:`misfit_of`) at which a garment is as likely an unknown one, and the width of the transition.
The first is of the first run of ``python -m benchmarks garments``, whose limits are lower now
(docs/results.md); no benchmark measures the width."""
HOLE_M = 0.03
"""Length of true edges round holes that makes an unknown garment e times as likely: no kind has an opening
inside its outline. Chosen; in no recording of the development is an inner border a true edge all round
(``python -m benchmarks garments``)."""
POINT_NEAR_M = LEAST_INTERVAL_M
"""A named point is seen if cloth lies this near to its place: the distance of neighbouring samples."""
KNOWN_STD_M = 0.025
"""A named point whose place is known worse than this is predicted, whatever cloth lies there, and a loose
piece is not placed without asking. Chosen: twice ``POINT_NEAR_M``."""
THINNED = 3
"""Of so many edges and places inside, one counts in the first fits. Chosen for speed."""


@dataclass(frozen=True, kw_only=True)
class Measure:
    """A dimension: value and standard deviation, m."""

    value_m: float
    std_m: float


@dataclass(frozen=True, kw_only=True)
class Point:
    """A named point: its place (2,) on the plane of the shape and standard deviation (each axis), m.

    ``pixel`` is the pixel (row, col) of the shape where its cloth was seen, or that of a floating
    ``piece`` which was placed there, by its index; None: predicted only. ``doubt_m`` is the part of its
    deviation that comes of other places of the outline.
    """

    uv_m: Float64
    std_m: float
    pixel: tuple[int, int] | None
    piece: int | None = None
    doubt_m: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Recognition:
    """What a shape is.

    ``probabilities`` of every known kind and of :data:`NONE`; ``fits`` the best fit of each kind, the
    most probable first; ``pieces`` the floating pieces that the most probable kind has a place for.
    ``by_hand`` is the kind that an operator set, ``held`` the named points that one holds in their places.
    """

    probabilities: dict[str, float]
    fits: tuple[Fit, ...]
    dimensions: dict[str, Measure]
    points: dict[str, Point]
    pieces: tuple[Placed, ...] = ()
    by_hand: str | None = None
    held: frozenset[str] = frozenset()

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

    @property
    def upright_from_shape(self) -> Rigid2:
        """The motion of the plane that turns the shape upright."""
        return self.fit.garment_from_piece[0]


def is_sure(piece: Placed) -> bool:
    """Return whether a piece may be placed without asking the operator, as unsure as the cloth around it."""
    most_m = math.sqrt(2) * KNOWN_STD_M  # of both axes together
    return piece.probability >= SURE and piece.fit_std_m <= most_m


def is_offered(piece: Placed) -> bool:
    """Return whether an operator is asked about the place of a piece: unless it is surely wrong."""
    return piece.probability >= 1.0 - SURE


def recognise(shape: FlattenedView, evidence: Sequence[PieceEvidence]) -> Recognition:
    """Find which garment a shape is.

    Parameters
    ----------
    shape : FlattenedView
        The canonical view, for the pixels of the named points.
    evidence : sequence of PieceEvidence
        Of the canonical view first, then of each floating piece.

    Raises
    ------
    GarmentError
        If there is too little cloth or border.
    """
    main = evidence[0]
    if main.area_m2 < LEAST_AREA_M2:
        raise GarmentError(
            f"The shape has {1e4 * main.area_m2:.0f} cm2 of cloth; a garment is not recognised below "
            f"{1e4 * LEAST_AREA_M2:.0f} cm2. Add views."
        )
    if not has_enough_edges(main):
        raise GarmentError(
            f"Only {100 * SPACING_M * len(main.edge_uv_m):.0f} cm of the shape's border are true edges; "
            "a garment is not recognised by so few. Add views that face its edges."
        )
    fits = _with_witnesses(fits_of(main), [piece.this_side for piece in evidence[1:]])
    placed: dict[str, list[Placed]] = {}
    gains: dict[str, float] = {}
    for fit in fits:
        if fit.log_evidence < fits[0].log_evidence - 4 * TEMPERATURE:
            continue
        placed[fit.kind.name] = place_pieces(fit, evidence)
        gains[fit.kind.name] = -sum(_cost(each, fit) for each in placed[fit.kind.name])
    least = min(gains.values(), default=0.0)
    fits.sort(key=lambda f: -(f.log_evidence + gains.get(f.kind.name, least)))
    probabilities = _probabilities(fits, gains, least, main)
    best = _with_pieces(fits[0], placed[fits[0].kind.name])
    fits[0] = best
    points = points_of(best, shape, main)
    return Recognition(
        probabilities=probabilities,
        fits=tuple(fits),
        dimensions=dimensions_of(best, points),
        points=points,
        pieces=tuple(placed[best.kind.name]),
    )


def _with_witnesses(fits: list[Fit], others: Sequence[PieceEvidence]) -> list[Fit]:
    """Return the fits with the evidence of the other large pieces added, the most probable first.

    A piece that is large enough to be recognised by itself is evidence of the kind, wherever it lies. An
    unlikely kind is given the worst fit of the other kinds.
    """
    for piece in sorted(others, key=lambda piece: -piece.area_m2):
        if piece.area_m2 >= LEAST_AREA_M2 and has_enough_edges(piece):
            likely = [fit.kind for fit in fits if _is_likely(fit, fits[0])]
            own = {kind.name: _rough_evidence(kind, piece) for kind in likely}
            worst = min(own.values())
            fits = _most_probable_first(
                replace(f, log_evidence=f.log_evidence + own.get(f.kind.name, worst)) for f in fits
            )
    return fits


def _is_likely(fit: Fit, best: Fit) -> bool:
    """Return whether a kind is at most e^8 (3000) times less probable: only such kinds get the slow steps."""
    return fit.log_evidence >= best.log_evidence - 8 * TEMPERATURE


def has_enough_edges(piece: PieceEvidence) -> bool:
    """Return whether the true edges are as long as two sides of a square of the least area: 20 cm."""
    return len(piece.edge_uv_m) * SPACING_M >= 2.0 * math.sqrt(LEAST_AREA_M2)


def best_fits(main: PieceEvidence, kinds: Sequence[Kind]) -> list[Fit]:
    """Return the best fit of each kind to one piece, however likely it is, the most probable first."""
    return _most_probable_first(fits_of(main, [kind])[0] for kind in kinds)


def fits_of(main: PieceEvidence, kinds: Sequence[Kind] = ()) -> list[Fit]:
    """Return the fit of every kind, or of these, to one piece, the most probable first.

    Half of the starts, with some of the edges, decide which kinds are likely; these get all starts and edges.
    """
    coarse, found = main.thinned(THINNED), []
    begun = [(kind, starts(kind, main, STARTS)) for kind in kinds or known_kinds()]
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


def probabilities_by(fits: list[Fit], main: PieceEvidence) -> dict[str, float]:
    """Return the probabilities of the kinds and of :data:`NONE` by the fits to one piece."""
    return _probabilities(fits, {}, 0.0, main)


def _with_pieces(fit: Fit, pieces: list[Placed]) -> Fit:
    """Return the fit to the main piece and to the largest other that surely belongs to it."""
    sure = [piece for piece in pieces if is_sure(piece)]
    if not sure:
        return fit
    return replace(sure[0].fit, energy=fit.energy, log_evidence=fit.log_evidence)


def _cost(placed: Placed, alone: Fit) -> float:
    """Return what a piece costs at its best place beyond the main piece alone."""
    return max(placed.fit.energy - alone.energy, 0.0)


def _rough_evidence(kind: Kind, piece: PieceEvidence) -> float:
    """Return the evidence of a piece for a kind, by fewer starts and points."""
    return _roughly(kind, piece.thinned(THINNED), starts(kind, piece, STARTS // 2))[0].log_evidence


def held_fit(fit: Fit, main: PieceEvidence, pulls: tuple[Pull, ...]) -> Fit:
    """Return the fit with named points held where they were put; the rest follows."""
    coarse = main.thinned(THINNED)
    poses = fit.garment_from_piece[:1]
    return refine(fit.kind, (coarse,), fit.parameters, poses, pulls=pulls, annealed=(1.0,))


def _probabilities(
    fits: list[Fit], gains: dict[str, float], least: float, main: PieceEvidence
) -> dict[str, float]:
    logs = np.array([f.log_evidence + gains.get(f.kind.name, least) for f in fits]) / TEMPERATURE
    shares = np.exp(logs - logs.max())
    shares /= shares.sum()
    misfit = misfit_of(fits[0], main)
    none = float(expit((misfit - MISFIT) / MISFIT_STD + main.hole_edge_m / HOLE_M))
    found = {f.kind.name: float(share * (1.0 - none)) for f, share in zip(fits, shares, strict=True)}
    return {**found, NONE: none}


def misfit_of(fit: Fit, main: PieceEvidence) -> float:
    """Return the energy of a fit per true edge that can be trusted."""
    return fit.energy / max(float(main.edge_trust.sum()), 1.0)


def is_suspect(fit: Fit, main: PieceEvidence) -> bool:
    """Return whether a shape may be no garment as it is, so that its links are looked into."""
    return misfit_of(fit, main) > MISFIT - 3.0 * MISFIT_STD


def dimensions_of(fit: Fit, points: Mapping[str, Point]) -> dict[str, Measure]:
    """Return the dimensions of a fit, between its named points where they were found.

    A dimension that both sides have is the mean of both, weighted by how well their points are known. Its
    standard deviation is that of the symmetric outline, with the error and the doubt of its points.
    """
    count = len(fit.kind.parameters)
    covariance = fit.covariance[:count, :count]

    def lengths(parameters: Float64) -> Float64:
        named = fit.kind.named(parameters)
        pairs = fit.kind.dimensions.values()
        return np.stack([np.linalg.norm(named[a] - named[b], axis=0) for a, b in pairs])

    _, slope = with_slope(lengths, fit.parameters)
    outline_std = np.sqrt(np.einsum("kp,pq,kq->k", slope, covariance, slope))
    found: dict[str, Measure] = {}
    for (name, (a, b)), std in zip(fit.kind.dimensions.items(), outline_std, strict=True):
        pairs = {frozenset((a, b)), frozenset((_mirrored(a, points), _mirrored(b, points)))}
        ends = [tuple(points[end] for end in pair) for pair in pairs]
        variance = [one.std_m**2 + other.std_m**2 for one, other in ends]
        off = [float(np.linalg.norm(one.uv_m - other.uv_m)) for one, other in ends]
        doubt = min(max(one.doubt_m, other.doubt_m) for one, other in ends)
        found[name] = Measure(
            value_m=float(np.average(off, weights=1.0 / np.array(variance))),
            std_m=math.hypot(std, OUTLINE_STD_M, doubt),
        )
    return found


def _mirrored(name: str, points: Mapping[str, Point]) -> str:
    """Return the name of a point's mirror image; its own if there is none."""
    for side, other in (("_right", "_left"), ("_left", "_right")):
        if name.endswith(side) and (mirrored := name.removesuffix(side) + other) in points:
            return mirrored
    return name


def points_of(
    fit: Fit,
    shape: FlattenedView,
    main: PieceEvidence,
    held: Mapping[str, tuple[Float64, float]] = MappingProxyType({}),
) -> dict[str, Point]:
    """Return the named points of a fit on the plane of the shape; ``held`` are given (place, std) by hand.

    Cloth is not exactly symmetric: a point whose true edges were seen follows them.
    """
    count = len(fit.kind.parameters)
    pose = fit.garment_from_piece[0]
    joint = fit.covariance[: count + 3, : count + 3]
    names = list(fit.kind.named(fit.parameters[:, None]))

    def places(x: Float64) -> Float64:
        named = np.concatenate(list(fit.kind.named(x[:count]).values()))
        cos, sin = np.cos(x[count]), np.sin(x[count])
        u, v = named[0::2] - x[count + 1], named[1::2] - x[count + 2]
        return np.stack([cos * u + sin * v, -sin * u + cos * v], axis=1).reshape(-1, x.shape[1])

    x = np.concatenate([fit.parameters, [pose.theta_rad, pose.u_m, pose.v_m]])
    value, slope = with_slope(places, x)
    variance = np.einsum("kp,pq,kq->k", slope, joint, slope)
    outline_uv = pose.inverse().apply(fit.outline)
    points: dict[str, Point] = {}
    doubt = _doubt_of(fit, value.reshape(-1, 2)) if not held else np.zeros(len(names))
    for n, name in enumerate(names):
        own = np.s_[2 * n : 2 * n + 2]
        point_std = math.sqrt(float(variance[own].mean()) + OUTLINE_STD_M**2)
        uv, std = held[name] if name in held else _followed(value[own], point_std, outline_uv, main)
        doubt_m = math.sqrt(doubt[n])
        std = math.hypot(std, doubt_m)  # the edges nearby do not decide which optimum is right
        pixel = pixel_near(uv, shape) if std <= KNOWN_STD_M else None
        points[name] = Point(uv_m=uv, std_m=std, pixel=pixel, doubt_m=doubt_m)
    return points


def _doubt_of(fit: Fit, places: Float64) -> Float64:
    """Return the variance (N,) of named points at ``places`` (N, 2) by the other optima of the same kind.

    That of the mixture of all optima by their evidence, about the best one; none if that is sure. The
    corners of a towel have no order, so that its optima differ by their names only.
    """
    if fit.kind.corners is not None:
        return np.zeros(len(places))
    total, variance, known = 1.0, np.zeros(len(places)), [places]
    for below, other in fit.others:
        share = math.exp(min(below, 0.0) / TEMPERATURE)
        named = np.stack([place[:, 0] for place in other.kind.named(other.parameters[:, None]).values()])
        there = other.garment_from_piece[0].inverse().apply(named)
        # Several starts lead to the same optimum.
        if all(np.abs(there - each).max() > APART_M for each in known):
            known.append(there)
            total += share
            variance += share * np.square(there - places).sum(axis=1) / 2
    sure = 1.0 / total >= SURE
    found: Float64 = np.zeros(len(places)) if sure else variance / total
    return found


def pixel_near(uv: Float64, shape: FlattenedView) -> tuple[int, int] | None:
    """Return the pixel with cloth nearest to a place, None if none is within :data:`POINT_NEAR_M`."""
    row, col = shape.rc_from_uv(uv).tolist()
    radius_px = POINT_NEAR_M / shape.pixel_size_m
    first_row, first_col = max(0, math.floor(row - radius_px)), max(0, math.floor(col - radius_px))
    window = shape.valid[
        first_row : math.ceil(row + radius_px) + 1, first_col : math.ceil(col + radius_px) + 1
    ]
    if row < -radius_px or col < -radius_px or not window.any():
        return None
    rc = np.argwhere(window) + np.array([first_row, first_col])
    off = np.hypot(rc[:, 0] - row, rc[:, 1] - col)
    nearest = int(off.argmin())
    return (int(rc[nearest, 0]), int(rc[nearest, 1])) if off[nearest] <= radius_px else None


def _followed(uv: Float64, std_m: float, outline_uv: Float64, main: PieceEvidence) -> tuple[Float64, float]:
    """Return a named point moved with the true edges nearby, and its standard deviation then.

    The corner of the outline is shifted so that its sides meet the edges on either side of it: linear
    least squares of the shift (2,), with the fit as the prior and robust weights.
    """
    near = np.linalg.norm(main.edge_uv_m - uv, axis=1) <= APART_M
    if near.sum() < 6:
        return uv, std_m
    q, normal, trust = main.edge_uv_m[near], main.edge_normal[near], main.edge_weight * main.edge_trust[near]
    shift: Float64 = np.zeros(2)
    precision = np.eye(2) / std_m**2
    for _ in range(4):
        _, _, away, distance = to_edges(q - shift, normal, outline_uv)
        z = distance / OUTLINE_STD_M
        weight = trust * np.square(robust_weight(z)) / OUTLINE_STD_M**2
        matrix = precision + (away * weight[:, None]).T @ away
        pull: Float64 = away.T @ (weight * (distance + away @ shift))
        shift = np.linalg.solve(matrix, pull).astype(np.float64)
    variance = float(np.trace(np.linalg.inv(matrix))) / 2
    return uv + shift, math.hypot(math.sqrt(variance), OUTLINE_STD_M)
