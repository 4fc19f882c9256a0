"""A part of the shape is found again where its cloth went, and placed where its garment has room for it."""

import dataclasses

import numpy as np
from garment_evidence import at_mean, blank_view, evidence_from, weakly_joined
from scipy.spatial import cKDTree

from flatcloth.core.types import Rigid2
from flatcloth.garments.deciding import (
    decided_part,
    decided_parts,
    found_again,
    pixels_of_part,
)
from flatcloth.garments.evidence import PieceEvidence
from flatcloth.garments.kinds import kind_named
from flatcloth.garments.placing import place_elsewhere
from flatcloth.garments.recognition import fits_of


def joined_at(motion: Rigid2) -> tuple[PieceEvidence, np.ndarray]:
    """Return a shirt whose right sleeve is moved, and which of its places inside are of the sleeve."""
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
    return shape, insides


def test_a_sleeve_that_grows_from_the_hem_belongs_at_the_shoulder_and_one_there_nowhere_else() -> None:
    for motion in (Rigid2(np.pi / 2 - 0.7, 0.12, 0.42), Rigid2()):  # down from the bottom hem, and right
        shape, sleeve = joined_at(motion)
        edges = cKDTree(shape.inside_uv_m[sleeve]).query(shape.edge_uv_m)[0] < 0.03
        pixels = np.argwhere(shape.depth_m > 0)
        places = shape.depth_origin_uv_m + shape.depth_pixel_m * pixels[:, ::-1]
        there = sleeve[cKDTree(shape.inside_uv_m).query(places)[1]]
        own, rest = shape.part(edges, sleeve, pixels[there]), shape.part(~edges, ~sleeve, pixels[~there])
        assert len(own.edge_uv_m) + len(rest.edge_uv_m) == len(shape.edge_uv_m)
        (fit,) = fits_of(rest, [kind_named("long_sleeved_shirt")])
        found = place_elsewhere(fit, rest, own)
        if motion == Rigid2():
            assert found is None
            continue
        assert found is not None
        back, probability = found
        off_m = np.linalg.norm((back @ motion).apply(own.inside_uv_m) - own.inside_uv_m, axis=1)
        assert off_m.mean() < 0.05
        assert probability > 0.5


def test_a_decided_part_is_found_again_on_a_shape_that_was_turned_and_floats() -> None:
    cloth = weakly_joined(20, 30, weak_after=9)
    part = cloth.uv_m[:, 0] < 0.114
    taken = decided_part(cloth, part, 0.3, taken_off=True)
    turned = dataclasses.replace(cloth, uv_m=Rigid2(1.0, 0.3, 0.2).apply(cloth.uv_m))
    again = found_again(turned, taken)
    assert again is not None
    assert (again == part).all()
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
