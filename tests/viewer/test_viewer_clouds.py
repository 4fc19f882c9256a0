"""Which points the 3D scene shows, and in which colours."""

import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from exported_sessions import Operator
from scenes import AXIS, Cylinder

from flatcloth.core.errors import RecordingError
from flatcloth.engine.integration import Integration
from flatcloth.rendering.colormaps import view_colors
from flatcloth.rendering.layers import rgba
from flatcloth.session.machine import Propose, Start
from flatcloth.session.store import SessionFolder
from flatcloth.viewer.protocol.picture import Picture, make_picture
from flatcloth.viewer.protocol.settings import Settings
from flatcloth.viewer.scene.scene import HELD, LIVE, PROPOSAL, Scene, all_views, clouds_of

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
    new = picture.overlay.new_points & picture.overlay.view.valid
    assert len(found[PROPOSAL].points_m) == new.sum() > 0
    assert len(found[LIVE].points_m) > 1000


def test_a_chosen_layer_has_the_colours_of_the_page_in_space_too(picture: Picture) -> None:
    found = clouds_of(picture, AXIS, N, "source")
    for name, view in ((HELD, 0), (PROPOSAL, 1)):
        assert (found[name].colors == view_colors(N)[view]).all()
    colors = clouds_of(picture, AXIS, N, "height")[HELD].colors
    expected = rgba(picture.view, "height", AXIS, N)[picture.view.valid][:, :3]
    np.testing.assert_array_equal(colors, expected)


@pytest.fixture
def scene(integration: Integration) -> Iterator[Scene]:
    scene = Scene(integration)
    yield scene
    scene.stop()


def test_what_is_not_wanted_is_neither_seen_nor_picked(scene: Scene, picture: Picture) -> None:
    scene.show(picture)
    everything = len(scene.visible_points())
    scene.arrange(Settings(show_view=False, show_new=False))
    assert len(scene.visible_points()) == picture.view.valid.sum() < everything
    scene.show(picture)  # the next picture is shown likewise
    assert len(scene.visible_points()) == picture.view.valid.sum()
    scene.arrange(Settings())
    assert len(scene.visible_points()) == everything


def test_all_views_are_read_when_they_are_wanted(scene: Scene, picture: Picture) -> None:
    scene.arrange(Settings())
    scene.show(picture)
    before = len(scene.visible_points())
    scene.arrange(Settings(show_all=True))
    end = time.monotonic() + 20
    while len(scene.visible_points()) <= before:
        assert time.monotonic() < end
        time.sleep(0.02)
    scene.arrange(Settings())
    assert len(scene.visible_points()) == before


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
