"""Laying a new flattened view on the current one (paper, section 4.2).

The initial estimate comes from lines of equal Z-angle, the final one from a search around it that
compares intensity and height. Height is measured along the turning axis, so it does not change
while the item turns.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit

from flatcloth.config import AlignmentConfig
from flatcloth.errors import AlignmentError
from flatcloth.geometry import height_m, z_angle_deg
from flatcloth.planning import ColumnCurves, column_curves
from flatcloth.types import FlattenedView, Float32, Float64, Int32, Progress, Rigid2, RotationAxis, no_progress


@dataclass(frozen=True, kw_only=True)
class ZAngleLine:
    """Pixels of one Z-angle in a flattened view and their principal axis.

    ``pixels_uv_m`` (K, 2); ``center_uv_m`` and unit ``direction`` (pointing down the item) of the
    axis; ``point_uv_m`` the point on it at the common height.
    """

    z_angle_deg: float
    pixels_uv_m: Float64
    center_uv_m: Float64
    direction: Float64
    point_uv_m: Float64


@dataclass(frozen=True, kw_only=True)
class Correspondence:
    """The initial estimate and what it came from (paper, Fig. 4d, e).

    ``new_curves`` are h^1(u), A_z^1(u) at the new view's rotation; ``common_range_deg`` the
    Z-angles, before the rotation, seen in both views; ``a_m_deg`` its middle; the two lines and
    the height (m, along the axis) of the pair of points.
    """

    rotation_deg: float
    current_curves: ColumnCurves
    new_curves: ColumnCurves
    common_range_deg: tuple[float, float]
    a_m_deg: float
    current: ZAngleLine
    new: ZAngleLine
    height_m: float


@dataclass(frozen=True)
class AlignmentScore:
    """How well two views agree: ``total`` in 0..1 and its named parts, units in the names."""

    total: float
    parts: dict[str, float]


@dataclass(frozen=True, kw_only=True)
class Alignment:
    """A new view laid on the current one, with the way there."""

    current_from_new: Rigid2
    initial: Rigid2
    score: AlignmentScore
    initial_score: AlignmentScore
    correspondence: Correspondence | None


def align_by_z_angle(
    current: FlattenedView,
    new: FlattenedView,
    axis: RotationAxis,
    angles_deg: tuple[float, float],
    frame_from_current: Rigid2,
    z_angle_limit_deg: float,
    config: AlignmentConfig,
    progress: Progress = no_progress,
) -> Alignment:
    """Align a new flattened view to the current one by the paper's method.

    Parameters
    ----------
    current, new : FlattenedView
        The current canonical view and the view to add, attributes in the held frame.
    axis : RotationAxis
        Axis of the recording.
    angles_deg : (float, float)
        Rotation of the accepted view that the new one continues, and of the new view; their
        difference is the paper's A (signed).
    frame_from_current : Rigid2
        Motion from the current plane to the plane of the accepted view that is continued.
    z_angle_limit_deg : float
        A_w.
    config : AlignmentConfig
        Extent of the search.

    Returns
    -------
    Alignment

    Raises
    ------
    AlignmentError
        If the views have no Z-angle in common.
    """
    correspondence = correspond(current, new, axis, angles_deg, frame_from_current, z_angle_limit_deg, config)
    initial = from_lines(correspondence)
    matcher = Matcher(current, new, axis, config)
    progress(0.2, "searching the alignment")
    found = matcher.search(initial, progress)
    return Alignment(
        current_from_new=found, initial=initial, score=matcher.score(found),
        initial_score=matcher.score(initial), correspondence=correspondence,
    )


def correspond(
    current: FlattenedView, new: FlattenedView, axis: RotationAxis, angles_deg: tuple[float, float],
    frame_from_current: Rigid2, z_angle_limit_deg: float, config: AlignmentConfig,
) -> Correspondence:
    """Find the corresponding lines and points from the Z-angle; see :func:`align_by_z_angle`."""
    before_deg, after_deg = angles_deg
    rotation_deg = after_deg - before_deg
    curves = column_curves(current, axis, before_deg, z_angle_limit_deg, frame_from_current)
    new_curves = column_curves(new, axis, after_deg, z_angle_limit_deg)
    low, high = _common_range(curves, new_curves, rotation_deg)
    a_m = 0.5 * (low + high)
    current_angle = z_angle_deg(current.normal, axis, before_deg)
    new_angle = z_angle_deg(new.normal, axis, before_deg)
    pixels = [
        _pixels_at(angle, view, a_m, config) for angle, view in ((current_angle, current), (new_angle, new))
    ]
    axes = [_principal_axis(view.uv_from_rc(rc), height_m(view.xyz_m[rc[:, 0], rc[:, 1]], axis))
            for view, rc in zip((current, new), pixels, strict=True)]
    heights = [height_m(view.xyz_m[rc[:, 0], rc[:, 1]], axis)
               for view, rc in zip((current, new), pixels, strict=True)]
    height = _common_height(heights[0], heights[1])
    lines = []
    for view, rc, (center, direction), z, value in zip(
        (current, new), pixels, axes, heights, (a_m, a_m + rotation_deg), strict=True
    ):
        uv = view.uv_from_rc(rc)
        lines.append(ZAngleLine(
            z_angle_deg=value, pixels_uv_m=uv, center_uv_m=center, direction=direction,
            point_uv_m=_point_at_height(uv, z, center, direction, height),
        ))
    return Correspondence(
        rotation_deg=rotation_deg, current_curves=curves, new_curves=new_curves,
        common_range_deg=(low, high), a_m_deg=a_m, current=lines[0], new=lines[1], height_m=height,
    )


def from_lines(correspondence: Correspondence) -> Rigid2:
    """Return the motion under which both lines and both points coincide (the initial estimate)."""
    d0, d1 = correspondence.current.direction, correspondence.new.direction
    theta = math.atan2(d1[0] * d0[1] - d1[1] * d0[0], float(d1 @ d0))
    turned = Rigid2(theta).apply(correspondence.new.point_uv_m)
    shift = correspondence.current.point_uv_m - turned
    return Rigid2(theta, float(shift[0]), float(shift[1]))


def _common_range(current: ColumnCurves, new: ColumnCurves, rotation_deg: float) -> tuple[float, float]:
    a0 = current.column_mean_z_angle_deg[current.column_count > 0]
    a1 = new.column_mean_z_angle_deg[new.column_count > 0] - rotation_deg
    if a0.size == 0 or a1.size == 0:
        raise AlignmentError("One of the views shows no cloth within the Z-angle limit; choose another view.")
    low, high = max(a0.min(), a1.min()), min(a0.max(), a1.max())
    if low >= high:
        raise AlignmentError(
            "The views have no Z-angle in common, so nothing can be matched; choose a smaller rotation."
        )
    return float(low), float(high)


def _pixels_at(angle: Float64, view: FlattenedView, a_m: float, config: AlignmentConfig) -> Int32:
    """Pixels (K, 2) whose Z-angle is a_m, within the narrowest band that holds enough of them."""
    with np.errstate(invalid="ignore"):
        off = np.abs((angle - a_m + 180.0) % 360.0 - 180.0)
    off = np.where(view.valid, off, np.inf)
    for band in config.line_bands_deg:
        found = np.argwhere(off <= band).astype(np.int32)
        if len(found) * view.pixel_size_m**2 >= config.line_min_area_m2:
            return found
    raise AlignmentError(
        f"Too few pixels have the common Z-angle of {a_m:.0f} deg to draw a line; choose another view."
    )


def _principal_axis(uv: Float64, height: Float64) -> tuple[Float64, Float64]:
    center = uv.mean(axis=0)
    _, _, axes = np.linalg.svd(uv - center, full_matrices=False)
    direction: Float64 = axes[0]
    along = (uv - center) @ direction
    if float(along @ (height - height.mean())) > 0:  # point down the item: height falls along it
        direction = -direction
    return center, direction


def _common_height(current: Float64, new: Float64) -> float:
    low = max(np.percentile(current, 2), np.percentile(new, 2))
    high = min(np.percentile(current, 98), np.percentile(new, 98))
    if low > high:
        raise AlignmentError("The corresponding lines share no height; choose another view.")
    return float(0.5 * (low + high))


def _point_at_height(
    uv: Float64, z: Float64, center: Float64, direction: Float64, height: float
) -> Float64:
    """Point on the line where the pixels around it have the height; nearest 10 mm first."""
    along = (uv - center) @ direction
    off = np.abs(z - height)
    near = off <= max(0.010, float(np.partition(off, min(5, off.size - 1))[min(5, off.size - 1)]))
    point: Float64 = center + float(np.median(along[near])) * direction
    return point


class Matcher:
    """Compares two flattened views, laid on each other, by intensity and height.

    Each overlapping pixel of the new view disagrees by a robust mean of the two differences,
    0 (equal) to 1; the score is the mean agreement, lowered where the overlap is small. The coarse
    part of the search compares smoothed texture, which tolerates its larger steps.
    """

    def __init__(
        self, current: FlattenedView, new: FlattenedView, axis: RotationAxis, config: AlignmentConfig
    ) -> None:
        self.config = config
        self._pixel_size_m = new.pixel_size_m
        self._current_pixel_size_m = current.pixel_size_m
        self._origin = np.asarray(current.origin_uv_m)
        rc = np.argwhere(new.valid)
        self._uv = new.uv_from_rc(rc)
        self._fields: dict[float, Float32] = {}
        self._values: dict[float, Float32] = {}
        for smoothing_m in (config.coarse_smoothing_m, config.fine_smoothing_m):
            texture, new_texture = _texture(current, smoothing_m), _texture(new, smoothing_m)
            spread = max(_spread(texture), _spread(new_texture), config.intensity_floor)
            self._fields[smoothing_m] = attribute_fields(current, axis, texture / spread)
            fields = attribute_fields(new, axis, new_texture / spread)
            self._values[smoothing_m] = fields[rc[:, 0], rc[:, 1]]

    def disagreement(self, motions: list[Rigid2], stride: int, smoothing_m: float | None = None) -> Float64:
        """Compare under each motion.

        Parameters
        ----------
        motions : list of Rigid2
            Placements ``current_from_new``.
        stride : int
            Every how many pixels of the new view are compared.
        smoothing_m : float, optional
            Coarse or fine texture; by default fine.

        Returns
        -------
        (n, 5) float64
            Mean disagreement, overlap share, its intensity and height parts, rms of height (m).
        """
        which = self.config.fine_smoothing_m if smoothing_m is None else smoothing_m
        poses = np.array([[m.theta_rad, m.u_m, m.v_m] for m in motions])
        return _compare(self._fields[which], self._uv[::stride], self._values[which][::stride], poses,
                        self._origin, self._current_pixel_size_m, self.config.height_scale_m,
                        self.config.intensity_weight)

    def search(self, initial: Rigid2, progress: Progress = no_progress) -> Rigid2:
        """Search around the initial estimate: a coarse grid, then its best places each in detail."""
        c = self.config
        center = self._uv.mean(axis=0)
        share = max(float(self.disagreement([initial], 4)[0, 1]), c.min_overlap_share)
        shifts = _symmetric(c.search_translation_m, c.search_step_m)
        turns = np.radians(_symmetric(c.search_rotation_deg, c.search_step_deg))
        offsets = np.array([(t, u, v) for t in turns for u in shifts for v in shifts])
        motions = [_disturbed(initial, offset, center) for offset in offsets]
        cost = self._cost(motions, offsets, c.search_points, c.coarse_smoothing_m, share)
        starts = _distinct(offsets, cost, c.search_candidates, 2.5 * c.search_step_m)
        found = []
        for n, start in enumerate(starts):
            progress(0.3 + 0.6 * n / len(starts), "searching the alignment")
            found.append(self._refine(initial, start, center, share))
        _, best = min(found, key=lambda item: item[0])
        return _disturbed(initial, best, center)

    def score(self, current_from_new: Rigid2) -> AlignmentScore:
        """Return the score of a placement with its parts."""
        result = self.disagreement([current_from_new], 1)[0]
        area = float(result[1]) * len(self._uv) * self._pixel_size_m**2
        enough = min(1.0, area / self.config.enough_overlap_m2)
        total = float((1.0 - result[0]) * enough) if result[1] > 0 else 0.0
        return AlignmentScore(total, {
            "intensity_agreement": 1.0 - float(result[2]),
            "height_agreement": 1.0 - float(result[3]),
            "height_rms_mm": float(result[4]) * 1e3,
            "overlap_cm2": area * 1e4,
            "overlap_share": float(result[1]),
        })

    def _cost(
        self, motions: list[Rigid2], offsets: Float64, points: int, smoothing_m: float, expected_share: float
    ) -> Float64:
        """What is minimised: disagreement, missing overlap, and a little for going far."""
        c = self.config
        result = self.disagreement(motions, max(1, len(self._uv) // points), smoothing_m)
        missing = np.clip(1.0 - result[:, 1] / expected_share, 0.0, 1.0)
        far = np.square(offsets[:, 1:]).sum(axis=1) / c.search_translation_m**2
        far += np.square(offsets[:, 0]) / math.radians(c.search_rotation_deg) ** 2
        cost: Float64 = result[:, 0] + c.missing_overlap_cost * missing + c.distance_cost * far
        return cost

    def _refine(
        self, initial: Rigid2, start: Float64, center: Float64, share: float
    ) -> tuple[float, Float64]:
        """Descend by halving steps over the 26 neighbours; return cost and offset (theta, u, v)."""
        c = self.config
        neighbours = np.array([(t, u, v) for t in (-1, 0, 1) for u in (-1, 0, 1) for v in (-1, 0, 1)])
        step = np.array([math.radians(c.search_step_deg), c.search_step_m, c.search_step_m]) / 2
        best, lowest = start, math.inf
        while step[1] > c.search_finest_m:
            fine = step[1] <= c.fine_smoothing_m
            smoothing = c.fine_smoothing_m if fine else c.coarse_smoothing_m
            points = 4 * c.search_points if fine else c.search_points
            lowest = math.inf
            for _ in range(8):
                offsets = best + neighbours * step
                motions = [_disturbed(initial, offset, center) for offset in offsets]
                cost = self._cost(motions, offsets, points, smoothing, share)
                n = int(np.argmin(cost))
                if cost[n] >= lowest:
                    break
                lowest, best = float(cost[n]), offsets[n]
            step = step / 2
        return lowest, best


def _symmetric(extent: float, step: float) -> Float64:
    count = math.floor(extent / step)
    return np.arange(-count, count + 1) * step


def _disturbed(initial: Rigid2, offset: Float64, center: Float64) -> Rigid2:
    """Return the initial placement, its view turned about its own centre and shifted first."""
    return initial @ Rigid2(float(offset[0]), float(offset[1]), float(offset[2])).about(center)


def _distinct(offsets: Float64, cost: Float64, most: int, apart_m: float) -> list[Float64]:
    """Return the best offsets that are not neighbours of a better one."""
    chosen: list[Float64] = []
    for n in np.argsort(cost, kind="stable"):
        if all(np.abs(offsets[n, 1:] - other[1:]).max() > apart_m for other in chosen):
            chosen.append(offsets[n])
            if len(chosen) == most:
                break
    return chosen


def attribute_fields(view: FlattenedView, axis: RotationAxis, texture: Float32) -> Float32:
    """Return (H, W, 2): the given texture, and the height (m); NaN off the cloth."""
    fields = np.stack([texture, height_m(view.xyz_m, axis).astype(np.float32)], axis=-1)
    fields[~view.valid] = np.nan
    return np.ascontiguousarray(fields, dtype=np.float32)


def _spread(texture: Float32) -> float:
    shown = texture[texture != 0]
    return float(1.4826 * np.median(np.abs(shown))) if shown.size else 0.0


def _texture(view: FlattenedView, smoothing_m: float) -> Float32:
    """Intensity (H, W) less its mean within 20 mm (shading turns with the item), smoothed; 0 off the cloth."""
    grey = (view.rgb @ np.array([0.299, 0.587, 0.114])).astype(np.float32)
    weight = view.valid.astype(np.float32)
    fine, coarse = smoothing_m / view.pixel_size_m, 0.010 / view.pixel_size_m

    def mean(sigma: float) -> Float32:
        total = cv2.GaussianBlur(grey * weight, (0, 0), sigma)
        return np.asarray(total / np.maximum(cv2.GaussianBlur(weight, (0, 0), sigma), 1e-3), dtype=np.float32)

    texture: Float32 = np.where(view.valid, mean(fine) - mean(coarse), np.float32(0))
    return texture


@njit(cache=True, nogil=True)
def _compare(
    fields: Float32, uv: Float64, values: Float32, poses: Float64, origin: Float64,
    pixel_size: float, height_scale: float, intensity_weight: float,
) -> Float64:
    """Compare under each pose (theta, u, v): disagreement, overlap share, its parts, height rms."""
    rows, cols = fields.shape[0], fields.shape[1]
    result = np.zeros((poses.shape[0], 5))
    for p in range(poses.shape[0]):
        cos, sin = math.cos(poses[p, 0]), math.sin(poses[p, 0])
        n, total, intensity, height, square = 0, 0.0, 0.0, 0.0, 0.0
        for k in range(uv.shape[0]):
            u = cos * uv[k, 0] - sin * uv[k, 1] + poses[p, 1]
            v = sin * uv[k, 0] + cos * uv[k, 1] + poses[p, 2]
            x, y = (u - origin[0]) / pixel_size, (v - origin[1]) / pixel_size
            c, r = int(math.floor(x)), int(math.floor(y))
            if r < 0 or c < 0 or r >= rows - 1 or c >= cols - 1:
                continue
            fx, fy = x - c, y - r
            w00, w01, w10, w11 = (1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy
            h = (w00 * fields[r, c, 1] + w01 * fields[r, c + 1, 1]
                 + w10 * fields[r + 1, c, 1] + w11 * fields[r + 1, c + 1, 1])
            if not math.isfinite(h):
                continue
            i = (w00 * fields[r, c, 0] + w01 * fields[r, c + 1, 0]
                 + w10 * fields[r + 1, c, 0] + w11 * fields[r + 1, c + 1, 0])
            di = i - values[k, 0]
            dh = h - values[k, 1]
            ci = di * di / (di * di + 1.0)
            ch = (dh / height_scale) ** 2
            ch = ch / (ch + 1.0)
            n += 1
            intensity += ci
            height += ch
            total += intensity_weight * ci + (1 - intensity_weight) * ch
            square += dh * dh
        if n > 0:
            result[p, 0] = total / n
            result[p, 1] = n / uv.shape[0]
            result[p, 2] = intensity / n
            result[p, 3] = height / n
            result[p, 4] = math.sqrt(square / n)
        else:
            result[p, 0] = 1.0
    return result
