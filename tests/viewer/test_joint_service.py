"""What holds a part of the shape is told to the page, and cut by a decision about the shown shape."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from route_client import RouteClient
from scenes import AXIS, CAMERA
from scipy.spatial import cKDTree

from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import FlattenedView
from flatcloth.flattening.cloth import Cloth
from flatcloth.session.machine import Document
from flatcloth.viewer.modes.joints import JointService
from flatcloth.viewer.protocol.messages import DecideJoint

SPACING_M = 0.012


class _Integration:
    method = "robust"
    axis = AXIS
    recording = SimpleNamespace(angles_deg=(0.0, 30.0), intrinsics=CAMERA)
    has_cloth = True

    def cloth(self, _document: Document) -> Cloth | None:
        row, col = (each.ravel() for each in np.mgrid[0:20, 0:30])
        uv = SPACING_M * np.stack([col, row], axis=1)
        edges = cKDTree(uv).query_pairs(0.018, output_type="ndarray").astype(np.int32)
        across = (col[edges] <= 9).sum(axis=1) == 1
        steep = (np.abs(col[edges] - 9.5) < 3.0).any(axis=1)
        xyz = np.concatenate([uv - 0.15, np.full((len(uv), 1), 0.85)], axis=1)
        evidence = np.where(across, 0.05, np.where(steep, 0.3, 1.0))
        length = np.linalg.norm(uv[edges[:, 0]] - uv[edges[:, 1]], axis=1)
        seen = np.ones(len(edges), dtype=np.int32)
        found = Cloth(
            uv_m=uv,
            xyz_m=xyz,
            edges=edges,
            evidence=evidence,
            length_m=length,
            view_index=seen,
            is_noisy=True,
        )
        return found if self.has_cloth else None

    def canonical(self, _document: Document) -> Any:
        shape = 20, 30
        nothing = np.zeros((*shape, 3), dtype=np.float32)
        view = FlattenedView(
            rgb=nothing.astype(np.uint8), xyz_m=nothing, normal=nothing,
            z_angle_deg=np.zeros(shape, dtype=np.float32), valid=np.ones(shape, dtype=np.bool_),
            view_index=np.zeros(shape, dtype=np.int16), source_rc=np.zeros((*shape, 2), dtype=np.float32),
            pixel_size_m=SPACING_M, origin_uv_m=(0.0, 0.0),
        )  # fmt: skip
        return SimpleNamespace(view=view)


@pytest.fixture
def integration() -> _Integration:
    return _Integration()


@pytest.fixture
def service(integration) -> JointService:
    picture = SimpleNamespace(revision=3, document=Document(start_view=0))
    page = SimpleNamespace(integration=integration, garments=SimpleNamespace(last=None), picture=picture)
    return JointService(cast("Any", page))


def test_a_joint_is_told_with_its_views_and_the_pixels_that_show_it(service) -> None:
    told = RouteClient(service.routes()).get("/joints/3.json").json()
    (joint,) = told["joints"]
    assert joint["area_cm2"] == pytest.approx(200 * 1e4 * SPACING_M**2)
    assert joint["weak"]
    (held,) = joint["views"]
    assert (held["view_index"], held["angle_deg"], held["pairs"]) == (1, 30.0, 58)
    assert held["residual_mm"] == [0.0, 0.0]
    assert held["rc"]
    assert all(0 <= row < CAMERA.height and 0 <= col < CAMERA.width for row, col in held["rc"])


def test_a_decision_is_about_the_shape_that_was_shown(service) -> None:
    decision = service.decision(DecideJoint(revision=3, index=0, cut=True))
    assert decision.part.taken_off
    assert max(u for u, _ in decision.part.part.uv_m) < 10 * SPACING_M
    kept = service.decision(DecideJoint(revision=3, index=0, cut=False))
    assert (kept.part.taken_off, kept.part.by_hand, kept.place) == (False, True, None)
    laid = service.decision(DecideJoint(revision=3, index=0, cut=True, place=(0.0, 0.1, 0.2)))
    assert laid.place is not None
    assert np.allclose(np.array(laid.place.piece.uv_m) - laid.part.part.uv_m, (0.1, 0.2))
    assert (laid.place.by_hand, laid.place.shape) == (True, laid.part.rest)
    for revision, index in ((2, 0), (3, 1)):
        with pytest.raises(FlatclothError, match="look again"):
            service.decision(DecideJoint(revision=revision, index=index, cut=True))


def test_a_method_without_evidence_says_so(service, integration) -> None:
    integration.has_cloth = False
    told = RouteClient(service.routes()).get("/joints/3.json").json()
    assert (told["joints"], "does not know" in told["trouble"]) == ([], True)
