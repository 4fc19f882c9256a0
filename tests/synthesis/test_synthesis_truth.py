"""The truth of a mesh: its panels, and each laid on the plane as it hangs."""

import numpy as np
import pytest
from garment_meshes import HEIGHT_M, RADIUS_M, arc, tube

from flatcloth.core.errors import SynthesisError
from flatcloth.engine.evaluation import trimmed_fit
from flatcloth.synthesis.flat import FlatPanel, flatten_panel
from flatcloth.synthesis.meshes import GarmentMesh
from flatcloth.synthesis.panels import split_panels

DOWN = np.array([1.0, -1.0])


def flattened(vertices: np.ndarray, triangles: np.ndarray, corner_uv: np.ndarray | None = None) -> FlatPanel:
    members = np.arange(len(triangles), dtype=np.int32)
    return flatten_panel("cloth", members, vertices, triangles.astype(np.int32), corner_uv)


def error_m(panel: FlatPanel, true_uv: np.ndarray, triangles: np.ndarray) -> float:
    true = true_uv[triangles].reshape(-1, 2)
    fitted = trimmed_fit(panel.corner_uv_m.reshape(-1, 2), true)
    return float(np.linalg.norm(fitted - true, axis=1).max())


def mesh_of(triangles: np.ndarray, vertices: np.ndarray, **more: object) -> GarmentMesh:
    plain = {"group": np.zeros(len(triangles), dtype=np.int32), "group_names": ("",)}
    return GarmentMesh(vertices=vertices, triangles=triangles.astype(np.int32), **(plain | more))  # type: ignore[arg-type]


def test_a_bent_sheet_without_a_pattern_is_unrolled() -> None:
    vertices, triangles, flat = arc(160.0)
    panel = flattened(vertices, triangles)
    # The chords are 0.06 % shorter than the arcs: 0.15 mm of 280.
    assert error_m(panel, flat * DOWN, triangles) < 3e-4
    assert not panel.from_pattern
    assert panel.flipped_share == 0
    assert panel.stretch < 1e-4


@pytest.mark.parametrize("mirror", [1.0, -1.0])
@pytest.mark.parametrize("scale", [1.0, 0.37])
def test_a_pattern_serves_as_start_whatever_its_scale_and_side(mirror: float, scale: float) -> None:
    vertices, triangles, flat = arc(160.0)
    pattern = flat * (mirror, 1.0)
    pattern[:, 0] *= 1.0 + 0.2 * pattern[:, 1]  # cloth hangs sheared against its pattern
    panel = flattened(vertices, triangles, scale * pattern[triangles])
    assert panel.from_pattern
    assert error_m(panel, flat * DOWN, triangles) < 3e-4


def test_texture_coordinates_that_distort_the_cloth_are_not_used() -> None:
    vertices, triangles, flat = arc(160.0)
    panel = flattened(vertices, triangles, (flat**2)[triangles])
    assert not panel.from_pattern
    assert error_m(panel, flat * DOWN, triangles) < 3e-4


def test_a_tube_is_cut_between_its_openings() -> None:
    vertices, triangles = tube()
    panel = flattened(vertices, triangles)
    first, second = np.moveaxis(np.diff(panel.corner_uv_m, axis=1), 1, 0)
    area = np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]).sum() / 2
    assert area == pytest.approx(2 * np.pi * RADIUS_M * HEIGHT_M, rel=0.01)
    assert panel.flipped_share == 0
    assert panel.stretch < 1e-3


def test_a_tube_that_its_texture_cuts_is_cut_there() -> None:
    vertices, triangles = tube()
    angle = np.arctan2(vertices[:, 1], vertices[:, 0])[triangles]
    angle[np.ptp(angle, axis=1) > np.pi] %= 2 * np.pi
    corner_uv = np.stack([RADIUS_M * angle, vertices[triangles, 2]], axis=-1)
    panel = flattened(vertices, triangles, corner_uv)
    assert panel.from_pattern
    assert np.ptp(panel.corner_uv_m[..., 0]) == pytest.approx(2 * np.pi * RADIUS_M, rel=0.01)
    assert np.ptp(panel.corner_uv_m[..., 1]) == pytest.approx(HEIGHT_M, rel=0.01)


def test_what_no_cut_between_openings_flattens() -> None:
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    closed = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    with pytest.raises(SynthesisError, match=r"The surface of panel cloth is closed.*front and back"):
        flattened(corners, closed)
    vertices, triangles, _ = arc(columns=4, rows=4)
    fin = np.array([[0, 1, len(vertices)]])
    with pytest.raises(SynthesisError, match="more than two triangles at an edge"):
        flattened(np.concatenate([vertices, [[0, 0, 1.0]]]), np.concatenate([triangles, fin, fin[:, ::-1]]))


def test_parts_that_do_not_touch_lie_beside_each_other() -> None:
    vertices, triangles, flat = arc(60.0, start_deg=-100.0)
    other, _, _ = arc(60.0, start_deg=40.0)
    both = flattened(
        np.concatenate([vertices, other]), np.concatenate([triangles, triangles + len(vertices)])
    )
    first, second = np.split(both.corner_uv_m, 2)
    assert first[..., 0].max() < second[..., 0].min() or second[..., 0].max() < first[..., 0].min()
    for part in (first, second):
        fitted = trimmed_fit(part.reshape(-1, 2), (flat * DOWN)[triangles].reshape(-1, 2))
        assert np.abs(fitted - (flat * DOWN)[triangles].reshape(-1, 2)).max() < 3e-4


def test_groups_named_front_and_back_are_panels_1_and_2() -> None:
    vertices, triangles, _ = arc(columns=4, rows=4)
    group = np.repeat([0, 1, 2, 1], 8).astype(np.int32)
    mesh = mesh_of(triangles, vertices, group=group, group_names=("Back_1", "shirt FRONT", "collar"))
    panels = split_panels(mesh)
    assert [name for name, _ in panels] == ["front", "back", "collar"]
    assert [len(members) for _, members in panels] == [16, 8, 8]


def test_without_groups_the_texture_cuts_the_panels_the_largest_first() -> None:
    vertices, triangles, flat = arc(columns=6, rows=4)
    right = vertices[triangles].mean(axis=1)[:, 1] > 0.3 * RADIUS_M
    corner_uv = flat[triangles] + np.where(right, 5.0, 0.0)[:, None, None]
    panels = split_panels(mesh_of(triangles, vertices, corner_uv=corner_uv))
    assert [name for name, _ in panels] == ["piece 1", "piece 2"]
    assert sorted(panels[1][1]) == np.flatnonzero(right).tolist()


def test_a_texture_of_very_many_pieces_does_not_cut() -> None:
    vertices, triangles, flat = arc(columns=6, rows=4)
    scattered = flat[triangles] + np.arange(len(triangles))[:, None, None]
    assert len(split_panels(mesh_of(triangles, vertices, corner_uv=scattered))) == 1


def test_a_back_drawn_on_top_of_its_front_is_a_panel_of_its_own() -> None:
    vertices, triangles = tube()
    # Both sides of a skirt in one drawing, joined at the side seams.
    drawn = np.stack([RADIUS_M * np.abs(np.arctan2(vertices[:, 1], vertices[:, 0])), vertices[:, 2]], axis=1)
    panels = split_panels(mesh_of(triangles, vertices, corner_uv=drawn[triangles]))
    assert [len(members) for _, members in panels] == [len(triangles) / 2] * 2
    for name, members in panels:
        panel = flatten_panel(name, members, vertices, triangles.astype(np.int32), drawn[triangles])
        assert panel.from_pattern
        assert np.ptp(panel.corner_uv_m[..., 0]) == pytest.approx(np.pi * RADIUS_M, rel=0.01)
        assert panel.flipped_share == 0
