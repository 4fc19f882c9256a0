"""Estimation of the turning axis from the views: the axis about which all views, turned back, agree.

Between two views the item rotates rigidly by a known angle. The four parameters of the axis, position and
direction, therefore explain the motion of the surface between all pairs of views, and all pairs are
registered together: points of one view are rotated to the other, projected into its image, and fitted to
the surface there along its normal (point to plane), with robust weights, from coarse to fine.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.config import SurfaceConfig
from flatcloth.core.errors import SurfaceError
from flatcloth.core.geometry import back_project, rotation_about
from flatcloth.core.types import Bool, Float64, Intrinsics, RgbdFrame, RotationAxis
from flatcloth.flattening.surface import item_mask

VIEWS_USED = 18
_GRID_PIXELS = 45_000
_LEAST_FACING = 0.35
_JUMP_M = 0.04


@dataclass(frozen=True, kw_only=True)
class Glimpse:
    """A view reduced to a grid of blocks (H, W, ...), camera frame, for registration.

    ``xyz_m`` and ``normal`` (towards the camera) are NaN where ``usable`` is False. ``fattening`` is
    the displacement of a point by edge fattening of one pixel, i.e. if a stereo sensor measured each
    place as near as the nearest place within one pixel.
    """

    angle_deg: float
    xyz_m: Float64
    normal: Float64
    fattening: Float64
    usable: Bool
    intrinsics: Intrinsics

    @property
    def points_m(self) -> Float64:
        """The usable points (N, 3)."""
        points: Float64 = self.xyz_m[self.usable]
        return points


def choose_views(angles_deg: Sequence[float], most: int = VIEWS_USED) -> list[int]:
    """Return at most ``most`` views spread evenly over the turn, in order of their angle."""
    turned = np.asarray(angles_deg, dtype=np.float64) % 360.0
    wanted = np.arange(most) * 360.0 / most
    apart = np.abs((turned[None] - wanted[:, None] + 180.0) % 360.0 - 180.0)
    nearest = set(range(len(turned))) if len(turned) <= most else set(apart.argmin(axis=1).tolist())
    return sorted(nearest, key=lambda n: float(turned[n]))


def glimpse(frame: RgbdFrame, config: SurfaceConfig) -> Glimpse | None:
    """Reduce a view; None if it shows no surface of the item."""
    small = thinned(frame)
    try:
        item = item_mask(small, None, config)
    except SurfaceError:
        return None
    xyz = back_project(np.where(item, small.depth_m, 0).astype(np.float32), small.intrinsics).astype(
        np.float64
    )
    normal = _normals(xyz)
    facing = -(normal * xyz).sum(axis=-1)
    distance = np.linalg.norm(xyz, axis=-1)
    k = small.intrinsics
    with np.errstate(invalid="ignore"):
        usable = facing > _LEAST_FACING * distance
        slope_m_px = xyz[..., 2] ** 2 / facing * np.hypot(normal[..., 0] / k.fx, normal[..., 1] / k.fy)
        fattening = xyz * (slope_m_px / xyz[..., 2])[..., None]
    if not usable.any():
        return None
    return Glimpse(
        angle_deg=frame.angle_deg, xyz_m=xyz, normal=normal, fattening=fattening, usable=usable, intrinsics=k
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
    known = (count >= 0.6 * size**2) & (spread < 0.02 * mean)
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


def _normals(xyz: Float64, reach: int = 2) -> Float64:
    """Return normals (H, W, 3) towards the camera, from differences over a few blocks; NaN at jumps."""
    normal = np.full_like(xyz, np.nan)
    inner = slice(reach, -reach)
    across = xyz[inner, 2 * reach :] - xyz[inner, : -2 * reach]
    down = xyz[2 * reach :, inner] - xyz[: -2 * reach, inner]
    with np.errstate(invalid="ignore", divide="ignore"):
        found = np.cross(down, across)
        found /= np.linalg.norm(found, axis=-1, keepdims=True)
        found[(np.abs(across[..., 2]) > _JUMP_M) | (np.abs(down[..., 2]) > _JUMP_M)] = np.nan
    normal[inner, inner] = found
    return normal


UP = np.array([0.0, -1.0, 0.0])
"""Up in the camera frame of a level camera."""

_FEW_POINTS, _MANY_POINTS = 250, 1000
"""Points of each view: for the choice among the starts, and for the final estimate."""
_LARGEST_TURN_DEG = 45.0
_LARGEST_LONE_TURN_DEG = 65.0
_SCALES_M = (0.05, 0.02, 0.01, 0.005)
_STEPS_PER_SCALE = 8
_SETTLED = 1e-4
_LARGEST_SHIFT_M, _LARGEST_TILT = 0.05, 0.1
_USUAL_TILT = 0.17
"""Prior: cameras are level to about 10 degrees; it matters only where the views do not decide."""
_LEAST_COMMON_DIRECTION = 0.7
_MOST_FATTENING_PX = 2.0
_LEAST_AGREEING = 0.2
_MOST_UNCERTAIN_M = 0.005
_LEAST_VERTICAL = 0.7
_FARTHEST_FROM_ITEM_M = 0.15


@dataclass(frozen=True, kw_only=True)
class AxisEstimate:
    """The axis, the share of points that agree with it, and their deviation (RMS)."""

    axis: RotationAxis
    agreeing_share: float
    rms_m: float


def estimate_axis(glimpses: Sequence[Glimpse], starts_m: Sequence[Float64]) -> AxisEstimate | None:
    """Estimate the axis that agrees best with the views.

    Parameters
    ----------
    glimpses : sequence of Glimpse
        In order of their angle.
    starts_m : sequence of (3,) float64
        Points near the axis to start from, camera frame; the initial direction is the vertical of
        a level camera. The start with the best agreement is used.

    Returns
    -------
    AxisEstimate or None
        None if the views do not determine it: too few, too far apart, or without agreement.

    Notes
    -----
    Views up to 45 degrees apart are compared, at first only neighbours: at 10 degrees their
    surfaces move by a sixth of the axis' error, so that a start within 10 cm is near enough. It
    takes about 0.3 s for 18 views.
    """
    pairs = _pairs([g.angle_deg for g in glimpses])
    if not pairs:
        return None
    neighbours = _neighbours(pairs)
    rough = _Problem(glimpses, _FEW_POINTS)
    found = [rough.settled(_State(start, UP), neighbours, _SCALES_M[:2]) for start in starts_m]
    best = max(found, key=lambda state: rough.equations(state, neighbours, _SCALES_M[1]).agreeing_share)
    problem = _Problem(glimpses, _MANY_POINTS)
    for scale in _SCALES_M[1:]:
        best = problem.settled(best, pairs, (scale,), with_fattening=scale == _SCALES_M[-1])
    reached = problem.equations(best, pairs, _SCALES_M[-1])
    sure = reached.agreeing_share >= _LEAST_AGREEING and reached.uncertainty_m <= _MOST_UNCERTAIN_M
    if not sure or not _plausible(best, glimpses):
        return None
    return AxisEstimate(
        axis=RotationAxis(point_m=best.point_m, direction=best.direction, estimated=True),
        agreeing_share=reached.agreeing_share,
        rms_m=reached.rms_m,
    )


def agreement(glimpses: Sequence[Glimpse], axis: RotationAxis) -> AxisEstimate | None:
    """Return how well the views agree with a given axis; None if no two show common surface."""
    pairs = _pairs([g.angle_deg for g in glimpses])
    if not pairs:
        return None
    state = _State(axis.point_m, axis.direction)
    reached = _Problem(glimpses, _MANY_POINTS).equations(state, pairs, _SCALES_M[-1])
    return AxisEstimate(axis=axis, agreeing_share=reached.agreeing_share, rms_m=reached.rms_m)


def _pairs(angles_deg: Sequence[float]) -> list[tuple[int, int, float]]:
    """Return pairs of views with common surface, and the rotation of the second against the first (deg)."""
    turns = [
        (i, j, (angles_deg[j] - angles_deg[i] + 180.0) % 360.0 - 180.0)
        for i in range(len(angles_deg))
        for j in range(i)
    ]
    for largest in (_LARGEST_TURN_DEG, _LARGEST_LONE_TURN_DEG):
        pairs = [pair for pair in turns if 0.5 <= abs(pair[2]) <= largest]
        if len({view for pair in pairs for view in pair[:2]}) == len(angles_deg):
            break
    return pairs


def _neighbours(pairs: list[tuple[int, int, float]]) -> list[tuple[int, int, float]]:
    """Return the closest pairs, up to the distance at which every view has a neighbour."""
    nearest: dict[int, tuple[int, int, float]] = {}
    for pair in sorted(pairs, key=lambda p: abs(p[2])):
        for view in pair[:2]:
            nearest.setdefault(view, pair)
    least = max(abs(pair[2]) for pair in nearest.values())
    return [pair for pair in pairs if abs(pair[2]) <= least]


def _plausible(state: _State, glimpses: Sequence[Glimpse]) -> bool:
    """Return whether the axis is about vertical and passes through or near the item."""
    if state.direction @ UP < _LEAST_VERTICAL:
        return False
    offset = np.concatenate([g.points_m for g in glimpses]) - state.point_m
    across = offset - (offset @ state.direction)[:, None] * state.direction
    return float(np.percentile(np.linalg.norm(across, axis=1), 5)) < _FARTHEST_FROM_ITEM_M


@dataclass(frozen=True)
class _State:
    """An axis, and the edge fattening in pixels."""

    point_m: Float64
    direction: Float64
    fattening_px: float = 0.0


@dataclass(frozen=True, kw_only=True)
class _Equations:
    """Normal equations of a Gauss-Newton step, and the agreement at the present state."""

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


class _Problem:
    """The joint registration of all views about one axis."""

    def __init__(self, glimpses: Sequence[Glimpse], points_per_view: int) -> None:
        self._glimpses = glimpses
        self._sources = []
        for g in glimpses:
            index = np.flatnonzero(g.usable)
            few = index[np.linspace(0, len(index) - 1, min(points_per_view, len(index))).astype(np.intp)]
            self._sources.append([a.reshape(-1, 3)[few] for a in (g.xyz_m, g.normal, g.fattening)])

    def settled(
        self,
        state: _State,
        pairs: Sequence[tuple[int, int, float]],
        scales_m: Sequence[float],
        *,
        with_fattening: bool = False,
    ) -> _State:
        """Return the state after Gauss-Newton steps at each scale of the robust weights."""
        for scale in scales_m:
            for _ in range(_STEPS_PER_SCALE):
                state, size = _stepped(state, self.equations(state, pairs, scale), with_fattening)
                if size < _SETTLED:
                    break
        return state

    def equations(self, state: _State, pairs: Sequence[tuple[int, int, float]], scale_m: float) -> _Equations:
        """Compare all pairs, in both directions."""
        matrix, right = np.zeros((5, 5)), np.zeros(5)
        level = (scale_m / _USUAL_TILT) ** 2
        matrix[2, 2] = matrix[3, 3] = level
        across = _across(state.direction)
        right[2:4] = [level * (UP @ tilt) for tilt in across]
        turns = {
            turn: _turned(state.direction, across, turn)
            for turn in {t * s for *_, t in pairs for s in (1, -1)}
        }
        weight = squares = compared = 0.0
        for i, j, turn in pairs:
            for source, target, turned in ((i, j, turns[turn]), (j, i, turns[-turn])):
                jacobian, residual, seen = self._compare(state, source, target, turned, scale_m)
                w = (scale_m**2 / (scale_m**2 + residual**2)) ** 2  # Geman-McClure
                matrix += (jacobian * w[:, None]).T @ jacobian
                right -= (jacobian * w[:, None]).T @ residual
                weight, squares, compared = (
                    weight + w.sum(),
                    squares + (w * residual**2).sum(),
                    compared + seen,
                )
        return _Equations(
            matrix=matrix,
            right=right,
            agreeing_share=weight / max(compared, 1.0),
            rms_m=math.sqrt(squares / max(weight, 1e-9)),
        )

    def _compare(
        self, state: _State, source: int, target: int, turned: _Turned, scale_m: float
    ) -> tuple[Float64, Float64, int]:
        """Return Jacobian (N, 5), residual (N,), and the number of points that fall on the image."""
        rotation = turned.rotation
        points, normals, fattening = self._sources[source]
        offset = points + state.fattening_px * fattening - state.point_m
        moved = offset @ rotation.T + state.point_m
        there = self._glimpses[target]
        place, seen = _project(moved, there)
        chosen = np.flatnonzero(place >= 0)
        at = place[chosen]
        surface, normal, fat = (a.reshape(-1, 3)[at] for a in (there.xyz_m, there.normal, there.fattening))
        residual = ((moved[chosen] - surface - state.fattening_px * fat) * normal).sum(axis=1)
        alike = ((normals[chosen] @ rotation.T) * normal).sum(axis=1) > _LEAST_COMMON_DIRECTION
        kept = alike & (np.abs(residual) < 3.0 * scale_m)
        chosen, residual, normal = chosen[kept], residual[kept], normal[kept]
        columns = [normal @ turned.by_side, normal @ turned.by_front]
        columns += [((offset[chosen] @ tilted.T) * normal).sum(axis=1) for tilted in turned.by_tilt]
        columns.append(((fattening[chosen] @ rotation.T - fat[kept]) * normal).sum(axis=1))
        return np.stack(columns, axis=1), residual, seen


def _project(points_m: Float64, there: Glimpse) -> tuple[NDArray[np.intp], int]:
    """Return the usable block (N,) of each point, -1 if none, and the number of points in the image."""
    k = there.intrinsics
    depth = np.maximum(points_m[:, 2], 1e-6)
    col = np.rint(k.fx * points_m[:, 0] / depth + k.cx).astype(np.intp)
    row = np.rint(k.fy * points_m[:, 1] / depth + k.cy).astype(np.intp)
    inside = (col >= 0) & (col < k.width) & (row >= 0) & (row < k.height)
    flat = np.where(inside, row * k.width + col, 0)
    return np.where(inside & there.usable.ravel()[flat], flat, -1), int(inside.sum())


def _across(direction: Float64) -> tuple[Float64, Float64]:
    """Return two unit vectors perpendicular to the axis: sideways, and perpendicular to both."""
    side = np.cross(direction, (0.0, 0.0, 1.0))
    side /= np.linalg.norm(side)
    return side, np.cross(direction, side)


@dataclass(frozen=True, kw_only=True)
class _Turned:
    """A rotation about the axis, and the derivatives of a moved point by the axis' position and tilt."""

    rotation: Float64
    by_side: Float64
    by_front: Float64
    by_tilt: tuple[Float64, Float64]


def _turned(
    direction: Float64, across: tuple[Float64, Float64], turn_deg: float, step: float = 1e-4
) -> _Turned:
    angle = math.radians(turn_deg)
    rotation = rotation_about(direction, angle)
    by_place = np.eye(3) - rotation
    tilted = [direction + step * tilt for tilt in across]
    side, front = ((rotation_about(d / np.linalg.norm(d), angle) - rotation) / step for d in tilted)
    return _Turned(
        rotation=rotation, by_side=by_place @ across[0], by_front=by_place @ across[1], by_tilt=(side, front)
    )


def _stepped(state: _State, equations: _Equations, with_fattening: bool) -> tuple[_State, float]:
    """Take a bounded Gauss-Newton step; also return its size."""
    n = 5 if with_fattening else 4
    matrix = (
        equations.matrix[:n, :n] + 1e-9 * np.trace(equations.matrix[:4, :4]) * np.eye(n) + 1e-15 * np.eye(n)
    )
    step = np.zeros(5)
    step[:n] = np.linalg.solve(matrix, equations.right[:n])
    step[:2] = np.clip(step[:2], -_LARGEST_SHIFT_M, _LARGEST_SHIFT_M)
    step[2:4] = np.clip(step[2:4], -_LARGEST_TILT, _LARGEST_TILT)
    side, front = _across(state.direction)
    direction = state.direction + step[2] * side + step[3] * front
    moved = _State(
        state.point_m + step[0] * side + step[1] * front,
        direction / np.linalg.norm(direction),
        float(np.clip(state.fattening_px + step[4], 0.0, _MOST_FATTENING_PX)),
    )
    return moved, float(np.abs(step[:4]).max())
