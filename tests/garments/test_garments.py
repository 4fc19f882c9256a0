"""Garments: outlines, true edges, fits compared by evidence, named points."""

import dataclasses
import math

import numpy as np
import pytest
from garment_evidence import at_mean, blank_view, evidence_from, sampled

from flatcloth.core.errors import GarmentError
from flatcloth.core.geometry import Rigid3, rotation_about
from flatcloth.core.types import FlattenedView, Intrinsics, Rigid2
from flatcloth.flattening.sampling import CORRELATED_M
from flatcloth.garments.deciding import decided
from flatcloth.garments.distance import inside_outline, outside, poses_within, straight_inside, to_edges
from flatcloth.garments.evidence import PieceEvidence, evidence_of
from flatcloth.garments.example import seen_outline
from flatcloth.garments.fit import TEMPERATURE, crossing_energy, refine, starts
from flatcloth.garments.kinds import kind_named
from flatcloth.garments.model import with_slope
from flatcloth.garments.named_points import Point, dimensions_of
from flatcloth.garments.recognition import (
    NONE,
    fits_of,
    probabilities_by,
    recognise,
    temperature_of,
)
from flatcloth.garments.true_edges import SeenFrom

KINDS = (
    "long_sleeved_shirt",
    "shorts",
    "skirt",
    "sleeveless_dress",
    "towel",
    "trousers",
    "tshirt",
)


@pytest.mark.parametrize("name", KINDS)
def test_an_outline_is_symmetric_and_clockwise_without_crossings_and_has_its_named_points(
    name: str,
) -> None:
    outline = at_mean(name)
    mirrored = outline * [-1.0, 1.0]
    nearest = np.linalg.norm(outline[:, None] - mirrored[None], axis=-1).min(axis=1)
    np.testing.assert_allclose(nearest, 0.0, atol=1e-12)
    u, v = outline.T
    area = 0.5 * float(u @ np.roll(v, -1) - v @ np.roll(u, -1))
    assert area > 0.05
    places, normals = sampled(outline, 0.02)
    assert not inside_outline(places + 1e-4 * normals, outline).any()
    assert inside_outline(places - 1e-4 * normals, outline).all()
    kind = kind_named(name)
    named = kind.named(kind.mean[:, None])
    for place in named.values():
        assert np.linalg.norm(outline - place[:, 0], axis=1).min() < 1e-12
    for a, b in kind.dimensions.values():
        assert {a, b} <= set(named)
    left = [point for point in named if point.endswith("_left")]
    assert all(named[point][0, 0] < 0 < named[point.replace("_left", "_right")][0, 0] for point in left)


def test_a_line_across_the_gap_between_two_legs_is_not_inside() -> None:
    legs = np.array([[0, 0], [4, 0], [4, 10], [2.2, 10], [2.0, 2], [1.8, 10], [0, 10]], dtype=np.float64)
    one, other = np.array([[1.0, 9.5], [1.0, 1.0]]), np.array([[3.0, 9.0], [3.0, 1.2], [1.2, 8.0]])
    # A sixteenth of the gap's width would do: no sampling of the line may miss it.
    assert straight_inside(one, other, legs).tolist() == [[False, False, True], [False, True, True]]


@pytest.mark.parametrize("name", KINDS)
def test_the_derivatives_are_those_of_the_outline(name: str) -> None:
    kind = kind_named(name)
    outline, slope = with_slope(kind.outline, kind.mean)
    change = 1e-4 * kind.std
    moved = kind.outline((kind.mean + change)[:, None])[:, :, 0]
    np.testing.assert_allclose(moved - outline, slope @ change, atol=2e-6)


SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def test_cloth_inside_costs_nothing_and_outside_its_distance() -> None:
    q = np.array([[0.5, 0.5], [1.2, 0.5], [1.3, 1.4]])
    _, _, away, distance = outside(q, SQUARE)
    np.testing.assert_allclose(distance, [0.0, 0.2, 0.5])
    np.testing.assert_allclose(away[1:], [[1.0, 0.0], [0.6, 0.8]])


def test_an_edge_belongs_to_the_side_that_faces_as_it_does() -> None:
    q = np.array([[0.98, 0.50], [0.98, 0.03]])
    side, _, _, distance = to_edges(q, np.array([[1.0, 0.0], [0.0, -1.0]]), SQUARE)
    assert side.tolist() == [1, 0]
    np.testing.assert_allclose(distance, [-0.02, -0.03])


def test_poses_of_a_coarse_search_stand_evenly_in_the_box_where_a_piece_fits() -> None:
    places, low, high = np.array([[0.0, 0.0], [0.1, 0.2]]), np.zeros(2), np.array([0.6, 0.5])
    poses = poses_within(places, low, high, np.array([0.0, np.pi]))
    upright = poses[poses[:, 0] == 0.0, 1:]
    # Room of 0.5 m and 0.3 m, cells of twice the correlated length at most, in their middles.
    count = [math.ceil(room / (2.0 * CORRELATED_M)) for room in (0.5, 0.3)]
    assert len(upright) == count[0] * count[1]
    assert sorted(set(upright[:, 0])) == pytest.approx((np.arange(count[0]) + 0.5) * 0.5 / count[0])
    assert sorted(set(upright[:, 1])) == pytest.approx((np.arange(count[1]) + 0.5) * 0.3 / count[1])
    turned = poses[poses[:, 0] == np.pi, 1:] - np.array([0.1, 0.2])
    np.testing.assert_allclose(turned, upright, atol=1e-9)


def sheet_seen(
    depth_m: np.ndarray, of_interest: np.ndarray | None = None
) -> tuple[FlattenedView, list[SeenFrom]]:
    """Return a sheet from 40 to 198 mm both ways, 0.85 m away, and what the camera measured of it once."""
    k = Intrinsics(width=400, height=400, fx=425.0, fy=425.0, cx=0.0, cy=0.0)
    valid = np.zeros((140, 140), dtype=bool)
    valid[20:100, 20:100] = True
    camera = Rigid3(np.eye(3), np.zeros(3))
    seen = SeenFrom(depth_m=depth_m, of_interest=of_interest, intrinsics=k, camera_from_object=camera)
    return blank_view(valid), [seen]


def measured(first: int, last: int, depth_m: float = 0.85) -> np.ndarray:
    """Return a depth image (400, 400) of a square; a pixel is 2 mm of the sheet."""
    depth = np.zeros((400, 400), dtype=np.float32)
    depth[first:last, first:last] = depth_m
    return depth


def test_where_the_depth_ends_in_front_of_nothing_is_a_true_edge() -> None:
    # What was flattened ends 2 mm before the sheet does.
    evidence = evidence_of(*sheet_seen(measured(19, 101)))
    assert len(evidence.edge_uv_m) > 80
    left = evidence.edge_normal[:, 0] < -0.9
    np.testing.assert_allclose(evidence.edge_uv_m[left, 0], 0.037, atol=0.002)
    assert evidence.hole_edge_m == 0.0


def test_where_the_cloth_goes_on_or_is_covered_is_no_true_edge() -> None:
    assert len(evidence_of(*sheet_seen(measured(0, 400))).edge_uv_m) == 0
    covered = measured(19, 101)
    covered[:, 100:] = 0.60
    evidence = evidence_of(*sheet_seen(covered))
    assert not (evidence.edge_normal[:, 0] > 0.9).any()
    assert (evidence.edge_normal[:, 0] < -0.9).sum() > 15
    assert len(evidence.unseen_uv_m) > 15


def test_an_edge_that_more_views_saw_is_trusted_more() -> None:
    shape, seen = sheet_seen(measured(19, 101))
    once, often = (evidence_of(shape, seen * count) for count in (1, 6))
    assert len(once.edge_trust) == len(once.edge_uv_m)
    assert (once.edge_trust > 0.0).all()
    assert (often.edge_trust < 1.0).all()
    assert often.edge_trust.min() > once.edge_trust.max()


def test_an_edge_of_cloth_that_turns_away_from_the_camera_may_be_the_silhouette_of_a_fold() -> None:
    turn, middle, away = math.radians(55.0), np.array([0.12, 0.12, 0.85]), np.array([0.0, 0.0, 0.85])
    rotation = rotation_about(np.array([0.0, 1.0, 0.0]), turn)
    k = Intrinsics(width=400, height=400, fx=425.0, fy=425.0, cx=200.0, cy=200.0)
    row, col = np.mgrid[:400, :400]
    rays = np.stack([(col - k.cx) / k.fx, (row - k.cy) / k.fy, np.ones(row.shape)], axis=-1)
    depth = away @ rotation[:, 2] / (rays @ rotation[:, 2])
    there = (rays * depth[..., None] - away) @ rotation + middle
    inside = (np.abs(there[..., :2] - 0.12) < 0.082).all(axis=-1)
    seen = SeenFrom(
        depth_m=np.where(inside, depth, 0.0).astype(np.float32),
        of_interest=None,
        intrinsics=k,
        camera_from_object=Rigid3(rotation, away - rotation @ middle),
    )
    evidence = evidence_of(sheet_seen(measured(0, 400))[0], [seen])
    right, left = (sign * evidence.edge_normal[:, 0] > 0.9 for sign in (1.0, -1.0))
    assert right.sum() > 15
    assert left.sum() > 15
    assert evidence.edge_trust[right].min() > 0.4
    assert evidence.edge_trust[left].max() < 0.02  # the left edge is the farther one


def test_an_outline_keeps_to_trusted_edges_where_others_contradict_them() -> None:
    main = evidence_from(at_mean("towel"))
    right = main.edge_normal[:, 0] > 0.9
    # A fold inside of the towel, seen by one view, beside the edge that many saw.
    folded = main.edge_uv_m[right] - np.array([0.03, 0.0])
    both = dataclasses.replace(
        main,
        edge_uv_m=np.concatenate([main.edge_uv_m, folded]),
        edge_normal=np.concatenate([main.edge_normal, main.edge_normal[right]]),
        edge_std_m=np.zeros(len(right) + right.sum()),
        edge_trust=np.concatenate([np.full(len(right), 0.9), np.full(right.sum(), 0.1)]),
        inside_uv_m=main.inside_uv_m[:0],
        inside_std_m=main.inside_std_m[:0],
        inside_xyz_m=main.inside_xyz_m[:0],
    )
    kind = kind_named("towel")
    fitted = refine(kind, (both,), kind.mean, (Rigid2(),))
    assert abs(fitted.parameters[0] - kind.mean[0]) < 0.004


def test_where_the_side_of_interest_ends_on_cloth_is_an_edge() -> None:
    mask = np.zeros((400, 400), dtype=bool)
    mask[:, :100] = True
    evidence = evidence_of(*sheet_seen(measured(0, 400), mask))
    assert (evidence.edge_normal[:, 0] > 0.9).sum() > 15
    np.testing.assert_allclose(evidence.edge_uv_m[evidence.edge_normal[:, 0] > 0.9, 0], 0.199, atol=0.002)


@pytest.mark.parametrize(("step_m", "least", "most"), [(0.004, 0.9, 1.0), (-0.004, 0.0, 0.1)])
def test_an_edge_that_the_other_side_may_lie_on_is_trusted_as_far_as_it_lies_behind(
    step_m: float, least: float, most: float
) -> None:
    # Both layers are nearer to each other than one view can tell.
    mask = np.zeros((400, 400), dtype=bool)
    mask[:, :100] = True
    beside, alone = measured(0, 400), measured(19, 101)
    beside[:, 100:] += step_m
    evidence = evidence_of(*sheet_seen(beside, mask))
    right = evidence.edge_normal[:, 0] > 0.9
    free = evidence_of(*sheet_seen(alone))
    share = evidence.edge_trust[right].max() / free.edge_trust[free.edge_normal[:, 0] > 0.9].max()
    assert right.sum() > 15
    assert least < share <= most


def test_where_another_piece_goes_on_the_cloth_does_not_end() -> None:
    mask = np.zeros((400, 400), dtype=bool)
    mask[:, :100] = True
    view, seen = sheet_seen(measured(0, 400), mask)
    valid = np.zeros((140, 140), dtype=bool)
    valid[20:100, 102:140] = True
    evidence = evidence_of(view, seen, [dataclasses.replace(blank_view(valid), origin_uv_m=(5.0, 7.0))])
    assert not (evidence.edge_normal[:, 0] > 0.9).any()
    # The other layer of a fold lies there too, but faces away.
    behind = dataclasses.replace(blank_view(valid), normal=-blank_view(valid).normal)
    assert (evidence_of(view, seen, [behind]).edge_normal[:, 0] > 0.9).sum() > 15


def test_cloth_that_is_not_a_number_is_said() -> None:
    view, seen = sheet_seen(measured(0, 400))
    xyz = view.xyz_m.copy()
    xyz[50, 50] = np.nan
    with pytest.raises(GarmentError, match="not a number"):
        evidence_of(dataclasses.replace(view, xyz_m=xyz), seen)


def test_a_whole_outline_gives_its_own_parameters_and_pose() -> None:
    kind = kind_named("tshirt")
    parameters = kind.mean.copy()
    parameters[0], parameters[2] = 0.56, 0.63
    outline = kind.outline(parameters[:, None])[:, :, 0]
    motion = Rigid2(2.1, 0.3, -0.7)
    main = evidence_from(outline, motion)
    fits = [refine(kind, (main,), p, (m,)) for p, m in starts(kind, main, 4)]
    best = max(fits, key=lambda fit: fit.log_evidence)
    there = motion.apply(outline)
    mine = best.garment_from_piece[0].inverse().apply(best.outline)
    assert np.linalg.norm(mine - there, axis=1).max() < 0.006


def chances_of(main: PieceEvidence) -> dict[str, float]:
    return probabilities_by(fits_of(main), main)


def test_the_evidence_of_kinds_counts_by_the_part_of_the_turn_that_views_surround() -> None:
    assert temperature_of([350.0, 0.0, 170.0]) == pytest.approx(TEMPERATURE)  # half a turn
    assert temperature_of(np.arange(0.0, 360.0, 10.0).tolist()) == pytest.approx(TEMPERATURE * 180.0 / 350.0)
    main = evidence_from(at_mean("shorts"), Rigid2(0.8, 0.1, 0.2), noise_m=0.003)
    fits = fits_of(main)
    shares = [probabilities_by(fits, main, temperature_of(angles)) for angles in ([0.0, 180.0], [0.0, 20.0])]
    assert shares[0]["shorts"] > shares[1]["shorts"] > 1.0 / len(KINDS)
    alike = probabilities_by(fits, main, temperature_of([30.0, 390.0]))  # one direction tells nothing
    assert [alike[kind] for kind in KINDS] == pytest.approx([(1.0 - alike[NONE]) / len(KINDS)] * len(KINDS))


@pytest.mark.parametrize("name", ["shorts", "skirt", "towel", "sleeveless_dress"])
def test_each_kind_is_recognised_from_two_thirds_of_it(name: str) -> None:
    outline = at_mean(name)
    limit = outline[:, 0].min() + 0.66 * (outline[:, 0].max() - outline[:, 0].min())
    main = evidence_from(outline, Rigid2(0.8, 0.1, 0.2), np.array([1.0, 0.0, limit]), noise_m=0.003)
    probabilities = chances_of(main)
    assert max(probabilities, key=lambda kind: probabilities[kind]) == name
    assert math.isclose(sum(probabilities.values()), 1.0, abs_tol=1e-9)


def test_a_star_is_none_of_these() -> None:
    around = np.arange(10) * np.pi / 5
    radius = np.where(np.arange(10) % 2 == 0, 0.4, 0.16)
    star = np.stack([radius * np.cos(around), radius * np.sin(around)], axis=1)
    assert chances_of(evidence_from(star))[NONE] > 0.9


def test_a_hole_with_edges_all_round_speaks_for_no_known_kind() -> None:
    main = evidence_from(at_mean("towel"))
    holed = dataclasses.replace(main, hole_edge_m=0.38)  # 12 cm wide
    assert chances_of(main)[NONE] < 0.05
    assert chances_of(holed)[NONE] > 0.9


def test_an_outline_through_seen_cloth_costs() -> None:
    main = evidence_from(at_mean("towel"))
    depth = np.full((500, 500), 0.05, dtype=np.float32)
    main = dataclasses.replace(main, depth_m=depth, depth_origin_uv_m=np.full(2, -0.5))
    across = np.array([[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1]])
    assert crossing_energy(across, (main,), np.zeros((1, 3))) > 10.0
    assert crossing_energy(across + 5.0, (main,), np.zeros((1, 3))) == 0.0
    # The first and the last side lead off the cloth, from its corner.
    touching = np.array([[-0.5, -0.5], [-0.9, -0.6], [-0.6, -0.9]])
    assert crossing_energy(touching, (main,), np.zeros((1, 3))) == 0.0
    doubtful = dataclasses.replace(main, inside_std_m=np.full_like(main.inside_std_m, 0.3))
    assert crossing_energy(across, (doubtful,), np.zeros((1, 3))) < 0.5  # that cloth may be elsewhere


def towel_shape(motion: Rigid2) -> tuple[FlattenedView, PieceEvidence]:
    outline = at_mean("towel")
    there = motion.apply(outline)
    rows, cols = 500, 500
    view = blank_view(np.ones((rows, cols), dtype=bool))
    inside = inside_outline(view.uv_from_rc(np.argwhere(view.valid)), there).reshape(rows, cols)
    return blank_view(inside), evidence_from(outline, motion)


def test_named_points_are_found_with_their_cloth_and_predicted_without() -> None:
    motion = Rigid2(0.1, 0.45, 0.5)
    view, main = towel_shape(motion)
    answer = recognise(view, [main])
    assert answer.kind == "towel"
    true = motion.apply(
        np.stack([x[:, 0] for x in kind_named("towel").named(kind_named("towel").mean[:, None]).values()])
    )
    for point in answer.points.values():
        assert np.linalg.norm(true - point.uv_m, axis=1).min() < 0.008
        assert point.pixel is not None
        assert 0.0 < point.std_m < 0.03
    assert (
        abs(answer.dimensions["width"].value_m - 0.5) < 0.01
        or abs(answer.dimensions["length"].value_m - 0.5) < 0.01
    )
    sides = {frozenset(points) for points in answer.fit.kind.dimensions.values()}
    off = {side: np.linalg.norm(np.subtract(*(answer.points[end].uv_m for end in side))) for side in sides}
    for name, (a, b) in answer.fit.kind.dimensions.items():
        assert abs(answer.dimensions[name].value_m - off[frozenset((a, b))]) < 1e-9
    half = view.valid.copy()
    half[:, 250:] = False
    predicted = recognise(blank_view(half), [main])
    assert {point.pixel is None for point in predicted.points.values()} == {True, False}
    # All edges near a point are off as one if their cloth is: the more edges, the point is no better known.
    unsure = dataclasses.replace(main, edge_std_m=np.full_like(main.edge_std_m, 0.05))
    assert min(point.std_m for point in recognise(view, [unsure]).points.values()) > 0.015


def test_a_kind_is_as_sure_as_the_joints_that_it_hangs_on() -> None:
    """Cloth that may be anywhere tells no kind, but most probably it is where it lies."""
    view, main = towel_shape(Rigid2(0.1, 0.45, 0.5))
    anywhere = {name: np.full_like(getattr(main, name), 0.3) for name in ("edge_std_m", "inside_std_m")}
    doubtful = recognise(view, [dataclasses.replace(main, **anywhere)])
    assert doubtful.kind == "towel"
    assert 0.6 < doubtful.probability < recognise(view, [main]).probability - 0.03


def test_a_piece_that_no_kind_has_a_place_for_says_little_about_the_kind() -> None:
    view, main = towel_shape(Rigid2(0.1, 0.45, 0.5))
    triangle = seen_outline([np.array([[0.0, 0.0], [0.2, 0.0], [0.0, 0.25]])])
    alone, together = recognise(view, [main]), recognise(view, [main, triangle])
    assert together.probabilities == pytest.approx(alone.probabilities, abs=0.15)
    piece = together.pieces[0]  # it is as surely there as the kind is right
    assert piece.probability < 0.5
    by_hand = decided(together, [main, triangle], view, together.kind).pieces[0]
    assert by_hand.probability == pytest.approx(piece.probability / together.probability)


def test_a_dimension_is_between_the_points_found_the_better_known_side_counting_more() -> None:
    _view, main = towel_shape(Rigid2(0.1, 0.45, 0.5))
    fit = refine(kind_named("skirt"), (main,), kind_named("skirt").mean, (Rigid2(),))
    places = {
        "waist_left": (0.0, 0.0),
        "waist_right": (0.4, 0.0),
        "hem_left": (0.0, 0.5),
        "hem_right": (0.4, 0.6),
    }
    stds = {name: 0.01 if name.endswith("left") else 0.03 for name in places}
    points = {name: Point(uv_m=np.array(uv), std_m=stds[name], pixel=None) for name, uv in places.items()}
    found = dimensions_of(fit, points)
    assert abs(found["waist_width"].value_m - 0.4) < 1e-9
    assert abs(found["side_length"].value_m - (0.9 * 0.5 + 0.1 * 0.6)) < 1e-9
    doubted = {name: dataclasses.replace(point, doubt_m=0.3) for name, point in points.items()}
    assert dimensions_of(fit, doubted)["side_length"].std_m > 0.3 > found["side_length"].std_m


def test_too_little_cloth_is_said_and_not_guessed_about() -> None:
    view, main = towel_shape(Rigid2(0.1, 0.45, 0.5))
    with pytest.raises(GarmentError, match="20 cm2"):
        recognise(view, [dataclasses.replace(main, area_m2=0.002)])
    few = dataclasses.replace(main, edge_uv_m=main.edge_uv_m[:5], edge_normal=main.edge_normal[:5])
    with pytest.raises(GarmentError, match="true edges"):
        recognise(view, [few])
