"""Registration of bumpy and of smooth cylinders, rendered from poses that the recording gives wrongly."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
import pytest
from scenes import AXIS, frame, rays
from scipy.special import chdtri

from flatcloth.core.config import SurfaceConfig
from flatcloth.core.geometry import Rigid3, camera_from_object, rotation_about
from flatcloth.core.types import Float64, RotationAxis
from flatcloth.flattening.surface import Surface, observe_surface
from flatcloth.registration.adjustment import solved
from flatcloth.registration.cameras import register
from flatcloth.registration.pose_prior import PosePrior, moved_axis
from flatcloth.registration.registered import Registered, describe
from flatcloth.registration.view_features import (
    UNKNOWNS,
    ViewFeatures,
    compare,
    extract_features,
)

HELD_M = AXIS.point_m + np.array([0.0, -0.12, 0.0])
HALF_HEIGHT_M, RADIUS_M = 0.12, 0.10
ANGLES = (0.0, 30.0, -30.0, 60.0)

Relief = Callable[[Float64, Float64], Float64]
Paint = Callable[[Float64, Float64], Float64]


def bumps(around: Float64, height: Float64) -> Float64:
    waves = np.sin(4 * around + 40.0 * height) + 0.7 * np.sin(7 * around - 60.0 * height + 1.0)
    return RADIUS_M + 0.004 * waves


def smooth(around: Float64, _height: Float64) -> Float64:
    return np.full_like(around, RADIUS_M)


def printed(around: Float64, height: Float64) -> Float64:
    u, v = 400.0 * RADIUS_M * around, 400.0 * height
    hues = [np.sin(u + 0.4 * v), np.sin(0.9 * v - 0.5 * u + 1.0), np.sin(0.7 * u + 0.8 * v + 2.0)]
    return 130.0 + 50.0 * np.stack(hues, axis=-1)


def plain(around: Float64, _height: Float64) -> Float64:
    return np.full((*around.shape, 3), 128.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Loose:
    """How the truth differs from what is recorded."""

    axis: RotationAxis = AXIS
    turned_deg: tuple[float, ...] = (0.0,) * 8
    swung_deg: tuple[tuple[float, float], ...] = ((0.0, 0.0),) * 8

    def camera_from_object(self, n: int, recorded_deg: float) -> Rigid3:
        about_x, about_z = np.radians(self.swung_deg[n])
        swing = rotation_about(np.array([1.0, 0, 0]), about_x) @ rotation_about(
            np.array([0, 0, 1.0]), about_z
        )
        swung = Rigid3(swing, HELD_M - swing @ HELD_M)
        return swung @ camera_from_object(self.axis, recorded_deg + self.turned_deg[n])


EXACT = Loose()


def render(relief: Relief, paint: Paint, pose: Rigid3) -> tuple[Float64, Float64]:
    """Depth (H, W), NaN beside the item, and color of what the camera sees."""
    x, y = rays()
    ray = np.stack([x, y, np.ones_like(x)], axis=-1)
    back = pose.inverse()
    origin, way = back.translation_m - AXIS.point_m, back.turn(ray)
    depth = np.full(x.shape, AXIS.point_m[2] - 0.13)
    for _ in range(24):
        place = origin + depth[..., None] * way
        around = np.arctan2(place[..., 0], -place[..., 2])
        gap = np.hypot(place[..., 0], place[..., 2]) - relief(around, place[..., 1])
        depth = depth + 0.85 * np.clip(gap, -0.02, 0.02)
    seen = (np.abs(gap) < 1e-4) & (np.abs(place[..., 1]) < HALF_HEIGHT_M) & (depth < AXIS.point_m[2] + 0.1)
    return np.where(seen, depth, np.nan), paint(around, place[..., 1])


def clean(depth: Float64, _n: int) -> Float64:
    return depth


def surfaces_of_views(
    relief: Relief = bumps,
    paint: Paint = printed,
    loose: Loose = EXACT,
    angles: tuple[float, ...] = ANGLES,
    spoiled: Callable[[Float64, int], Float64] = clean,
    lit: Callable[[Float64], Float64] | None = None,
) -> list[Surface]:
    found = []
    for n, angle in enumerate(angles):
        depth, color = render(relief, paint, loose.camera_from_object(n, angle))
        if lit is not None:
            color = color * lit(depth)[..., None]
        depth = spoiled(depth, n)
        shown = frame(depth, np.isfinite(depth), np.clip(color, 0, 255), n, angle)
        found.append(observe_surface(shown, AXIS, SurfaceConfig()))
    return found


@lru_cache(8)
def features_of_views(*args: Any, **kwargs: Any) -> tuple[ViewFeatures, ...]:
    return tuple(extract_features(surface) for surface in surfaces_of_views(*args, **kwargs))


@lru_cache(8)
def registered(features: tuple[ViewFeatures, ...], prior: PosePrior | None = None) -> Registered:
    return register(features, AXIS, HELD_M, prior=prior)


def slips_m(found: Registered, loose: Loose = EXACT, *, known: bool = False) -> Float64:
    """How far neighbouring views lie off each other: the largest displacement of a ring of points."""
    turns = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    ring = [(RADIUS_M * np.cos(a), h, RADIUS_M * np.sin(a)) for a in turns for h in (-0.1, 0.1)]
    points = AXIS.point_m + np.array(ring)
    poses = found.known if known else found.object_from_camera
    off = [
        pose.apply(loose.camera_from_object(n, seen.angle_deg).apply(points))
        for n, (pose, seen) in enumerate(zip(poses, found.features, strict=True))
    ]
    return np.array([np.linalg.norm(o - off[0], axis=1).max() for o in off[1:]])


def noise(depth: Float64, n: int, std_m: float = 0.0012) -> Float64:
    field = cv2.GaussianBlur(np.random.default_rng(n).normal(size=depth.shape), (0, 0), 1.6)
    return np.rint(1e3 * (depth + std_m * field / field.std())) / 1e3


def fattened(depth: Float64, pixels: float) -> Float64:
    down, right = np.gradient(depth)
    return depth - pixels * np.hypot(down, right)


LOOSE = Loose(
    axis=replace(AXIS, point_m=AXIS.point_m + np.array([0.006, 0.0, -0.005])),
    turned_deg=(0.5, -1.4, 1.1, 2.0),
)
SWINGING = replace(LOOSE, swung_deg=((0.0, 0.0), (0.8, -0.5), (-0.6, 0.9), (1.0, 0.4)))


@pytest.mark.parametrize("loose", [LOOSE, SWINGING], ids=["loose", "swinging"])
@pytest.mark.parametrize("spoiled", [clean, noise])
def test_a_wrong_axis_wrong_angles_and_swing_are_found(
    loose: Loose, spoiled: Callable[[Float64, int], Float64]
) -> None:
    found = registered(features_of_views(loose=loose, spoiled=spoiled))
    assert slips_m(found, loose, known=True).max() > 0.004
    assert slips_m(found, loose).max() < 0.0016
    assert slips_m(found, loose).max() < 0.3 * slips_m(found, loose, known=True).max()
    turn_deg, axis_m, swing_deg = found.error_stds
    assert turn_deg > 0.5
    assert axis_m > 0.001
    assert (swing_deg > 0.1) == (loose is SWINGING)


def test_the_errors_are_as_large_as_is_said() -> None:
    found = registered(features_of_views(loose=SWINGING, spoiled=noise))
    for n, stds in enumerate(found.stds[1:], start=1):
        middle = found.known[n].apply(np.median(found.features[n].points_m, axis=0))

        def off(k: int, middle: Float64 = middle) -> Float64:
            true = SWINGING.camera_from_object(k, found.features[k].angle_deg)
            return (found.object_from_camera[k] @ true).apply(middle) - middle

        ends = {
            end for pair in found.pairs if n in (pair.first, pair.second) for end in (pair.first, pair.second)
        }
        against = np.mean([off(p) for p in sorted(ends - {n})], axis=0)
        assert (np.abs(off(n) - against) < 4.0 * stds[3:] + 0.0002).all()
        assert (stds[3:] < 0.001).all()
        assert (np.degrees(stds[:3]) < 0.6).all()


@pytest.mark.parametrize("spoiled", [clean, noise])
def test_exact_poses_stay(spoiled: Callable[[Float64, int], Float64]) -> None:
    found = registered(features_of_views(spoiled=spoiled))
    assert slips_m(found).max() < 0.0004
    turn_deg, axis_m, swing_deg = found.error_stds
    assert turn_deg < 0.15
    assert axis_m < 0.001
    assert swing_deg < 0.05


def test_a_sensor_that_makes_what_is_near_larger_is_not_taken_for_wrong_poses() -> None:
    found = registered(features_of_views(spoiled=lambda depth, _n: fattened(depth, 1.0)))
    assert found.fattening_px == pytest.approx(1.0, abs=0.15)
    assert abs(found.fattening_px - 1.0) < 4.0 * math.sqrt(found.covariance[4, 4])
    assert slips_m(found).max() < 0.0005


def test_texture_decides_how_a_smooth_cylinder_is_turned() -> None:
    loose = Loose(turned_deg=(0.0, 1.2, -1.0, 1.5))
    found = registered(features_of_views(smooth, printed, loose))
    turned_deg = np.degrees(found.own[:, 0])
    np.testing.assert_allclose(turned_deg - turned_deg[0], loose.turned_deg, atol=0.15)
    assert np.degrees(found.stds[:, 1]).max() < 0.3


def test_without_texture_a_smooth_cylinder_is_not_turned_and_it_says_so() -> None:
    loose = Loose(turned_deg=(0.0, 1.2, -1.0, 1.5))
    features = features_of_views(smooth, plain, loose)
    found = registered(features)
    assert np.degrees(np.abs(found.own[:, 0])).max() < 0.1
    sure = registered(features_of_views(smooth, printed, loose))
    assert (found.stds[:, 1] > 2.0 * sure.stds[:, 1]).all()
    # Were the recording known to be loose, nothing would be known of the turn but that.
    always_loose = PosePrior(turn_stds_deg=(1.5,), axis_stds_m=(0.006,), swing_stds_deg=(0.02,))
    unknown = registered(features, always_loose)
    assert math.degrees(unknown.stds[1, 1]) == pytest.approx(1.5 * 2**0.5, rel=0.35)


def test_the_lamp_is_not_taken_for_texture() -> None:
    """A lamp that stays with the camera shades the same places of the image, whatever turns there."""

    def lit(depth: Float64) -> Float64:
        rows, cols = np.indices(depth.shape)
        return 1.0 + 0.06 * np.sin(0.55 * cols) * np.sin(0.4 * rows)

    found = registered(features_of_views(smooth, plain, lit=lit))
    assert slips_m(found).max() < 0.0004


def test_views_with_too_little_in_common_stay() -> None:
    found = registered(features_of_views(loose=LOOSE, angles=(0.0, 180.0)))
    assert found.pairs == ()
    for pose, known in zip(found.object_from_camera, found.known, strict=True):
        np.testing.assert_allclose(pose.rotation, known.rotation, atol=1e-12)
        np.testing.assert_allclose(pose.translation_m, known.translation_m, atol=1e-12)
    assert describe(found).startswith("No two views")
    assert found.surprises.shape == (0,)


def test_a_lone_view_stands_where_the_axis_that_the_others_found_puts_it() -> None:
    loose = replace(LOOSE, turned_deg=(0.0,) * 5)
    found = registered(features_of_views(loose=loose, angles=(*ANGLES, 180.0)))
    assert all(4 not in (pair.first, pair.second) for pair in found.pairs)
    assert slips_m(found, loose, known=True)[3] > 0.01
    assert slips_m(found, loose)[3] < 0.001


def test_a_fit_where_no_view_can_stand_is_not_believed() -> None:
    """The relief repeats every 90 degrees; 12 degrees off, it fits somewhere, but not here."""
    found = registered(
        features_of_views(paint=plain, loose=Loose(turned_deg=(0.0, 12.0)), angles=(0.0, 20.0))
    )
    assert abs(math.degrees(found.own[1, 0])) < 6.0


def test_one_wrong_pair_among_many_loses_its_weight() -> None:
    before = registered(features_of_views(angles=(*ANGLES, -60.0)))
    wrong = replace(before.pairs[0], twist=before.pairs[0].twist + np.array([0, 0, 0, 0.004, 0, 0]))
    after = solved(replace(before, pairs=(wrong, *before.pairs[1:])))
    assert slips_m(after).max() < 0.0005


def test_a_strip_that_is_wrong_as_a_whole_does_not_claim_to_be_right() -> None:
    """The last view shows three columns only, near their outlines, and 4 mm too deep."""

    def strip(depth: Float64, n: int) -> Float64:
        seen = noise(depth, n)
        if n == len(ANGLES):
            middle = int(np.median(np.flatnonzero(np.isfinite(depth).any(axis=0))))
            seen[:, : middle - 1] = seen[:, middle + 2 :] = np.nan
            seen += 0.004
        return seen

    found = registered(features_of_views(angles=(*ANGLES, -60.0), spoiled=strip))
    assert found.is_confirmed
    of_strip = np.array([pair.first == len(ANGLES) for pair in found.pairs])
    assert of_strip.any()
    assert found.surprises[of_strip].max() < chdtri(UNKNOWNS, 1e-3)


def test_an_item_that_sways_is_not_confirmed_and_one_that_is_still_is() -> None:
    """It sways as one of 0.9 m whose lower end moves by 3 mm."""
    sways = Loose(swung_deg=((0.0, 0.0), (0.2, -0.15), (-0.15, 0.25), (0.2, 0.15)))
    found = registered(features_of_views(loose=sways, spoiled=noise))
    assert not found.is_confirmed
    assert found.is_loose
    assert "confirmed" not in describe(found)
    assert slips_m(found, sways).max() < 0.5 * slips_m(found, sways, known=True).max()
    still = registered(features_of_views(spoiled=noise))
    assert not still.is_loose
    assert describe(still).startswith("Recorded angles and axis are confirmed")
    few = len(still.prior.swing_stds_deg)
    doubted = replace(still, posterior=np.roll(still.posterior, few))  # an axis off by 1 mm
    assert not doubted.is_loose
    assert "confirmed" not in describe(doubted)


def test_the_report_says_what_was_changed() -> None:
    found = registered(features_of_views(loose=LOOSE))
    assert "Cameras registered: the axis moved by" in describe(found)
    assert found.axis_moved_m == pytest.approx(0.0078, abs=0.002)
    assert 0 < found.axis_std_m < 0.002
    np.testing.assert_allclose(moved_axis(found.axis, found.common).point_m, LOOSE.axis.point_m, atol=0.002)


def test_a_scrap_of_cloth_between_the_points_of_the_grid_is_registered_still() -> None:
    (whole,) = surfaces_of_views(angles=(0.0,))
    at = np.argwhere(whole.usable)[1000]
    usable = np.zeros_like(whole.usable)
    usable[at[0], at[1]] = True
    few = extract_features(replace(whole, usable=usable))
    assert len(few.points_m) == 1
    found = registered((few, *features_of_views(angles=(0.0,))))
    assert found.pairs == ()


def test_texture_counts_by_the_spread_of_its_own_channel() -> None:
    one, other = features_of_views(angles=ANGLES[:2])
    here, there = (camera_from_object(AXIS, angle).inverse() for angle in ANGLES[:2])

    def channels(*spread: float) -> list[float]:
        found = compare(one, other, here, there, HELD_M, 0.0, 0.01, np.array([0.0, *spread]))
        return [float(np.trace(matrix)) for matrix in found.matrix[1:]]

    alone = [channels(*np.eye(3)[k] * 1e6)[k] for k in range(3)]
    assert min(alone) > 0.0
    few, *others = channels(1e-3, 1e6, 1e6)
    assert few < 0.3 * alone[0]
    assert others == pytest.approx(alone[1:])
