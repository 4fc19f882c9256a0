"""Lengths on the unrolled cylinder, where each has a closed form."""

from dataclasses import replace

import numpy as np
import pytest
from viewer_fakes import HEIGHT_M, PIXEL_M, RADIUS_M, cylinder_view

from flatcloth.grasping.measuring import measure

SIDE = cylinder_view({0: 0.0})


def place(u_m, v_m):
    return np.array([u_m, v_m])


def chord_m(along_m):
    """Through the air between two places as far apart along the girth."""
    return 2 * RADIUS_M * np.sin(along_m / RADIUS_M / 2)


@pytest.mark.parametrize(
    ("start", "end", "flat_m", "cloth_m", "air_m"),
    [
        ((-0.10, 0.15), (0.10, 0.15), 0.20, 0.20, chord_m(0.20)),
        ((0.0, 0.05), (0.0, 0.25), 0.20, 0.20, 0.20),
        (
            (-0.08, 0.05),
            (0.08, 0.25),
            np.hypot(0.16, 0.20),
            np.hypot(0.16, 0.20),
            np.hypot(chord_m(0.16), 0.20),
        ),
        ((0.01, 0.15), (0.01, 0.15), 0.0, 0.0, 0.0),
        ((-0.10, 0.15), (3.0, 0.15), 3.10, np.nan, np.nan),  # off the cloth
    ],
    ids=["across", "along", "the helix", "no distance", "off the cloth"],
)
def test_the_cloth_is_as_long_as_it_is_flat_and_longer_than_the_air(start, end, flat_m, cloth_m, air_m):
    found = measure(SIDE, place(*start), place(*end))
    assert found.flat_m == pytest.approx(flat_m, abs=1e-9)
    assert found.cloth_m == pytest.approx(cloth_m, rel=0.005, abs=1e-9, nan_ok=True)
    assert found.air_m == pytest.approx(air_m, abs=1e-4 + PIXEL_M, nan_ok=True)
    if np.isfinite(cloth_m):
        np.testing.assert_allclose(found.path_uv_m, [start, end], atol=1e-9)


def test_noise_of_the_depth_does_not_lengthen_the_cloth_much():
    noise = np.random.default_rng(0).normal(scale=0.001, size=SIDE.xyz_m.shape).astype(np.float32)
    found = measure(replace(SIDE, xyz_m=SIDE.xyz_m + noise), place(-0.10, 0.15), place(0.10, 0.15))
    assert found.cloth_m == pytest.approx(0.20, rel=0.02)


def slit():
    """A slit from the top down to 2/3 of the height, in the middle."""
    valid = SIDE.valid.copy()
    middle = valid.shape[1] // 2
    valid[: 2 * valid.shape[0] // 3, middle - 2 : middle + 3] = False
    xyz = np.where(valid[..., None], SIDE.xyz_m, np.float32(np.nan))
    return replace(SIDE, valid=valid, xyz_m=xyz)


def test_where_the_line_leaves_the_cloth_the_way_goes_round():
    found = measure(slit(), place(-0.06, 0.05), place(0.06, 0.05))
    foot = 2 / 3 * HEIGHT_M
    assert found.flat_m == pytest.approx(0.12)
    assert found.cloth_m == pytest.approx(2 * np.hypot(0.06, foot - 0.05), rel=0.06)
    assert len(found.path_uv_m) >= 3
    assert found.path_uv_m[:, 1].max() == pytest.approx(foot, abs=0.02)
    # Pulled tight: it goes straight to the foot of the slit and straight back.
    steps = np.linalg.norm(np.diff(found.path_uv_m, axis=0), axis=1)
    assert steps.sum() <= 1.05 * 2 * np.hypot(0.06, foot - 0.05)


def test_a_hair_crack_is_no_gap():
    valid = SIDE.valid.copy()
    valid[:, valid.shape[1] // 2] = False
    xyz = np.where(valid[..., None], SIDE.xyz_m, np.float32(np.nan))
    found = measure(replace(SIDE, valid=valid, xyz_m=xyz), place(-0.10, 0.15), place(0.10, 0.15))
    assert found.cloth_m == pytest.approx(0.20, rel=0.005)
    assert len(found.path_uv_m) == 2


def test_two_pieces_are_not_joined_by_cloth():
    valid = SIDE.valid.copy()
    middle = valid.shape[1] // 2
    valid[:, middle - 3 : middle + 3] = False
    found = measure(replace(SIDE, valid=valid), place(-0.10, 0.15), place(0.10, 0.15))
    assert np.isnan(found.cloth_m)
    assert found.air_m > 0
    assert len(found.path_uv_m) == 0
