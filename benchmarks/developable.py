"""Developable sheets with exact flat coordinates, seen by an ideal depth camera.

A sheet is a general cylinder, whose directrix has a given tangent angle along its arc length (flat
coordinates: arc length and height), or a circular cone (flat coordinates: polar, unrolled). Rays
meet it in closed form or by a root along the directrix, so depth and truth are exact to rounding.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.ndimage import gaussian_filter

from flatcloth.core.types import Bool, Float32, Float64, Intrinsics, RgbdFrame, RotationAxis

CAMERA = Intrinsics(width=480, height=848, fx=425.0, fy=425.0, cx=239.5, cy=423.5)
DISTANCE_M = 0.85
AXIS = RotationAxis(point_m=np.array([0.0, -0.3, DISTANCE_M]), direction=np.array([0.0, -1.0, 0.0]))
NOISE_M = 0.0015
SMOOTH_NOISE_PX, ROUGH_NOISE_PX = 5.6, 1.3
"""Smoothing of white noise: correlated 0.97 over 2 px and 0.6 over 8 px; or 0.86 over 1 px and
0.55 over 2 px, which is nearer to what the bundled ``-d435`` recordings have."""

Outline = Callable[[Float64, Float64], Bool]
Hits = tuple[Float64, Float64, Float64, Bool]
"""Depth along the ray (N,), flat u and v (N,), and whether the outer face is seen."""


@dataclass(frozen=True, kw_only=True)
class Sheet:
    """A developable sheet: how rays meet it, and where it lies.

    ``cast(origin, directions, outline)`` returns the nearest :data:`Hits` in the sheet's own frame
    (x right, y down, z away); ``turn_deg`` turns it about x, y, z, in this order; ``flat_outline``
    tells which flat coordinates, in metres, belong to the sheet.
    """

    name: str
    cast: Callable[[Float64, Float64, Outline], Hits]
    flat_outline: Outline
    turn_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class SheetView:
    """One view of a sheet.

    ``exact_depth_m`` (H, W) is the frame's depth without noise; ``flat_uv_m`` (H, W, 2) float64 the
    flat coordinates, NaN off the outer face.
    """

    sheet: Sheet
    frame: RgbdFrame
    exact_depth_m: Float64
    flat_uv_m: Float64


def sheets() -> dict[str, Sheet]:
    """Return the sheets of the benchmark by name."""
    half_wide, half_high = 0.26, 0.24
    rectangle = _box(-half_wide, half_wide, -half_high, half_high)
    s_curve = cylinder(lambda s: 0.9 * np.cos(np.pi * s / half_wide), half_wide)
    every = [
        Sheet(
            name="varying cylinder",
            cast=cylinder(_angle_of_varying_cylinder, half_wide),
            flat_outline=rectangle,
            turn_deg=(0.0, 0.0, 20.0),
        ),
        Sheet(name="S-curve", cast=s_curve, flat_outline=rectangle),
        Sheet(name="cone", cast=cone(math.radians(20.0)), flat_outline=_sector(0.25, 0.72, 0.42)),
        Sheet(
            name="deep folds",
            cast=cylinder(lambda s: 1.2 * np.cos(2 * np.pi * s / 0.2), 0.4),
            flat_outline=_box(-0.4, 0.4, -half_high, half_high),
            turn_deg=(0.0, 12.0, 8.0),
        ),
        Sheet(
            name="pleat",
            cast=cylinder(_angle_of_pleat, half_wide),
            flat_outline=rectangle,
            turn_deg=(0.0, 0.0, -10.0),
        ),
        Sheet(
            name="L shape",
            cast=s_curve,
            flat_outline=_either(_box(-0.26, -0.16, -0.35, 0.25), _box(-0.26, 0.26, 0.15, 0.25)),
            turn_deg=(0.0, 0.0, 15.0),
        ),
        Sheet(
            name="T shape",
            cast=s_curve,
            flat_outline=_either(_box(-0.06, 0.06, -0.25, 0.35), _box(-0.26, 0.26, -0.25, -0.13)),
            turn_deg=(0.0, 0.0, -15.0),
        ),
    ]
    return {sheet.name: sheet for sheet in every}


def view_of(
    sheet: Sheet,
    *,
    noise_seed: int | None = None,
    noise_smoothing_px: float = SMOOTH_NOISE_PX,
    camera: Intrinsics = CAMERA,
) -> SheetView:
    """See a sheet with the camera in front of it.

    Parameters
    ----------
    sheet : Sheet
        One of :func:`sheets`.
    noise_seed : int, optional
        Adds correlated depth noise of 1.5 mm; without it depth is exact.
    noise_smoothing_px : float
        See :func:`depth_noise_m`.
    camera : Intrinsics
        The camera, ``DISTANCE_M`` in front of the sheet's origin.

    Returns
    -------
    SheetView
        Its mask is the outer face, as a recording's is.
    """
    sheet_from_camera = _rotation(sheet.turn_deg).T
    origin = sheet_from_camera @ np.array([0.0, 0.0, -DISTANCE_M])
    row, col = np.mgrid[0 : camera.height, 0 : camera.width]
    rays = np.stack(
        [
            (col.ravel() - camera.cx) / camera.fx,
            (row.ravel() - camera.cy) / camera.fy,
            np.ones(row.size),
        ],
        axis=1,
    )
    depth, u, v, outer = sheet.cast(origin, rays @ sheet_from_camera.T, sheet.flat_outline)
    shape = row.shape
    seen = np.isfinite(depth).reshape(shape)
    mask = seen & outer.reshape(shape)
    flat = np.where(mask[..., None], np.stack([u, v], axis=1).reshape(*shape, 2), np.nan)
    exact_depth_m = depth_m = np.where(seen, depth.reshape(shape), 0.0)
    if noise_seed is not None:
        depth_m = np.where(seen, exact_depth_m + depth_noise_m(shape, noise_seed, noise_smoothing_px), 0.0)
    squares = np.floor(u.reshape(shape) / 0.025) + np.floor(v.reshape(shape) / 0.025)
    gray = np.where(seen, np.where(squares % 2 == 0, 210, 60), 0).astype(np.uint8)
    frame = RgbdFrame(
        view_index=0,
        angle_deg=0.0,
        color=np.repeat(gray[..., None], 3, axis=2),
        depth_m=depth_m.astype(np.float32),
        mask=mask,
        intrinsics=camera,
    )
    return SheetView(sheet=sheet, frame=frame, exact_depth_m=exact_depth_m, flat_uv_m=flat)


def depth_noise_m(shape: tuple[int, int], seed: int, smoothing_px: float = SMOOTH_NOISE_PX) -> Float32:
    """Return white noise (H, W) smoothed by a Gaussian, of the standard deviation ``NOISE_M``."""
    noise = gaussian_filter(np.random.default_rng(seed).standard_normal(shape), smoothing_px, mode="wrap")
    scaled: Float32 = (NOISE_M * noise / noise.std()).astype(np.float32)
    return scaled


def cylinder(
    tangent_angle: Callable[[Float64], Float64], half_length_m: float
) -> Callable[[Float64, Float64, Outline], Hits]:
    """Return the ray caster of a general cylinder with vertical rulings.

    Parameters
    ----------
    tangent_angle : callable
        Angle (radians) of the directrix at arc lengths (N,): 0 runs to the right, positive towards
        the camera. The arc length is u, the height v.
    half_length_m : float
        The directrix runs over ``[-half_length_m, half_length_m]``; its mean lies at the origin.
    """
    s = np.linspace(-half_length_m, half_length_m, 1601)
    step = s[1] - s[0]
    nodes, weights = np.polynomial.legendre.leggauss(5)
    inner = tangent_angle((s[:-1, None] + step * (nodes + 1) / 2).ravel()).reshape(-1, 5)
    moves = np.stack([np.cos(inner) @ weights, -np.sin(inner) @ weights], axis=1) * step / 2
    place = np.concatenate([np.zeros((1, 2)), np.cumsum(moves, axis=0)])
    place -= place.mean(axis=0)
    angle = tangent_angle(s)
    tangent = np.stack([np.cos(angle), -np.sin(angle)], axis=1)

    def cast(origin: Float64, directions: Float64, outline: Outline) -> Hits:
        best = np.full(len(directions), np.inf)
        u, v = np.full(len(directions), np.nan), np.full(len(directions), np.nan)
        outer = np.zeros(len(directions), dtype=np.bool_)
        across = np.ascontiguousarray(directions[:, [0, 2]])
        rays = np.arange(len(directions))
        # Each ray crosses the directrix a few times at most; the outline may let the first ones pass.
        for crossing in range(12):
            t, at, facing = _crossings(place, tangent, step, origin[[0, 2]], across[rays], crossing)
            found = np.isfinite(t)
            if not found.any():
                break
            rays, t, at, facing = rays[found], t[found], at[found] - half_length_m, facing[found]
            height = origin[1] + t * directions[rays, 1]
            nearer = (t > 0) & (t < best[rays]) & outline(at, height)
            hit = rays[nearer]
            best[hit], outer[hit], u[hit], v[hit] = t[nearer], facing[nearer], at[nearer], height[nearer]
        return np.where(np.isfinite(best), best, np.nan), u, v, outer

    return cast


@njit(cache=True)
def _crossings(
    place: Float64, tangent: Float64, step: float, origin: Float64, directions: Float64, wanted: int
) -> tuple[Float64, Float64, Bool]:
    """Return depth, arc length and facing of the n-th crossing, along the curve, of each ray in the plane."""
    t = np.full(directions.shape[0], np.nan)
    at = np.full(directions.shape[0], np.nan)
    facing = np.zeros(directions.shape[0], dtype=np.bool_)
    for n in range(directions.shape[0]):
        dx, dz = directions[n, 0], directions[n, 1]
        count = 0
        last = (place[0, 0] - origin[0]) * dz - (place[0, 1] - origin[1]) * dx
        for k in range(1, place.shape[0]):
            now = (place[k, 0] - origin[0]) * dz - (place[k, 1] - origin[1]) * dx
            if (last <= 0.0) != (now <= 0.0):
                if count == wanted:
                    m0 = (tangent[k - 1, 0] * dz - tangent[k - 1, 1] * dx) * step
                    m1 = (tangent[k, 0] * dz - tangent[k, 1] * dx) * step
                    low, high, rising = 0.0, 1.0, now > last
                    # The cubic through both ends with their tangents; bisection cannot fail.
                    for _ in range(50):
                        x = 0.5 * (low + high)
                        if (_hermite(last, now, m0, m1, x) > 0.0) == rising:
                            high = x
                        else:
                            low = x
                    x = 0.5 * (low + high)
                    px = _hermite(
                        place[k - 1, 0], place[k, 0], tangent[k - 1, 0] * step, tangent[k, 0] * step, x
                    )
                    pz = _hermite(
                        place[k - 1, 1], place[k, 1], tangent[k - 1, 1] * step, tangent[k, 1] * step, x
                    )
                    t[n] = ((px - origin[0]) * dx + (pz - origin[1]) * dz) / (dx * dx + dz * dz)
                    at[n] = (k - 1 + x) * step
                    # The outer normal lies to the left of the direction of travel, towards the camera.
                    facing[n] = rising
                    break
                count += 1
            last = now
    return t, at, facing


@njit(cache=True)
def _hermite(p0: float, p1: float, m0: float, m1: float, x: float) -> float:
    y = 1.0 - x
    return (1 + 2 * x) * y * y * p0 + x * y * y * m0 + x * x * (3 - 2 * x) * p1 - x * x * y * m1


def cone(half_angle_rad: float) -> Callable[[Float64, Float64, Outline], Hits]:
    """Return the ray caster of a circular cone that opens downwards, its apex 0.5 m above the origin.

    The flat coordinates are the unrolled cone's, ``(r sin a, r cos a)`` with the distance r from the
    apex and the unrolled angle a.
    """
    sin, cos = math.sin(half_angle_rad), math.cos(half_angle_rad)
    apex = np.array([0.0, -0.5, 0.15])

    def cast(origin: Float64, directions: Float64, outline: Outline) -> Hits:
        o, d = origin - apex, directions
        k = np.array([1.0, -((sin / cos) ** 2), 1.0])
        a, b, c = (d * d) @ k, (d * o) @ k, float((o * o) @ k)
        with np.errstate(invalid="ignore"):
            t = (-b - np.sqrt(b * b - a * c)) / a
            p = o + t[:, None] * d
            r = np.linalg.norm(p, axis=1)
            unrolled = np.arctan2(p[:, 0], -p[:, 2]) * sin
            u, v = r * np.sin(unrolled), r * np.cos(unrolled)
            hit = (t > 0) & (p[:, 1] > 0) & outline(u, v)
        return np.where(hit, t, np.nan), np.where(hit, u, np.nan), np.where(hit, v, np.nan), hit

    return cast


def _angle_of_varying_cylinder(s: Float64) -> Float64:
    """Integral of a curvature that grows along s: the radius falls from 1 m to 0.14 m."""
    x = (s + 0.26) / 0.52
    angle: Float64 = 0.9 - 0.52 * (1.0 * x + 3.2 * x * x)
    return angle


def _angle_of_pleat(s: Float64) -> Float64:
    """Flat, back over itself for 25 mm and forth again: a knife pleat with a hidden layer."""
    turned = math.radians(165.0)
    return turned * (_ramp((s + 0.03) / 0.03) - _ramp((s - 0.025) / 0.03))


def _ramp(x: Float64) -> Float64:
    x = np.clip(x, 0.0, 1.0)
    ramp: Float64 = x - np.sin(2 * np.pi * x) / (2 * np.pi)
    return ramp


def _box(u0: float, u1: float, v0: float, v1: float) -> Outline:
    return lambda u, v: (u >= u0) & (u <= u1) & (v >= v0) & (v <= v1)


def _sector(near_m: float, far_m: float, half_angle_rad: float) -> Outline:
    return lambda u, v: (
        (np.hypot(u, v) >= near_m) & (np.hypot(u, v) <= far_m) & (np.abs(np.arctan2(u, v)) <= half_angle_rad)
    )


def _either(first: Outline, second: Outline) -> Outline:
    return lambda u, v: first(u, v) | second(u, v)


def _rotation(turn_deg: tuple[float, float, float]) -> Float64:
    x, y, z = np.radians(turn_deg)
    about_x = np.array([[1, 0, 0], [0, np.cos(x), -np.sin(x)], [0, np.sin(x), np.cos(x)]])
    about_y = np.array([[np.cos(y), 0, np.sin(y)], [0, 1, 0], [-np.sin(y), 0, np.cos(y)]])
    about_z = np.array([[np.cos(z), -np.sin(z), 0], [np.sin(z), np.cos(z), 0], [0, 0, 1]])
    rotation: Float64 = about_z @ about_y @ about_x
    return rotation
