"""Strips and necks: wide parts are told apart, turned as directions say, and known to be unsure."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.spatial import cKDTree

from flatcloth.core.geometry import rotation_about, tangent_basis
from flatcloth.methods.relaxation import BorderedBand, add_products
from flatcloth.methods.robust import articulated
from flatcloth.methods.robust.articulated import (
    FlexibleSheet,
    flexible,
    nearest_rigid_part,
    rigid_parts,
    settle_flexible,
)
from flatcloth.methods.robust.observations import _offsets
from flatcloth.methods.robust.uncertainty import (
    LEAST_STD_M,
    MOST_STD_M,
    _layer_rims,
    placement_std_m,
    strain_by_ripples,
    undetermined,
)

STEP_M = 0.008


def grid(rows: int, cols: int, corner: tuple[float, float]) -> np.ndarray:
    r, c = np.mgrid[:rows, :cols]
    return np.asarray(np.stack([c.ravel(), r.ravel()], axis=1) * STEP_M + np.array(corner))


def plates(neck: int, gap: float = 0.064) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Two plates of 12 x 12 nodes, ``neck`` nodes of a strip's width between them: places, pairs, plate."""
    left, right = grid(12, 12, (0.0, 0.0)), grid(12, 12, (0.088 + gap, 0.0))
    strip = grid(neck, round(gap / STEP_M) - 1, (0.096, 0.04))
    uv = np.concatenate([left, right, strip])
    plate = np.repeat([0, 1, 2], [len(left), len(right), len(strip)])
    edges = cKDTree(uv).query_pairs(1.5 * STEP_M, output_type="ndarray").astype(np.int32)
    return uv, edges, plate


def sheet(uv: np.ndarray, edges: np.ndarray, noise_m: float = 0.0) -> FlexibleSheet:
    """The pairs as one view sees them that looks along the normal."""
    z = uv @ np.array([1.0, 1j])
    along = z[edges[:, 1]] - z[edges[:, 0]]
    length = np.abs(along) + noise_m * np.random.default_rng(0).standard_normal(len(edges))
    return FlexibleSheet(
        edges=edges,
        once=edges,
        member=edges,
        n_members=len(uv),
        length_m=length,
        weight=np.ones(len(edges)),
        offset=np.stack([along, along], axis=1),
    )


def turned_about(uv: np.ndarray, which: np.ndarray, center: np.ndarray, degrees: float) -> np.ndarray:
    a = np.radians(degrees)
    rotation = np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]])
    result = uv.copy()
    result[which] = center + (uv[which] - center) @ rotation
    return result


def test_plates_on_a_strip_are_two_parts_and_the_strip_is_none() -> None:
    uv, edges, plate = plates(neck=2)
    rigid_part = rigid_parts(uv, edges)
    assert len(set(rigid_part[plate == 0])) == len(set(rigid_part[plate == 1])) == 1
    assert rigid_part[0] != rigid_part[plate == 1][0]
    assert (rigid_part[plate == 2] == -1).any()
    assert flexible(rigid_part, edges).any()
    nearest = nearest_rigid_part(uv, edges, rigid_part)
    assert (nearest >= 0).all()
    assert set(nearest[plate == 0]) == {rigid_part[0]}


def test_plates_that_are_joined_all_along_are_one_part() -> None:
    uv, edges, _ = plates(neck=2, gap=STEP_M)
    rigid_part = rigid_parts(uv, edges)
    assert set(rigid_part) == {0}


def test_parts_that_overlap_on_the_plane_stay_apart() -> None:
    uv, edges, plate = plates(neck=2)
    folded = uv.copy()
    folded[plate == 1] -= (0.1, 0.0)
    rigid_part = rigid_parts(folded, edges)
    assert set(rigid_part[plate == 0]).isdisjoint(rigid_part[plate == 1])


@pytest.mark.parametrize("degrees", [-25.0, 8.0])
def test_a_hinge_turns_to_where_directions_say(degrees: float) -> None:
    uv, edges, plate = plates(neck=1)
    rigid_part = rigid_parts(uv, edges)
    start = turned_about(uv, rigid_part == rigid_part[plate == 1][0], np.array([0.15, 0.04]), degrees)
    found = settle_flexible(start, sheet(uv, edges))
    assert np.abs(found[plate == 0] - uv[plate == 0]).max() < 1e-6
    assert np.linalg.norm(found - uv, axis=1).max() < 5e-4


def test_a_sheet_without_strips_is_left_alone() -> None:
    uv = grid(12, 12, (0.0, 0.0))
    edges = cKDTree(uv).query_pairs(1.5 * STEP_M, output_type="ndarray").astype(np.int32)
    assert settle_flexible(uv, sheet(uv, edges)) is uv


def test_contradicted_pairs_do_not_stop_it() -> None:
    uv, edges, plate = plates(neck=2)
    seen = sheet(uv, edges)
    seen.weight[:] = np.where((plate[edges] == 2).all(axis=1), 0.0, 1.0)
    assert np.isfinite(settle_flexible(uv, seen)).all()


@pytest.mark.parametrize("turned_rad", [0.0, 0.9])
def test_cloth_bent_as_a_cylinder_is_unrolled_exactly(turned_rad: float) -> None:
    radius, turn, height = 0.03, 0.6, 0.004
    points = np.array([[0.0, 0.0, -radius], [radius * np.sin(turn), height, -radius * np.cos(turn)]])
    normal = np.array([[0.0, 0.0, -1.0], [np.sin(turn), 0.0, -np.cos(turn)]])
    true = np.hypot(radius * turn, height)
    tangent = np.stack(tangent_basis(normal))
    edges = np.array([[0, 1]], dtype=np.int32)
    turn_all = rotation_about(np.array([0.48, 0.6, 0.64]), turned_rad).T  # the ruling is along no axis
    points, normal, tangent = (np.ascontiguousarray(each @ turn_all) for each in (points, normal, tangent))
    offset = _offsets(edges, points, normal, tangent, np.array([true]), np.radians(0.01))
    assert offset[0, 0] == pytest.approx(radius * turn + 1j * height, abs=1e-6)
    assert abs(offset[0, 1]) == pytest.approx(true)


class _Nodes:
    def __init__(self, uv: np.ndarray) -> None:
        self.xyz_m = np.pad(uv, ((0, 0), (0, 1)))
        self.normal = np.tile([0.0, 0.0, -1.0], (len(uv), 1))

    def __len__(self) -> int:
        return len(self.xyz_m)


def shape_of(uv: np.ndarray, edges: np.ndarray, plate: np.ndarray) -> Any:
    """What the sureness reads of a joint shape; the start view saw the first plate."""
    length = np.linalg.norm(uv[edges[:, 1]] - uv[edges[:, 0]], axis=1)
    return cast(
        Any,
        SimpleNamespace(
            nodes=_Nodes(uv),
            links=SimpleNamespace(
                edges=edges,
                once=edges,
                pair=np.arange(len(edges)),
                length_m=length,
                std_m=np.full(len(edges), 3e-4),
            ),
            placed=np.ones(len(uv), dtype=bool),
            has_place=np.ones(len(uv), dtype=bool),
            uv_m=uv,
            all_uv_m=uv,
            weight=np.ones(len(edges)),
            observations=[SimpleNamespace(node=np.flatnonzero(plate == 0), is_noisy=False)],
            node_evidence=np.full(len(uv), 9.0),
        ),
    )


def std_of_far_plate(neck: int, gap: float) -> tuple[float, np.ndarray]:
    uv, edges, plate = plates(neck, gap)
    shape = shape_of(uv, edges, plate)
    std = placement_std_m(shape, np.array([0.0, 0.0, 10.0]))
    assert np.median(std[plate == 0]) < 0.003
    return float(np.median(std[plate == 1])), undetermined(shape, std)[plate == 1]


def test_what_little_evidence_joins_is_unsure_in_proportion() -> None:
    uv, edges, plate = plates(neck=6, gap=STEP_M)
    shape = shape_of(uv, edges, plate)
    usual = placement_std_m(shape, np.array([0.0, 0.0, 10.0]))
    shape.node_evidence[:4] = [5.0, 1.0, 0.1, 0.0]
    std = placement_std_m(shape, np.array([0.0, 0.0, 10.0]))
    np.testing.assert_allclose(std[4:], usual[4:])
    more = np.sqrt(np.square(std[:4]) - np.square(usual[:4]) + (0.005 / 9.0) ** 2)
    np.testing.assert_allclose(more, [0.001, 0.005, 0.012, 0.012], rtol=1e-6)
    shape.node_evidence[:] *= 100.0  # without noise little of the usual evidence is still much
    assert placement_std_m(shape, np.array([0.0, 0.0, 10.0]))[0] < usual[0] + 1e-6


def test_what_hangs_on_a_string_is_known_to_be_unsure_and_floats() -> None:
    wide_m, wide_floats = std_of_far_plate(neck=2, gap=STEP_M)
    strip_m, _ = std_of_far_plate(neck=2, gap=0.064)
    string_m, string_floats = std_of_far_plate(neck=1, gap=0.12)
    assert wide_m < 0.005 < strip_m < string_m
    assert not wide_floats.any()
    assert string_m > MOST_STD_M
    assert string_floats.all()


@pytest.mark.parametrize(("columns", "sure"), [(12, 0), (7, 1)])
def test_of_two_parts_that_a_string_joins_the_start_views_is_the_shape_unless_the_other_is_clearly_larger(
    columns: int, sure: int
) -> None:
    uv, edges, plate = plates(neck=1, gap=0.12)
    kept = (plate != 0) | (uv[:, 0] > (11.5 - columns) * STEP_M)
    number = np.cumsum(kept) - 1
    shape = shape_of(uv[kept], number[edges[kept[edges].all(axis=1)]].astype(np.int32), plate[kept])
    std = placement_std_m(shape, np.array([0.0, 0.0, 10.0]))
    floats = undetermined(shape, std)
    assert not floats[plate[kept] == sure].any()
    assert np.median(std[plate[kept] == sure]) < 0.003
    assert floats[plate[kept] == 1 - sure].all()


def test_the_part_that_is_least_unsure_is_the_shape_even_where_nothing_is_sure() -> None:
    uv, edges, plate = plates(neck=1, gap=0.12)
    shape = shape_of(uv, edges, plate)
    std = np.where(plate == 1, 3.0, 2.0) * MOST_STD_M
    floats = undetermined(shape, std)
    assert floats[plate == 1].all()
    assert not floats[plate == 0].any()
    assert not undetermined(shape, std, 3.1 * MOST_STD_M).any()


def test_ripples_make_strain_and_flat_cloth_has_none() -> None:
    uv, edges, plate = plates(2, STEP_M)
    shape = shape_of(uv, edges, plate)
    shape.observations[0].is_noisy = True
    assert (strain_by_ripples(shape) == 1.0).all()
    column = np.rint(uv[:, 0] / STEP_M)
    lean = np.where(column % 2 == 0, 0.2, -0.2)
    shape.nodes.normal = np.stack([np.sin(lean), np.zeros(len(uv)), -np.cos(lean)], axis=1)
    assert (strain_by_ripples(shape) > 2.0).all()
    shape.observations[0].is_noisy = False
    assert (strain_by_ripples(shape) == 1.0).all()


def test_cloth_gathered_at_the_held_point_is_the_least_sure_and_none_is_surer_than_the_least() -> None:
    uv, edges, plate = plates(2, STEP_M)
    shape = shape_of(uv, edges, plate)
    corner = int(uv.sum(axis=1).argmax())
    held_far = placement_std_m(shape, np.array([0.0, 0.0, 10.0]))
    held_here = placement_std_m(shape, shape.nodes.xyz_m[corner])
    assert held_here[corner] > 2.0 * held_far[corner]
    assert min(held_far.min(), held_here.min()) >= LEAST_STD_M


def test_where_another_layer_lies_beside_a_noisy_rim_no_place_is_firm() -> None:
    depth = np.full((40, 60), 0.80, dtype=np.float32)
    depth[:, 30:] = 0.86  # another layer, farther
    usable = np.zeros(depth.shape, dtype=bool)
    usable[5:35, 5:29] = True
    depth[:5] = 0.0  # nothing is measured above
    surface = cast(
        Any,
        SimpleNamespace(
            frame=SimpleNamespace(depth_m=depth),
            usable=usable,
            depth_m=np.where(usable, depth, np.float32(np.nan)),
            inverse_depth=np.where(depth > 0, 1.0, 0.0),
        ),
    )
    rims = _layer_rims(surface)
    assert rims[20, 26:29].all()  # beside the other layer
    assert not rims[20, :25].any()  # inside, and at an outline beyond which is no other cloth
    assert not rims[5:8, 5:24].any()


def test_a_band_with_a_border_is_solved_as_the_whole_matrix_is() -> None:
    random = np.random.default_rng(3)
    band, border = np.zeros((7, 3)), np.zeros((2, 9))
    whole = np.zeros((9, 9))
    for first in (0, 2, 4):
        column, value = np.array([first, first + 1, first + 2, 7, 8]), random.standard_normal(5)
        add_products(column, value, 2.0, band, border)
        whole[np.ix_(column, column)] += 2.0 * np.outer(value, value)
    band[:, 0] += 1.0
    np.einsum("ii->i", border[:, 7:])[:] += 1.0
    rhs = random.standard_normal(9)
    found = BorderedBand(band, border).solve(rhs)
    np.testing.assert_allclose((whole + np.eye(9)) @ found, rhs, atol=1e-12)


def test_a_border_without_a_band_is_solved(capfd: pytest.CaptureFixture[str]) -> None:
    """Two rigid parts that pairs join directly have no free nodes."""
    found = BorderedBand(np.zeros((0, 1)), 2.0 * np.eye(3)).solve(np.ones(3))
    np.testing.assert_allclose(found, 0.5)
    assert not any(capfd.readouterr())  # LAPACK complains there about an empty matrix


def test_what_cannot_be_settled_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    uv, edges, _ = plates(neck=2)

    def refused(*_: object) -> None:
        raise np.linalg.LinAlgError

    monkeypatch.setattr(articulated, "BorderedBand", refused)
    np.testing.assert_array_equal(settle_flexible(uv, sheet(uv, edges)), uv)


def test_a_band_that_nothing_holds_is_refused() -> None:
    with pytest.raises(np.linalg.LinAlgError, match="not definite"):
        BorderedBand(np.zeros((3, 2)), np.zeros((0, 3)))


def test_a_chord_that_leaves_both_tangent_planes_is_turned_into_them() -> None:
    normal = np.tile([0.48, 0.6, -0.64], (2, 1))
    chord = np.array([0.008, 0.003, 0.004])
    points, edges = np.stack([np.zeros(3), chord]), np.array([[0, 1]], dtype=np.int32)
    tangent = np.stack(tangent_basis(normal))
    (found,) = _offsets(edges, points, normal, tangent, np.array([0.01]), np.radians(10.0))
    along = chord - chord @ normal[0] * normal[0]
    wanted = 0.01 * (tangent[:, 0] @ along) / np.linalg.norm(along)
    np.testing.assert_allclose(found, wanted[0] + 1j * wanted[1], atol=1e-12)
