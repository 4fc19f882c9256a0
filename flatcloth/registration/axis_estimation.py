"""Estimation of the turning axis from the views: the axis about which all views, turned back, agree.

Between two views the item rotates rigidly by a known angle. The four parameters of the axis, position and
direction, therefore explain the motion of the surface between all pairs of views, and all pairs are
registered together: each pair gives the normal equations of the motion between its views
(:func:`flatcloth.registration.view_features.compare`), and the derivative of that motion by the axis
(:func:`flatcloth.registration.pose_prior.jacobians_of`) contracts them to those of the axis. Gauss-Newton
steps solve their sum, with robust weights from coarse to fine.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.config import SurfaceConfig
from flatcloth.core.errors import SurfaceError
from flatcloth.core.geometry import back_project, object_from_camera, wrapped_deg
from flatcloth.core.types import Bool, Float32, Float64, Intrinsics, RgbdFrame, RotationAxis
from flatcloth.flattening.minimisation import ITERATIONS
from flatcloth.flattening.surface import EXTENT_M, item_mask
from flatcloth.registration.pose_prior import (
    OWN,
    PosePrior,
    across,
    at_center,
    jacobians_of,
    moved_axis,
)
from flatcloth.registration.view_features import (
    CHANNELS,
    MOST_APART_DEG,
    POINTS_PER_VIEW,
    TERMS,
    ComparedImages,
    Gates,
    ViewFeatures,
    compare,
    grid_points,
)

VIEWS_USED = 18
"""Views that are compared. Chosen: 20 degrees apart, neighbours share most of their surface; more cost
time."""
_GRID_PIXELS = 45_000
"""Resolution of a thinned view. Chosen: averaging lowers the noise; coarser loses folds, finer costs time."""


def choose_views(angles_deg: Sequence[float], most: int = VIEWS_USED) -> list[int]:
    """Return at most ``most`` views spread evenly over the turn, in order of their angle."""
    turned = np.asarray(angles_deg, dtype=np.float64) % 360.0
    wanted = np.arange(most) * 360.0 / most
    apart = np.abs(wrapped_deg(turned[None] - wanted[:, None]))
    nearest = set(range(len(turned))) if len(turned) <= most else set(apart.argmin(axis=1).tolist())
    return sorted(nearest, key=lambda n: float(turned[n]))


def coarse_features(frame: RgbdFrame, config: SurfaceConfig) -> ViewFeatures | None:
    """Return the features of a thinned view, without texture; None if it shows no surface of the item."""
    small = thinned(frame)
    try:
        item = item_mask(small, None, config)
    except SurfaceError:
        return None
    return depth_features(small, item)


def depth_features(frame: RgbdFrame, item: Bool, points: int = POINTS_PER_VIEW) -> ViewFeatures | None:
    """Return the features of the pixels ``item`` (H, W) of a thinned view; None if they show no surface."""
    k = frame.intrinsics
    xyz = back_project(np.where(item, frame.depth_m, 0).astype(np.float32), k)
    normals = _normals(xyz)
    with np.errstate(invalid="ignore"):
        usable = -(normals * xyz).sum(axis=-1) > Gates().least_facing_cos * np.linalg.norm(xyz, axis=-1)
    if not usable.any():
        return None
    pixel = grid_points(usable, points)
    at = pixel[:, 0], pixel[:, 1]
    images = ComparedImages(np.zeros((CHANNELS, 1, 1), dtype=np.float32), normals)
    return ViewFeatures(
        view_index=frame.view_index,
        angle_deg=frame.angle_deg,
        intrinsics=k,
        noise_m=0.0,
        pixel_pitch_m=float(np.median(xyz[..., 2][usable])) / math.sqrt(k.fx * k.fy),
        points_m=xyz[at].astype(np.float64),
        pixel=pixel,
        depth_m=xyz[..., 2].copy(),
        usable=usable,
        inner=np.zeros(usable.shape, dtype=np.bool_),
        make_images=lambda: images,
    )


def thinned(frame: RgbdFrame, blocks: int = _GRID_PIXELS) -> RgbdFrame:
    """Return the frame averaged over blocks of pixels, with about ``blocks`` blocks, without color.

    A block that contains a depth jump or too little measured depth is 0.
    """
    height, width = frame.depth_m.shape
    size = max(1, round(math.sqrt(height * width / blocks)))
    rows, cols = height // size, width // size
    depth = frame.depth_m[: rows * size, : cols * size]
    used = depth > 0 if frame.mask is None else (depth > 0) & frame.mask[: rows * size, : cols * size]
    inverse = np.zeros(depth.shape, dtype=np.float32)  # affine on a plane
    np.divide(np.float32(1.0), depth, out=inverse, where=used)

    def block_sums(values: NDArray[Any]) -> Float64:
        total = np.zeros((rows, cols))
        for row in range(size):
            for col in range(size):
                total += values[row::size, col::size]
        return total

    count = block_sums(used)
    mean = block_sums(inverse) / np.maximum(count, 1.0)
    spread = np.sqrt(np.maximum(block_sums(inverse**2) / np.maximum(count, 1.0) - mean**2, 0.0))
    known = (count >= 0.5 * size**2) & (spread < 0.02 * mean)
    k = frame.intrinsics
    intrinsics = Intrinsics(
        width=cols, height=rows, fx=k.fx / size, fy=k.fy / size,
        cx=(k.cx - (size - 1) / 2) / size, cy=(k.cy - (size - 1) / 2) / size,
    )  # fmt: skip
    return RgbdFrame(
        view_index=frame.view_index,
        angle_deg=frame.angle_deg,
        color=np.zeros((rows, cols, 3), dtype=np.uint8),
        depth_m=np.where(known, 1.0 / np.where(known, mean, 1.0), 0.0).astype(np.float32),
        mask=None if frame.mask is None else known,
        intrinsics=intrinsics,
    )


def _normals(xyz: Float32, step: int = 2) -> Float32:
    """Return normals (H, W, 3) towards the camera, from differences over a few blocks; NaN at the rim."""
    normal = np.full_like(xyz, np.nan)
    inner = slice(step, -step)
    right = xyz[inner, 2 * step :] - xyz[inner, : -2 * step]
    down = xyz[2 * step :, inner] - xyz[: -2 * step, inner]
    with np.errstate(invalid="ignore", divide="ignore"):
        found = np.cross(down, right)
        found /= np.linalg.norm(found, axis=-1, keepdims=True)
    normal[inner, inner] = found
    return normal


UP = np.array([0.0, -1.0, 0.0])
"""Up in the camera frame of a level camera. By definition."""

_SCALES_M = (0.05, 0.02, 0.01, 0.005)
"""Scales of the robust weights, coarse to fine. Chosen: from the error of a start to a few times the noise of
a D435."""
_USUAL_TILT = 0.17
"""Prior: cameras are level to about 10 degrees; it matters only where the views do not decide. Set by
hand."""
_GATES = Gates(same_normal_cos=0.7, least_facing_cos=-2.0, full_facing_cos=-1.0)
"""Points correspond up to 45 degrees between their normals, because a start is centimetres off. All have the
same weight at any incidence: with the registration's weights the axes of the noisy recordings are off
by 2.92 mm on average instead of 2.43 mm (docs/tried.md)."""
_LEAST_AGREEING = 0.2
"""Share of points that must agree. Chosen; tests/registration has views that agree with no axis."""


def estimate_axis(
    views: Sequence[ViewFeatures], starts_m: Sequence[Float64]
) -> tuple[RotationAxis, float] | None:
    """Estimate the axis that agrees best with the views.

    Parameters
    ----------
    views : sequence of ViewFeatures
        From :func:`coarse_features`, in order of their angle.
    starts_m : sequence of (3,) float64
        Points near the axis to start from, camera frame; the initial direction is the vertical of
        a level camera. The start with the best agreement is used.

    Returns
    -------
    (RotationAxis, float) or None
        The axis, and the deviation (RMS, m) of the points that agree with it. None if the views do not
        determine it: too few, too far apart, or without agreement.

    Notes
    -----
    Views up to 65 degrees apart are compared, at first only neighbours: at 10 degrees their surfaces move by
    a sixth of the axis' error, so that a start within 10 cm is near enough. It takes 0.3 s for 18 views.
    """
    pairs = _pairs([view.angle_deg for view in views])
    if not pairs:
        return None
    neighbours = _neighbours(pairs)
    starts = [_State(RotationAxis(point_m=point_m, direction=UP)) for point_m in starts_m]
    found = [_settled(views, start, neighbours, _SCALES_M[:2], every=2) for start in starts]
    best = max(
        found, key=lambda state: _equations(views, state, neighbours, _SCALES_M[1], every=2).agreeing_share
    )
    for scale in _SCALES_M[1:]:
        best = _settled(views, best, pairs, (scale,), with_fattening=scale == _SCALES_M[-1])
    final = _equations(views, best, pairs, _SCALES_M[-1])
    determined = final.agreeing_share >= _LEAST_AGREEING and final.uncertainty_m <= _SCALES_M[-1]
    if not determined or not _plausible(best.axis, views):
        return None
    return replace(best.axis, estimated=True), final.rms_m


def _pairs(angles_deg: Sequence[float]) -> list[tuple[int, int]]:
    """Return the pairs of views with common surface, the closest first."""
    apart = np.abs(wrapped_deg(np.subtract.outer(angles_deg, angles_deg)))
    i, j = np.nonzero(np.tril((apart >= 0.5) & (apart <= MOST_APART_DEG), -1))
    order = np.argsort(apart[i, j], kind="stable")
    return [*zip(i[order].tolist(), j[order].tolist(), strict=True)]


def _neighbours(pairs: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Return the closest pairs, until every view has a neighbour."""
    first = [next(n for n, pair in enumerate(pairs) if view in pair) for view in {*itertools.chain(*pairs)}]
    return pairs[: max(first) + 1]


def _plausible(axis: RotationAxis, views: Sequence[ViewFeatures]) -> bool:
    """Return whether the axis is about vertical and passes the item within a quarter of a garment."""
    if np.linalg.norm(axis.direction - UP) > 4.0 * _USUAL_TILT:
        return False
    offset = np.concatenate([view.all_points_m for view in views]) - axis.point_m
    across = offset - (offset @ axis.direction)[:, None] * axis.direction
    return float(np.percentile(np.linalg.norm(across, axis=1), 5)) < 0.5 * EXTENT_M


@dataclass(frozen=True)
class _State:
    """An axis, and the edge fattening in pixels."""

    axis: RotationAxis
    fattening_px: float = 0.0


@dataclass(frozen=True, kw_only=True)
class _Equations:
    """Normal equations of a Gauss-Newton step, and the agreement at the present state.

    The unknowns are those of :func:`.pose_prior.moved_axis`: shift (2) and tilt (2) of the axis, and
    the fattening.
    """

    matrix: Float64
    right: Float64
    agreeing_share: float
    rms_m: float

    @property
    def uncertainty_m(self) -> float:
        """Standard deviation of the position if the errors of points were independent."""
        scale = np.trace(self.matrix[:4, :4])
        if scale <= 0:
            return math.inf
        variance = np.diag(np.linalg.inv(self.matrix[:4, :4] + 1e-12 * scale * np.eye(4)))
        return self.rms_m * math.sqrt(float(variance[:2].max()))


def _settled(
    views: Sequence[ViewFeatures],
    state: _State,
    pairs: list[tuple[int, int]],
    scales_m: Sequence[float],
    *,
    every: int = 1,
    with_fattening: bool = False,
) -> _State:
    """Return the state after Gauss-Newton steps at each scale of the robust weights."""
    for scale in scales_m:
        for _ in range(ITERATIONS):
            state, size = _stepped(state, _equations(views, state, pairs, scale, every), with_fattening)
            if size < PosePrior().axis_stds_m[0]:
                break
    return state


def _equations(
    views: Sequence[ViewFeatures], state: _State, pairs: list[tuple[int, int]], scale_m: float, every: int = 1
) -> _Equations:
    """Compare all pairs; the weights are Geman and McClure's, a quarter at a distance of ``scale_m``."""
    axis, center_m = state.axis, state.axis.point_m
    spread = np.eye(TERMS)[0] * scale_m / 3.0  # compare's weight is a quarter at three times its spread
    poses = [object_from_camera(axis, view.angle_deg) for view in views]
    by_axis = at_center(jacobians_of(axis, center_m, [v.angle_deg for v in views]), center_m)[..., OWN:]
    matrix, right, tally = np.zeros((5, 5)), np.zeros(5), np.zeros(3)
    level = (scale_m / _USUAL_TILT) ** 2
    matrix[2, 2] = matrix[3, 3] = level
    right[2:4] = [level * (UP @ way) for way in across(axis)]
    contraction = np.outer(np.eye(7)[6], np.eye(5)[4])
    for i, j in pairs:
        found = compare(
            views[i], views[j], poses[i], poses[j], center_m, state.fattening_px,
            3.0 * scale_m, spread, every, _GATES,
        )  # fmt: skip
        contraction[:6, :4] = by_axis[i] - by_axis[j]
        matrix += contraction.T @ found.matrix[0] @ contraction
        right -= contraction.T @ found.gradient[0]
        tally += found.tally
    in_image, weight, squares = tally
    return _Equations(
        matrix=matrix,
        right=right,
        agreeing_share=weight / max(in_image, 1.0),
        rms_m=math.sqrt(squares / max(weight, 1e-9)),
    )


def _stepped(state: _State, equations: _Equations, with_fattening: bool) -> tuple[_State, float]:
    """Take a bounded Gauss-Newton step; also return its size."""
    n = 5 if with_fattening else 4
    ridge = 1e-9 * np.trace(equations.matrix[:4, :4]) + 1e-15
    step = np.zeros(5)
    step[:n] = np.linalg.solve(equations.matrix[:n, :n] + ridge * np.eye(n), equations.right[:n])
    most_m = _SCALES_M[0]  # a larger step would leave the range of the correspondences
    step[:2] = np.clip(step[:2], -most_m, most_m)
    step[2:4] = np.clip(step[2:4], -most_m / EXTENT_M, most_m / EXTENT_M)
    fattening_px = max(0.0, state.fattening_px + float(step[4]))
    return _State(moved_axis(state.axis, step), fattening_px), float(np.abs(step[:4]).max())
