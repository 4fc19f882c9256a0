"""A link that no garment allows is doubted, a right one never; a part taken off is found again and floats."""

import dataclasses

import numpy as np
import pytest
from garment_evidence import at_mean, blank_view, cloth_of, evidence_from
from scipy.spatial import cKDTree

from flatcloth.core.types import Rigid2
from flatcloth.flattening.cloth import Cloth
from flatcloth.garments.deciding import (
    decided_part,
    decided_parts,
    found_again,
    is_decided,
    pixels_of_part,
)
from flatcloth.garments.evidence import PieceEvidence
from flatcloth.garments.kinds import kind_named
from flatcloth.garments.links import (
    DoubtedLink,
    basins,
    doubted_links,
    evidence_per_row,
    is_offered,
    is_wrong,
    side_of,
    split,
)
from flatcloth.garments.recognition import best_fits, is_suspect

KINDS = (kind_named("long_sleeved_shirt"), kind_named("sleeveless_dress"))
WEAK = 0.05


def sheet(rows: int, cols: int, weak_after: int) -> Cloth:
    """Return a flat sheet of samples 12 mm apart, weakly joined around one of its columns."""
    row, col = (each.ravel() for each in np.mgrid[0:rows, 0:cols])
    uv = 0.012 * np.stack([col, row], axis=1)
    edges = cKDTree(uv).query_pairs(0.018, output_type="ndarray").astype(np.int32)
    steep = (np.abs(col[edges] - weak_after - 0.5) < 3.0).any(axis=1)
    across = (col[edges] <= weak_after).sum(axis=1) == 1
    xyz = np.concatenate([uv, np.full((len(uv), 1), 0.85)], axis=1)
    return cloth_of(uv, xyz, edges, np.where(across, WEAK, np.where(steep, 0.3, 1.0)))


def test_areas_that_meet_where_little_joins_them_are_candidates_and_cut_there() -> None:
    cloth = sheet(20, 30, weak_after=9)
    (core, other), *more = basins(cloth)
    assert not more
    part = side_of(cloth, core, other)
    assert (part == (cloth.uv_m[:, 0] < 0.114)).all()
    assert basins(dataclasses.replace(cloth, evidence=np.ones(len(cloth.edges)))) == []


def test_evidence_counts_for_each_row_so_that_a_long_seam_of_false_pairs_stays_weak() -> None:
    for rows in (10, 40):
        cloth = sheet(rows, 30, weak_after=9)
        part = cloth.uv_m[:, 0] < 0.114
        pairs = rows + 2 * (rows - 1)  # straight ones and both diagonals
        assert evidence_per_row(cloth, part) == pytest.approx(pairs * WEAK / rows)
    link = DoubtedLink(part=part, probability=0.3, area_m2=0.01, evidence=3.0 * WEAK)
    assert is_wrong(link)
    assert not is_wrong(dataclasses.replace(link, probability=0.7))
    assert not is_wrong(dataclasses.replace(link, evidence=3.0))  # of a garment that is not known


def joined_at(motion: Rigid2) -> tuple[PieceEvidence, Cloth, np.ndarray]:
    """Return a shirt whose right sleeve is moved, weakly joined to the rest wherever it lies."""
    kind = kind_named("long_sleeved_shirt")
    outline = at_mean(kind.name)
    named = {name: place[:, 0] for name, place in kind.named(kind.mean[:, None]).items()}
    shoulder, armpit = named["shoulder_right"], named["armpit_right"]
    along = armpit - shoulder
    beyond = np.array([along[1], -along[0]]) / np.linalg.norm(along)

    def of_sleeve(places: np.ndarray) -> np.ndarray:
        found: np.ndarray = (places - shoulder) @ beyond > 0.0
        return found

    whole = evidence_from(outline)
    edges, insides = of_sleeve(whole.edge_uv_m), of_sleeve(whole.inside_uv_m)
    laid = np.where(edges[:, None], motion.apply(whole.edge_uv_m), whole.edge_uv_m)
    turned = np.where(edges[:, None], Rigid2(motion.theta_rad).apply(whole.edge_normal), whole.edge_normal)
    uv = np.where(insides[:, None], motion.apply(whole.inside_uv_m), whole.inside_uv_m)
    pairs = cKDTree(uv).query_pairs(0.0275, output_type="ndarray").astype(np.int32)
    across = insides[pairs].sum(axis=1) == 1
    assert across.sum() >= 4
    seam = uv[np.unique(pairs[across])]
    steep = (cKDTree(seam).query(uv)[0] < 0.04)[pairs].any(axis=1)
    evidence = np.where(across, WEAK, np.where(steep, 0.3, 1.0))
    places = np.rint((uv + 1.2) / 0.006).astype(int)
    depth = np.zeros((400, 400), dtype=np.float32)
    for off in np.ndindex(3, 3):
        depth[tuple((places[:, ::-1] + np.array(off) - 1).T)] = 0.01
    shape = dataclasses.replace(
        whole,
        edge_uv_m=laid,
        edge_normal=turned,
        inside_uv_m=uv,
        depth_m=depth,
        depth_origin_uv_m=np.full(2, -1.2),
        depth_pixel_m=0.006,
    )
    return shape, cloth_of(uv, whole.inside_xyz_m, pairs, evidence), insides


def test_a_sleeve_that_grows_from_the_hem_is_doubted() -> None:
    hem = Rigid2(np.pi / 2 - 0.7, 0.12, 0.42)  # down from the bottom hem
    shape, cloth, sleeve = joined_at(hem)
    fits = best_fits(shape, KINDS)
    assert is_suspect(fits[0], shape)
    links = doubted_links(fits, shape, cloth)
    assert is_offered(links[0])
    assert links[0].place is not None
    assert links[0].place.moved_m > 0.08
    chance = links[0].probability
    assert links[0].std_m == pytest.approx((1.0 - chance) ** 0.5 * links[0].place.moved_m)
    assert (links[0].part == sleeve).mean() > 0.98
    own, rest = split(shape, cloth, links[0].part)
    assert len(own.edge_uv_m) + len(rest.edge_uv_m) == len(shape.edge_uv_m)
    assert own.area_m2 == pytest.approx(links[0].area_m2)


def test_a_sleeve_where_it_belongs_is_not_doubted_however_weakly_it_is_joined() -> None:
    shape, cloth, _ = joined_at(Rigid2())
    fits = best_fits(shape, KINDS)
    assert not is_suspect(fits[0], shape)
    links = doubted_links(fits, shape, cloth)
    assert links
    assert not any(is_offered(link) for link in links)


def test_a_decided_part_is_found_again_on_a_shape_that_was_turned_and_floats() -> None:
    cloth = sheet(20, 30, weak_after=9)
    (core, other), *_ = basins(cloth)
    part = side_of(cloth, core, other)
    taken = decided_part(cloth, part, 0.3, taken_off=True)
    turned = dataclasses.replace(cloth, uv_m=Rigid2(1.0, 0.3, 0.2).apply(cloth.uv_m))
    again = found_again(turned, taken)
    assert again is not None
    assert (again == part).all()
    assert is_decided(turned, part, [taken])
    kept = dataclasses.replace(taken, taken_off=False)
    assert len(decided_parts([turned], [kept, taken]).taken_off) == 1
    assert decided_parts([turned], [taken, kept]).taken_off == []
    gone = dataclasses.replace(cloth, xyz_m=cloth.xyz_m + 1.0)
    assert found_again(gone, taken) is None
    assert decided_parts([gone], [taken]).taken_off == []

    view = blank_view(np.ones((115, 175), dtype=bool))
    own = pixels_of_part(view, cloth, part)
    assert view.uv_from_rc(np.argwhere(own))[:, 0].max() < 0.115
    assert view.uv_from_rc(np.argwhere(~own))[:, 0].min() > 0.113
