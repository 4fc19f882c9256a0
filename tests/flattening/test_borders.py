"""The border of flattened cloth, against circles and rectangles of known size."""

from __future__ import annotations

import math

import numpy as np
import pytest
from garment_evidence import blank_view

from flatcloth.flattening.borders import SPACING_M, border_of, solid_cloth

SIZE_M, MIDDLE = 0.002, 60


def disc(radius_m: float) -> np.ndarray:
    row, column = np.mgrid[: 2 * MIDDLE + 1, : 2 * MIDDLE + 1] - MIDDLE
    return np.hypot(row, column) * SIZE_M <= radius_m


def around(rc: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return distances (K,) from the middle, m, and directions (K, 2) (u, v) off it."""
    off = (rc - MIDDLE)[:, ::-1] * SIZE_M
    radius_m = np.linalg.norm(off, axis=1)
    return radius_m, off / radius_m[:, None]


def test_places_stand_evenly_round_a_disc_and_point_off_it() -> None:
    border = border_of(disc(0.1), SIZE_M)
    radius_m, off = around(border.rc)
    assert radius_m == pytest.approx(0.1, abs=SIZE_M)
    assert (border.outward * off).sum(axis=1).min() > math.cos(math.radians(5.0))
    assert not border.hole.any()
    # Along pixels the way round is up to a tenth longer than the circle.
    assert 1.0 <= len(border.rc) * SPACING_M / (2.0 * math.pi * 0.1) < 1.1
    apart = np.linalg.norm(border.rc - np.roll(border.rc, 1, axis=0), axis=1) * SIZE_M
    assert apart == pytest.approx(SPACING_M, abs=0.75 * SIZE_M)


def test_the_border_of_a_hole_points_into_it_and_has_its_number() -> None:
    border = border_of(disc(0.1) & ~disc(0.03), SIZE_M)
    radius_m, off = around(border.rc)
    assert radius_m[border.hole == 0] == pytest.approx(0.1, abs=SIZE_M)
    assert radius_m[border.hole == 1] == pytest.approx(0.03, abs=SIZE_M)
    assert (border.outward * off).sum(axis=1)[border.hole == 1].max() < -math.cos(math.radians(5.0))
    assert set(border.hole) == {0, 1}


def test_a_hole_as_small_as_a_button_has_no_border() -> None:
    assert not border_of(disc(0.1) & ~disc(0.004), SIZE_M).hole.any()


def test_cloth_at_the_edge_of_the_raster_has_a_border_there() -> None:
    border = border_of(np.ones((80, 100), dtype=np.bool_), SIZE_M)
    assert border.rc.min(axis=0) == pytest.approx(0.0, abs=0.5)
    assert border.rc.max(axis=0) == pytest.approx([79, 99], abs=0.5)


def test_pinholes_are_filled_and_threads_and_specks_are_no_cloth() -> None:
    valid = disc(0.05)
    valid[MIDDLE, MIDDLE] = False  # a pinhole
    valid[MIDDLE, MIDDLE + 26 :] = True  # a thread
    valid[2:8, 2:8] = True  # a speck of 12 mm
    solid = solid_cloth(blank_view(valid, SIZE_M), 0.02**2)
    assert solid[MIDDLE, MIDDLE]
    assert not solid[MIDDLE, MIDDLE + 35 :].any()
    assert not solid[:10, :10].any()
    assert solid.sum() == pytest.approx(disc(0.05).sum(), rel=0.02)
    assert solid_cloth(blank_view(valid, SIZE_M), 0.01**2)[3:7, 3:7].all()
