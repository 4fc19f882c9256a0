"""Comparison of two flattened views at a placement, and search for the best placement.

The criteria are the paper's (4.2), intensity and height, and the Z-angle, on which its initial estimate
rests. Intensity is compared as texture, i.e. minus its local mean, because shading does not move with
the cloth and would shift plain cloth. Height determines plain cloth along the vertical only; across it
the Z-angle does. A placement is scored by the distance in space of the pixels that it lays on each other:
as the rotation is known, the same cloth is at the same place in both views.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from flatcloth.core.compiled import njit
from flatcloth.core.config import FlatteningConfig
from flatcloth.core.geometry import height_m, horizontal_axes, z_angle_deg
from flatcloth.core.types import (
    FlattenedView,
    Float32,
    Float64,
    Progress,
    Rigid2,
    RotationAxis,
    finite,
    no_progress,
)
from flatcloth.flattening.borders import SPACING_M
from flatcloth.flattening.sampling import BENT_DEG
from flatcloth.methods.answers import AlignmentScore

_SEARCH_TRANSLATION_M = 0.06
"""Largest change of the translation in the search. Set by hand."""
_SEARCH_ROTATION_DEG = 15.0
"""Largest change of the rotation in the search. Set by hand."""
_SEARCH_STEP_DEG = 2.5
"""Step of the coarse search in rotation. Set by hand."""
_SEARCH_CANDIDATES = 12
"""Best placements of the coarse search that are searched in detail. Set by hand."""
SEARCH_POINTS = 700
"""Pixels compared in the coarse search. Set by hand."""
COARSE_SMOOTHING_M = SPACING_M
"""Smoothing of the texture in the coarse search, whose step it is, and in the score."""
_COARSE_STEP = np.array([math.radians(_SEARCH_STEP_DEG), COARSE_SMOOTHING_M, COARSE_SMOOTHING_M])
_Z_ANGLE_SMOOTHING_M = COARSE_SMOOTHING_M
"""Z-angles are compared as coarsely as the texture."""
FINE_SMOOTHING_M = FlatteningConfig().pixel_size_m
"""Smoothing of the texture in the detailed search: a pixel of flattened views."""
_MISSING_OVERLAP_COST = 0.3
"""Cost of losing all of the overlap that the initial estimate has. Set by hand."""
_DISTANCE_COST = 0.03
"""Cost of the largest change: of two equal matches, the one nearer to the initial estimate wins. Set by
hand."""
_INTENSITY_FLOOR = 6.0
"""A texture with a smaller spread (grey levels) counts as noise. Set by hand."""
LEAST_OVERLAP_SHARE = 0.1
"""Share of a new view, or of a component, that must lie on the current one. Set by hand."""
_ENOUGH_OVERLAP_M2 = 0.005
"""The score decreases in proportion if the overlap is smaller than this. Set by hand."""
LEAST_AREA_M2 = 0.0003
"""Pixels that determine a placement must cover this area. Set by hand."""
PLACE_SCALE_M = 0.010
"""Distance in space that counts as half a disagreement. Chosen: half of what is counted as wrong in the
evaluation; noise, bending of the flattened views and an axis that is a few millimetres off stay below it."""
SAME_FACING = 0.8
"""Cloth whose normals or Z-angles have a smaller cosine (37 degrees) is other cloth. Set by hand: several
times the noise of the averaged Z-angles, and less than the two flanks of a fold differ by."""
Z_ANGLE_SCALE_DEG = BENT_DEG
"""Difference in Z-angle that counts as half a disagreement, and half the widest band of a line of equal
Z-angle."""
_ATTRIBUTES = np.dtype(
    [(name, np.float32) for name in ("texture", "height_m", "cos", "sin", "across_m", "further_across_m")]
)
"""What is compared of a pixel: the texture, the height, cos and sin of the Z-angle, the place across the
axis."""


class Disagreement(NamedTuple):
    """How far two views disagree, each (n,) under n motions, from 0 (equal) to 1.

    ``total`` is the weighted mean of ``intensity``, ``height`` and ``z_angle``; ``place`` compares the places
    in space, and is no part of it. ``overlap_share`` is the compared share of the new view, ``height_rms_m``
    the root mean square of the difference in height.
    """

    total: Float64
    overlap_share: Float64
    intensity: Float64
    height: Float64
    height_rms_m: Float64
    z_angle: Float64
    place: Float64


class Matcher:
    """Compares two flattened views at a placement by intensity, height, Z-angle and place.

    The disagreement of each overlapping pixel of the new view is a robust mean of the two
    differences, from 0 (equal) to 1. The coarse part of the search compares smoothed texture, which
    tolerates its larger steps, and so do the agreements that the score does not use.
    """

    def __init__(self, current: FlattenedView, new: FlattenedView, axis: RotationAxis) -> None:
        self._pixel_size_m = new.pixel_size_m
        self._current_pixel_size_m = current.pixel_size_m
        self._origin = np.asarray(current.origin_uv_m)
        rc = np.argwhere(new.valid)
        self._uv = new.uv_from_rc(rc)
        self._fields: dict[float, NDArray[np.void]] = {}
        self._values: dict[float, NDArray[np.void]] = {}
        for smoothing_m in (COARSE_SMOOTHING_M, FINE_SMOOTHING_M):
            texture, new_texture = _texture(current, smoothing_m), _texture(new, smoothing_m)
            spread = max(_spread(texture), _spread(new_texture), _INTENSITY_FLOOR)
            self._fields[smoothing_m] = self._attributes(current, axis, texture / spread)
            self._values[smoothing_m] = self._attributes(new, axis, new_texture / spread)[rc[:, 0], rc[:, 1]]
        self._chance = self._chance_disagreement()

    def _attributes(self, view: FlattenedView, axis: RotationAxis, texture: Float32) -> NDArray[np.void]:
        """Return what is compared of each pixel (H, W), NaN off the cloth."""
        angle = np.radians(mean_z_angle_deg(view, axis, 0.0))
        place = view.xyz_m @ np.stack(horizontal_axes(axis), axis=-1)
        fields = np.empty(view.shape, dtype=_ATTRIBUTES)
        fields["texture"], fields["height_m"] = texture, height_m(view.xyz_m, axis)
        fields["cos"], fields["sin"] = np.cos(angle), np.sin(angle)
        fields["across_m"], fields["further_across_m"] = place[..., 0], place[..., 1]
        fields[~view.valid] = np.nan
        return fields

    def disagreement(
        self,
        motions: list[Rigid2],
        stride: int,
        smoothing_m: float = FINE_SMOOTHING_M,
        z_angle_weight: float = 1.0,
    ) -> Disagreement:
        """Compute the disagreement under each of n motions.

        Parameters
        ----------
        motions : list of Rigid2
            Placements ``current_from_new``.
        stride : int
            Step in pixels between the compared pixels of the new view.
        smoothing_m : float
            ``COARSE_SMOOTHING_M`` or ``FINE_SMOOTHING_M``.
        z_angle_weight : float
            Weight of the Z-angle; intensity and height have 1 each.
        """
        poses = np.array([[m.theta_rad, m.u_m, m.v_m] for m in motions])
        found: Disagreement = _compare(
            self._fields[smoothing_m],
            self._uv[::stride],
            self._values[smoothing_m][::stride],
            poses,
            self._origin,
            self._current_pixel_size_m,
            z_angle_weight,
        )
        return found

    def search(self, initial: Rigid2, progress: Progress = no_progress) -> Rigid2:
        """Search around the initial estimate: a coarse grid, then each of its best placements in detail."""
        center = self._uv.mean(axis=0)
        share = max(float(self.disagreement([initial], 4).overlap_share[0]), LEAST_OVERLAP_SHARE)
        shifts = _symmetric(_SEARCH_TRANSLATION_M, COARSE_SMOOTHING_M)
        turns = np.radians(_symmetric(_SEARCH_ROTATION_DEG, _SEARCH_STEP_DEG))
        offsets = np.array([(t, u, v) for t in turns for u in shifts for v in shifts])
        motions = [_disturbed(initial, offset, center) for offset in offsets]
        cost = self._cost(motions, offsets, SEARCH_POINTS, COARSE_SMOOTHING_M, share)
        starts = _distinct(offsets, cost, _SEARCH_CANDIDATES, (2 + 0.5) * COARSE_SMOOTHING_M)  # over 2 steps
        found = []
        for n, start in enumerate(starts):
            progress(0.3 + 0.6 * n / len(starts), "searching the alignment")
            found.append(self._refine(initial, start, center, share))
        _, best = min(found, key=lambda item: item[0])
        return _disturbed(initial, self._polish(initial, best, center, share), center)

    def refine(self, initial: Rigid2) -> Rigid2:
        """Descend to the nearest minimum from a placement."""
        center = self._uv.mean(axis=0)
        share = max(float(self.disagreement([initial], 4).overlap_share[0]), LEAST_OVERLAP_SHARE)
        _, best = self._refine(initial, np.zeros(3), center, share)
        return _disturbed(initial, self._polish(initial, best, center, share), center)

    def score(self, current_from_new: Rigid2) -> AlignmentScore:
        """Score a placement: 0 is chance or worse, 1 perfect agreement.

        The score is the mean agreement, over the overlap, of the places in the object frame: half for pixels
        10 mm apart, none for cloth that faces another way. It follows the error of the placement, while
        intensity, height and Z-angle also agree at wrong placements, and disagree at right ones under
        noise or where the view is bent otherwise than the shape (``docs/method.md``). They are listed
        with the score; intensity and height relative to randomly paired pixels.
        """
        found = self.disagreement([current_from_new], 1, COARSE_SMOOTHING_M)
        share = float(found.overlap_share[0])
        area = share * len(self._uv) * self._pixel_size_m**2
        by_intensity = max(0.0, 1.0 - float(found.intensity[0]) / max(self._chance[0], 1e-6))
        by_height = max(0.0, 1.0 - float(found.height[0]) / max(self._chance[1], 1e-6))
        by_z_angle = 1.0 - float(found.z_angle[0]) if share > 0 else 0.0
        by_place = 1.0 - float(found.place[0]) if share > 0 else 0.0
        parts = {
            "place_agreement": by_place,
            "intensity_agreement": by_intensity,
            "height_agreement": by_height,
            "z_angle_agreement": by_z_angle,
            "height_rms_mm": float(found.height_rms_m[0]) * 1e3,
            "overlap_cm2": area * 1e4,
            "overlap_share": share,
        }
        total = by_place * min(1.0, area / _ENOUGH_OVERLAP_M2)
        return AlignmentScore(total, parts, finite(parts["height_rms_mm"]))

    def _chance_disagreement(self) -> tuple[float, float]:
        """Mean disagreement of randomly paired pixels, by intensity and by height."""
        current = self._fields[COARSE_SMOOTHING_M]
        current = current[np.isfinite(current["height_m"])]
        random = np.random.default_rng(0)
        b = self._values[COARSE_SMOOTHING_M]
        a = current[random.integers(0, len(current), len(b))]
        intensity = np.square(a["texture"] - b["texture"])
        height = np.square((a["height_m"] - b["height_m"]) / (0.5 * PLACE_SCALE_M))
        return float(np.mean(intensity / (intensity + 1))), float(np.mean(height / (height + 1)))

    def _cost(
        self,
        motions: list[Rigid2],
        offsets: Float64,
        points: int,
        smoothing_m: float,
        expected_share: float,
        z_angle_weight: float = 1.0,
    ) -> Float64:
        """Return the cost that is minimised: disagreement, missing overlap, and a small cost of distance."""
        stride = max(1, len(self._uv) // points)
        result = self.disagreement(motions, stride, smoothing_m, z_angle_weight)
        missing = np.clip(1.0 - result.overlap_share / expected_share, 0.0, 1.0)
        far = np.square(offsets[:, 1:]).sum(axis=1) / _SEARCH_TRANSLATION_M**2
        far += np.square(offsets[:, 0]) / math.radians(_SEARCH_ROTATION_DEG) ** 2
        cost: Float64 = result.total + _MISSING_OVERLAP_COST * missing + _DISTANCE_COST * far
        return cost

    def _refine(
        self, initial: Rigid2, start: Float64, center: Float64, share: float
    ) -> tuple[float, Float64]:
        """Descend by halving steps over the 26 neighbours; return cost and offset (theta, u, v)."""
        return self._descend(initial, start, center, share, _COARSE_STEP / 2)

    def _polish(self, initial: Rigid2, start: Float64, center: Float64, share: float) -> Float64:
        """Descend by the paper's criteria alone, by at most a step of the coarse search; return the offset.

        The Z-angle is averaged over as much, so that it leads to the place but not to the millimetre.
        """
        _, best = self._descend(initial, start, center, share, _COARSE_STEP / 4, z_angle_weight=0.0)
        return best if (np.abs(best - start) <= _COARSE_STEP).all() else start

    def _descend(
        self,
        initial: Rigid2,
        start: Float64,
        center: Float64,
        share: float,
        first_step: Float64,
        z_angle_weight: float = 1.0,
    ) -> tuple[float, Float64]:
        neighbours = np.array([(t, u, v) for t in (-1, 0, 1) for u in (-1, 0, 1) for v in (-1, 0, 1)])
        step, best, lowest = first_step, start, math.inf
        while step[1] > self._pixel_size_m / 4.0:
            fine = step[1] <= FINE_SMOOTHING_M
            smoothing = FINE_SMOOTHING_M if fine else COARSE_SMOOTHING_M
            points = 4 * SEARCH_POINTS if fine else SEARCH_POINTS
            lowest = math.inf
            for _ in range(8):
                offsets = best + neighbours * step
                motions = [_disturbed(initial, offset, center) for offset in offsets]
                cost = self._cost(motions, offsets, points, smoothing, share, z_angle_weight)
                n = int(np.argmin(cost))
                if cost[n] >= lowest:
                    break
                lowest, best = float(cost[n]), offsets[n]
            step = step / 2
        return lowest, best


def _symmetric(extent: float, step: float) -> Float64:
    count = math.floor(extent / step)
    return np.arange(-count, count + 1, dtype=np.float64) * step


def _disturbed(initial: Rigid2, offset: Float64, center: Float64) -> Rigid2:
    """Return the initial placement after turning the view about its own centre and shifting it."""
    return initial @ Rigid2(float(offset[0]), float(offset[1]), float(offset[2])).about(center)


def _distinct(offsets: Float64, cost: Float64, most: int, apart_m: float) -> list[Float64]:
    """Return the best offsets that are not close to a better one."""
    chosen: list[Float64] = []
    for n in np.argsort(cost, kind="stable"):
        if all(np.abs(offsets[n, 1:] - other[1:]).max() > apart_m for other in chosen):
            chosen.append(offsets[n])
            if len(chosen) == most:
                break
    return chosen


def mean_z_angle_deg(view: FlattenedView, axis: RotationAxis, angle_deg: float) -> Float64:
    """Return the Z-angle (H, W, deg) of the mean normal around each pixel; NaN off the cloth.

    Normals waver with the noise of depth: by 5 to 10 degrees with a D435's at 0.85 m, against less than 1
    without noise; the mean within 6 mm by 2 to 3.
    """
    normal = np.where(view.valid[..., None], view.normal, np.float32(0)).astype(np.float32)
    smoothing_px = _Z_ANGLE_SMOOTHING_M / view.pixel_size_m
    normal = np.asarray(cv2.GaussianBlur(normal, (0, 0), smoothing_px), np.float32)
    angle: Float64 = np.where(view.valid, z_angle_deg(normal, axis, angle_deg), np.nan)
    return angle


def _spread(texture: Float32) -> float:
    shown = texture[texture != 0]
    return float(1.4826 * np.median(np.abs(shown))) if shown.size else 0.0


def _texture(view: FlattenedView, smoothing_m: float) -> Float32:
    """Return the intensity (H, W) minus its mean within ``PLACE_SCALE_M``, smoothed; 0 off the cloth."""
    grey = np.asarray(cv2.cvtColor(view.rgb.astype(np.float32), cv2.COLOR_RGB2GRAY), dtype=np.float32)
    weight = view.valid.astype(np.float32)
    fine, coarse = smoothing_m / view.pixel_size_m, PLACE_SCALE_M / view.pixel_size_m

    def mean(sigma: float) -> Float32:
        total = cv2.GaussianBlur(grey * weight, (0, 0), sigma)
        return np.asarray(total / np.maximum(cv2.GaussianBlur(weight, (0, 0), sigma), 1e-6), dtype=np.float32)

    texture: Float32 = np.where(view.valid, mean(fine) - mean(coarse), np.float32(0))
    return texture


@njit(cache=True, nogil=True)
def _compare(
    fields: NDArray[np.void],
    uv: Float64,
    values: NDArray[np.void],
    poses: Float64,
    origin: Float64,
    pixel_size: float,
    z_angle_weight: float,
) -> Disagreement:
    """Compare under each pose (theta, u, v)."""
    rows, cols, count = fields.shape[0], fields.shape[1], len(poses)
    z_angle_scale = math.radians(Z_ANGLE_SCALE_DEG)
    found = Disagreement(
        np.ones(count), np.zeros(count), np.zeros(count), np.zeros(count), np.zeros(count), np.zeros(count),
        np.ones(count),
    )  # fmt: skip
    for p in range(count):
        cos, sin = math.cos(poses[p, 0]), math.sin(poses[p, 0])
        n, intensity, height, z_angle, square, place = 0, 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(uv.shape[0]):
            u = cos * uv[k, 0] - sin * uv[k, 1] + poses[p, 1]
            v = sin * uv[k, 0] + cos * uv[k, 1] + poses[p, 2]
            x, y = (u - origin[0]) / pixel_size, (v - origin[1]) / pixel_size
            c, r = math.floor(x), math.floor(y)
            if r < 0 or c < 0 or r >= rows - 1 or c >= cols - 1:
                continue
            fx, fy = x - c, y - r
            w00, w01, w10, w11 = (1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy
            h = (
                w00 * fields[r, c].height_m
                + w01 * fields[r, c + 1].height_m
                + w10 * fields[r + 1, c].height_m
                + w11 * fields[r + 1, c + 1].height_m
            )
            if not math.isfinite(h):
                continue
            i = (
                w00 * fields[r, c].texture
                + w01 * fields[r, c + 1].texture
                + w10 * fields[r + 1, c].texture
                + w11 * fields[r + 1, c + 1].texture
            )
            # The Z-angle and the place change little over a pixel: the nearest one serves.
            rz, cz = r + (1 if fy > 0.5 else 0), c + (1 if fx > 0.5 else 0)
            di = i - values[k].texture
            dh = h - values[k].height_m
            along = fields[rz, cz].cos * values[k].cos + fields[rz, cz].sin * values[k].sin
            ca = (2.0 - 2.0 * along) / z_angle_scale**2  # the squared chord stands for the squared angle
            ch = (dh / (0.5 * PLACE_SCALE_M)) ** 2
            dx = fields[rz, cz].across_m - values[k].across_m
            dy = fields[rz, cz].further_across_m - values[k].further_across_m
            cp = (dx * dx + dy * dy + dh * dh) / PLACE_SCALE_M**2
            n += 1
            place += cp / (cp + 1.0) if along > SAME_FACING else 1.0
            intensity += di * di / (di * di + 1.0)
            height += ch / (ch + 1.0)
            z_angle += ca / (ca + 1.0)
            square += dh * dh
        if n > 0:
            found.total[p] = (intensity + height + z_angle_weight * z_angle) / ((2.0 + z_angle_weight) * n)
            found.overlap_share[p] = n / uv.shape[0]
            found.intensity[p] = intensity / n
            found.height[p] = height / n
            found.height_rms_m[p] = math.sqrt(square / n)
            found.z_angle[p] = z_angle / n
            found.place[p] = place / n
    return found


# --- the search, watched ---------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Search:
    """The candidates of the search around the initial estimate, as the teaching pages show them.

    ``cost`` (T, U, V) is that of the coarse search at ``turns_rad`` (T,) and ``shifts_m`` (U,), which
    are used for v as well. ``starts`` (K, 3), rotation and shifts, are the candidates of the detailed
    search; ``path`` (P, 3), with the placements ``motions``, leads from the initial estimate through the
    best of them to the end, which scores ``end_score``. ``tried`` is the number of compared placements.
    """

    turns_rad: Float64
    shifts_m: Float64
    cost: Float64
    starts: Float64
    path: Float64
    motions: tuple[Rigid2, ...]
    tried: int
    end_score: float


class WatchedMatcher(Matcher):
    """Searches exactly like its base class, and records the candidates."""

    def search(self, initial: Rigid2, progress: Progress = no_progress) -> Rigid2:
        """Search around the initial estimate, and forget the search before."""
        self._batches: list[tuple[Float64, Float64]] = []
        self._paths: list[tuple[float, list[Float64]]] = []
        self._initial = initial
        return super().search(initial, progress)

    def _cost(self, motions: list[Rigid2], offsets: Float64, *rest: Any, **named: Any) -> Float64:
        cost = super()._cost(motions, offsets, *rest, **named)
        self._batches.append((offsets, cost))
        return cost

    def _refine(
        self, initial: Rigid2, start: Float64, center: Float64, share: float
    ) -> tuple[float, Float64]:
        first = len(self._batches)
        lowest, best = super()._refine(initial, start, center, share)
        steps = [offsets[int(np.argmin(cost))] for offsets, cost in self._batches[first:]]
        self._paths.append((lowest, [np.zeros(3), start, *steps, best]))
        self._center = center
        return lowest, best

    def _polish(self, initial: Rigid2, start: Float64, center: Float64, share: float) -> Float64:
        self._paths.append((-1.0, [start, super()._polish(initial, start, center, share)]))
        return self._paths[-1][1][-1]

    def seen(self) -> Search:
        """Return the candidates of the last search."""
        (offsets, cost), (*paths, (_, polished)) = self._batches[0], self._paths
        turns, shifts = np.unique(offsets[:, 0]), np.unique(offsets[:, 1])
        steps = min(paths, key=lambda item: item[0])[1] + polished
        path = np.array(steps)[[True, *(bool((a != b).any()) for a, b in itertools.pairwise(steps))]]
        motions = [self._initial @ Rigid2(*map(float, p)).about(self._center) for p in path]
        return Search(
            turns_rad=turns,
            shifts_m=shifts,
            cost=cost.reshape(turns.size, shifts.size, shifts.size),
            starts=np.array([steps[1] for _, steps in paths]),
            path=path,
            motions=tuple(motions),
            tried=sum(len(batch) for batch, _ in self._batches),
            end_score=self.score(motions[-1]).total,
        )
