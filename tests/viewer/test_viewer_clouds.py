"""Which points the 3D scene shows, and in which colours."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import viser
from exported_sessions import Operator
from scenes import AXIS, Cylinder

from flatcloth.core.errors import RecordingError
from flatcloth.engine.integration import Integration
from flatcloth.rendering.colormaps import view_colors
from flatcloth.rendering.layers import CONFLICT_M, Appearance, rgba
from flatcloth.session.machine import Propose, Start
from flatcloth.session.store import SessionFolder
from flatcloth.viewer.protocol.picture import Picture, make_picture
from flatcloth.viewer.scene.clouds import (
    ALL,
    CONFLICTS,
    HELD,
    LIVE,
    NEW,
    PROPOSAL,
    SHAPE,
    CloudPanel,
    all_views,
    clouds_of,
)

ANGLES_DEG = (0.0, 30.0, 60.0, 330.0)
N = len(ANGLES_DEG)


@pytest.fixture(scope="module")
def integration() -> Integration:
    return Integration(Cylinder(angles_deg=ANGLES_DEG), method="paper")


@pytest.fixture(scope="module")
def picture(integration: Integration, tmp_path_factory: pytest.TempPathFactory) -> Picture:
    """A start view and a proposal on it."""
    folder = SessionFolder.open(
        tmp_path_factory.mktemp("s"), integration.recording, integration.config, "paper"
    )
    operator = Operator(integration, folder)
    operator.do(Start(0))
    operator.do(Propose(1))
    made = make_picture(integration, folder.state.document, None)
    folder.close()
    return made


def radius_m(points: np.ndarray) -> np.ndarray:
    return np.hypot(points[:, 0] - AXIS.point_m[0], points[:, 2] - AXIS.point_m[2])


def test_the_shape_the_view_and_what_the_proposal_adds_are_shown(picture: Picture) -> None:
    found = clouds_of(picture, AXIS, N)
    assert len(found[HELD].points_m) == picture.view.valid.sum()
    np.testing.assert_array_equal(found[HELD].colors, picture.view.rgb[picture.view.valid])
    assert picture.overlay is not None
    new = picture.overlay.new_points & picture.overlay.view.valid
    assert len(found[PROPOSAL].points_m) == new.sum() > 0
    assert len(found[LIVE].points_m) > 1000


def test_only_new_points_are_those_in_their_own_colors(picture: Picture) -> None:
    found = clouds_of(picture, AXIS, N, NEW)
    assert len(found[HELD].points_m) == len(found[LIVE].points_m) == 0
    np.testing.assert_array_equal(
        found[PROPOSAL].points_m, clouds_of(picture, AXIS, N, SHAPE)[PROPOSAL].points_m
    )
    assert picture.overlay is not None
    new = picture.overlay.new_points & picture.overlay.view.valid
    np.testing.assert_array_equal(found[PROPOSAL].colors, picture.overlay.view.rgb[new])


def test_each_point_has_the_color_of_its_view(picture: Picture) -> None:
    found = clouds_of(picture, AXIS, N, SHAPE, "source")
    assert (found[HELD].colors == view_colors(N)[0]).all()
    assert (found[PROPOSAL].colors == view_colors(N)[1]).all()


@pytest.mark.parametrize("color", ["z_angle", "height", "stretch", "incidence", "density", "place"])
def test_every_layer_colors_the_cloud(picture: Picture, color: str) -> None:
    found = clouds_of(picture, AXIS, N, SHAPE, color)
    assert found[HELD].colors.shape == found[HELD].points_m.shape
    assert found[HELD].colors.dtype == np.uint8


def test_a_chosen_layer_has_the_colours_of_the_page_in_space_too(
    viser_server: viser.ViserServer, integration: Integration, picture: Picture
) -> None:
    shown: list[str] = []
    panel = CloudPanel(viser_server, integration, lambda: shown.append("again"))
    try:
        gray = Appearance("gray", 0.2, 0.8)
        panel.choose_color("height", gray)
        found = panel.clouds(picture, AXIS)[HELD].colors
        expected = rgba(picture.view, "height", AXIS, N, gray)[picture.view.valid][:, :3]
        np.testing.assert_array_equal(found, expected)
        assert np.ptp(found.astype(np.int16), axis=1).max() <= 1  # the library's gray is rounded
        while not shown:
            time.sleep(0.01)
        told = len(shown)
        panel.choose_color("height", gray)
        assert len(shown) == told  # nothing is drawn for what is shown already
        panel.choose_color("height", Appearance("gray"))
        assert len(shown) == told + 1
    finally:
        panel.stop()


def test_only_conflicts_are_where_proposal_and_shape_are_apart(picture: Picture) -> None:
    agreeing = clouds_of(picture, AXIS, N, CONFLICTS)
    assert picture.overlay is not None
    overlay = picture.overlay.view
    common = overlay.valid & ~picture.overlay.new_points
    assert len(agreeing[PROPOSAL].points_m) < 0.05 * common.sum()
    off = overlay.xyz_m.copy()
    upper = np.arange(off.shape[0])[:, None] < np.median(np.nonzero(common)[0])
    off[common & upper] += np.float32([0.0, 0.0, 3 * CONFLICT_M])
    moved = replace(picture, overlay=replace(picture.overlay, view=replace(overlay, xyz_m=off)))
    found = clouds_of(moved, AXIS, N, CONFLICTS)[PROPOSAL].points_m
    assert 0.8 * (common & upper).sum() < len(found) < 1.1 * (common & upper).sum()
    assert len(clouds_of(moved, AXIS, N, CONFLICTS)[HELD].points_m) == 0


def test_without_a_proposal_nothing_is_new_or_in_conflict(picture: Picture) -> None:
    alone = replace(picture, overlay=None)
    for points in (NEW, CONFLICTS):
        assert not any(len(cloud.points_m) for cloud in clouds_of(alone, AXIS, N, points).values())


def test_all_views_lie_on_one_another(integration: Integration) -> None:
    cloud = all_views(integration, "color")
    assert abs(np.median(radius_m(cloud.points_m)) - 0.12) < 1e-3
    by_view = all_views(integration, "source")
    assert {tuple(c) for c in by_view.colors} == {tuple(c) for c in view_colors(N)}
    assert len(cloud.points_m) == len(by_view.points_m) <= 60_000


def test_a_view_that_cannot_be_read_is_left_out() -> None:
    class Torn(Cylinder):
        def __getitem__(self, view_index: int) -> Any:
            if view_index == 2:
                raise RecordingError("view 2: damaged.")
            return super().__getitem__(view_index)

    cloud = all_views(Integration(Torn(angles_deg=ANGLES_DEG), method="paper"), "source")
    assert {tuple(c) for c in cloud.colors} == {tuple(c) for c in view_colors(N)[[0, 1, 3]]}


def test_the_panel_reads_all_views_beside_and_says_why_nothing_is_shown(
    viser_server: viser.ViserServer, integration: Integration, picture: Picture, tmp_path: Path
) -> None:
    changes: list[float] = []
    panel = CloudPanel(viser_server, integration, lambda: changes.append(time.monotonic()))
    try:
        assert len(panel.clouds(picture, AXIS)[HELD].points_m) == picture.view.valid.sum()
        assert panel._hint.visible is False
        panel._points.value = ALL  # type: ignore[misc]  # viser sets it by a descriptor
        panel.clouds(picture, AXIS)
        end = time.monotonic() + 20
        while len(panel.clouds(picture, AXIS)[HELD].points_m) <= picture.view.valid.sum():
            assert time.monotonic() < end
            time.sleep(0.02)
        assert changes
        assert panel._hint.visible is False
        panel._points.value = CONFLICTS  # type: ignore[misc]
        panel.clouds(replace(picture, overlay=None), AXIS)
        assert panel._hint.visible is True
        assert "no proposal" in panel._hint.content
    finally:
        panel.stop()
