"""A mesh becomes a recording: geometry, truth, colors, and every wrong request."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
from garment_meshes import HEIGHT_M, RADIUS_M, arc, tube, write_glb, write_obj, write_ply

from flatcloth.cli import main
from flatcloth.core.errors import SynthesisError
from flatcloth.core.geometry import back_project, object_from_camera
from flatcloth.recordings import open_recording
from flatcloth.recordings.base import Recording
from flatcloth.recordings.truth import Truth
from flatcloth.synthesis.hanging import hang, turn
from flatcloth.synthesis.recording import camera_of, synthesize
from flatcloth.synthesis.request import Request
from flatcloth.synthesis.textures import PATTERNS, pattern_rgb

CAMERA = camera_of((96, 128), 180.0)


def asked(**more: object) -> Request:
    """A request whose mesh is given otherwise."""
    return replace(Request(mesh=Path(), out=Path()), **more)  # type: ignore[arg-type]


def sheet_obj(folder: Path, **more: object) -> Path:
    """A bent sheet that faces the camera in view 0, held at the top of its middle."""
    vertices, triangles, flat = arc(160.0)
    return write_obj(folder / "sheet.obj", vertices, triangles, flat, **more)  # type: ignore[arg-type]


def request(folder: Path, mesh: Path | None = None, **more: object) -> Request:
    usual = Request(
        mesh=mesh or sheet_obj(folder),
        out=folder / "made",
        size_px=(96, 128),
        focal_px=180.0,
        held=(RADIUS_M, 0.0, 0.0),
        step_deg=45.0,
    )
    return replace(usual, **more)  # type: ignore[arg-type]


def made(folder: Path, mesh: Path | None = None, **more: object) -> Recording:
    return open_recording(synthesize(request(folder, mesh, **more)).request.out)


# --- geometry and truth ----------------------------------------------------------------------


def test_the_held_point_hangs_on_the_axis_above_the_middle_of_the_image(tmp_path: Path) -> None:
    recording = made(tmp_path, distance_m=0.6)
    axis, held = recording.rotation_axis, recording.held_point_m
    assert held is not None
    assert np.allclose(held, [0, -HEIGHT_M / 2, 0.6])
    assert np.allclose(axis.point_m, held)
    assert np.allclose(axis.direction, [0, -1, 0])
    assert recording.angles_deg == tuple(45.0 * n for n in range(8))
    shown = np.argwhere(recording[0].depth_m > 0)
    assert np.abs(shown.mean(axis=0) - (CAMERA.cy, CAMERA.cx)).max() < 2


def test_depth_is_along_the_optical_axis(tmp_path: Path) -> None:
    view = made(tmp_path)[0]
    x = (np.arange(CAMERA.width) - CAMERA.cx) / CAMERA.fx
    # The held point, at the outer face, is on the turning axis: the cylinder's middle lies behind it.
    center, a = 0.85 + RADIUS_M, 1 + x**2
    exact = (center - np.sqrt(np.maximum(center**2 - a * (center**2 - RADIUS_M**2), 0))) / a
    row = view.depth_m[CAMERA.height // 2]
    seen = row > 0
    assert seen.sum() > 30
    assert np.abs(row[seen] - exact[seen]).max() < 1.5e-3  # 24 flat strips make the cylinder


@pytest.mark.parametrize("texture", [True, False])
def test_views_agree_in_the_held_frame_with_their_angles_and_truth(tmp_path: Path, texture: bool) -> None:
    vertices, triangles, flat = arc(160.0)
    mesh = write_obj(tmp_path / "m.obj", vertices, triangles, flat if texture else None)
    recording = made(tmp_path, mesh, step_deg=30.0)
    truth, axis = Truth(recording.location), recording.rotation_axis
    assert axis is not None
    places = []
    for n in (0, 1, 11):
        view, true = recording[n], truth[n]
        assert view.mask is not None
        assert (view.mask == ((true.panel == 1) & true.outer_face)).all()
        xyz = object_from_camera(axis, recording.angles_deg[n]).apply(
            back_project(view.depth_m, recording.intrinsics)[view.mask]
        )
        places.append(np.column_stack([xyz, true.flat_uv_m[view.mask]]))
    for other in places[1:]:
        distance = np.linalg.norm(places[0][:, None, :3] - other[None, :, :3], axis=-1)
        near = distance.min(axis=1) < 2e-3
        assert near.sum() > 100
        moved = places[0][near, 3:] - other[distance.argmin(axis=1)[near], 3:]
        assert np.linalg.norm(moved, axis=1).max() < 3e-3


def test_the_truth_is_seen_from_outside_and_not_mirrored(tmp_path: Path) -> None:
    recording = made(tmp_path)
    true = Truth(recording.location)[0].flat_uv_m
    row, col = CAMERA.height // 2, CAMERA.width // 2
    assert true[row, col + 10, 0] > true[row, col - 10, 0]
    assert true[row + 10, col, 1] > true[row - 10, col, 1]


def test_the_inner_face_is_no_side_of_interest(tmp_path: Path) -> None:
    recording = made(tmp_path)
    behind = recording[4]  # turned by 180 degrees
    assert (behind.depth_m > 0).sum() > 500
    assert not behind.mask.any()
    assert not Truth(recording.location)[4].outer_face.any()
    turned = made(tmp_path, inside_out=True, out=tmp_path / "other")[4]
    assert turned.mask is not None
    assert (turned.mask == (turned.depth_m > 0)).all()


def test_panels_of_groups_are_told_apart(tmp_path: Path) -> None:
    vertices, triangles = tube()
    front = vertices[triangles].mean(axis=1)[:, 0] > 0
    groups = {"front": np.flatnonzero(front), "back": np.flatnonzero(~front)}
    mesh = write_obj(tmp_path / "tube.obj", vertices, triangles, groups=groups)
    recording = made(tmp_path, mesh, held=None, panel="back", step_deg=90.0)
    truth = Truth(recording.location)
    assert truth.panel_of_interest == 2
    shown = [np.unique(truth[n].panel[truth[n].outer_face]).tolist() for n in (0, 2)]
    assert shown == [[1], [2]]
    masked = [recording[n].mask for n in (0, 2)]
    assert [bool(m.any()) for m in masked if m is not None] == [False, True]


# --- hanging ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("up", "file_from_z_up"),
    [
        ("z", np.eye(3)),
        ("y", np.array([[0, 1.0, 0], [0, 0, 1], [1, 0, 0]])),
        ("x", np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0]])),
    ],
)
def test_any_axis_may_be_up(up: str, file_from_z_up: np.ndarray) -> None:
    vertices, _, _ = arc()
    usual = hang(vertices, asked())
    turned = hang(vertices @ file_from_z_up.T, asked(up=up))
    assert np.allclose(turned.points_m, usual.points_m)
    below = hang(-vertices @ file_from_z_up.T, asked(up=f"-{up}"))
    assert np.allclose(below.points_m[:, 1], usual.points_m[:, 1])


def test_units_and_held_point_are_the_files(tmp_path: Path) -> None:
    vertices, triangles, _ = arc()
    mesh = write_obj(tmp_path / "mm.obj", 1e3 * vertices + 500, triangles)
    recording = made(tmp_path, mesh, scale=0.001, held=(500 + 1e3 * RADIUS_M, 500.0, 500.0), step_deg=90.0)
    same = made(tmp_path, out=tmp_path / "m", step_deg=90.0)
    assert np.abs(recording[0].depth_m - same[0].depth_m).max() < 2e-4


def test_balanced_the_middle_hangs_below_the_held_vertex() -> None:
    vertices, _, _ = arc()
    hung = hang(vertices, asked(held_vertex=0, balance=True))
    offset = hung.points_m.mean(axis=0) - hung.held_point_m
    assert np.allclose(offset[[0, 2]], 0, atol=1e-9)
    assert offset[1] > 0
    assert np.allclose(hung.points_m[0], hung.held_point_m)
    size = np.linalg.norm(hung.points_m[0] - hung.points_m[-1])
    assert size == pytest.approx(np.linalg.norm(vertices[0] - vertices[-1]))


# --- colors ----------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", PATTERNS)
def test_patterns_lie_on_the_cloth_and_change_with_the_seed(kind: str) -> None:
    uv = np.random.default_rng(0).uniform(-0.3, 0.3, (4000, 2))
    rgb = pattern_rgb(kind, uv, 1, seed=3)
    assert rgb.shape == (4000, 3)
    assert 0 <= rgb.min() < rgb.max() <= 1
    assert (pattern_rgb(kind, uv, 1, seed=3) == rgb).all()
    assert np.allclose(pattern_rgb(kind, uv[::-1], 1, seed=3)[::-1], rgb)  # a place has its color
    for other in (pattern_rgb(kind, uv, 1, seed=4), pattern_rgb(kind, uv, 2, seed=3)):
        assert np.abs(other - rgb).max() > 0.02


def test_the_meshs_own_colors_are_taken_if_it_has_any(tmp_path: Path) -> None:
    vertices, triangles, uv = arc(160.0)
    rgb = np.where(vertices[:, 1:2] > 0, [[220, 20, 20]], [[20, 20, 220]])
    recording = made(tmp_path, write_ply(tmp_path / "a.ply", vertices, triangles, rgb))
    row = recording[0].color[CAMERA.height // 2].astype(int)
    middle = CAMERA.width // 2
    assert row[middle + 6, 0] > 2 * row[middle + 6, 2]  # red to the right
    assert row[middle - 6, 2] > 2 * row[middle - 6, 0]
    bgr = np.zeros((16, 16, 3), np.uint8)
    bgr[:8], bgr[8:] = (0, 0, 230), (230, 0, 0)  # red above
    y_up = vertices[:, [1, 2, 0]]
    up = np.stack([uv[:, 0], 1.0 + uv[:, 1] / HEIGHT_M], axis=1)
    glb = write_glb(tmp_path / "a.glb", y_up, triangles, up, bgr)
    view = made(tmp_path, glb, held=None, out=tmp_path / "glb")[0]
    column = view.color[:, middle].astype(int)
    shown = np.flatnonzero(view.depth_m[:, middle] > 0)
    assert column[shown[4], 0] > 2 * column[shown[4], 2]
    assert column[shown[-4], 2] > 2 * column[shown[-4], 0]


# --- noise and pose errors --------------------------------------------------------------------


def test_a_noisy_recording_has_millimetres_and_the_truth_of_the_clean_one(tmp_path: Path) -> None:
    clean = made(tmp_path, out=tmp_path / "clean")
    d435 = made(tmp_path, out=tmp_path / "noisy", noise="d435")
    assert np.allclose(d435[0].depth_m * 1e3, np.rint(d435[0].depth_m * 1e3), atol=1e-3)
    true, other = Truth(clean.location)[0], Truth(d435.location)[0]
    assert np.array_equal(true.flat_uv_m, other.flat_uv_m, equal_nan=True)
    mask = d435[0].mask
    assert mask is not None
    assert (d435[0].depth_m[mask] > 0).all()
    assert (true.panel[mask] == 1).all()


def test_loose_angles_and_axis_are_wrong_only_in_what_is_recorded(tmp_path: Path) -> None:
    exact = made(tmp_path, out=tmp_path / "exact")
    loose = made(tmp_path, out=tmp_path / "loose", angle_error_deg=1.5, axis_error_mm=6.0)
    error = np.subtract(loose.angles_deg, exact.angles_deg)
    assert error[0] == 0
    assert 0.3 < np.std(error[1:]) < 4
    off = loose.rotation_axis.point_m - exact.rotation_axis.point_m
    assert np.abs(off).max() > 1e-3
    assert off[1] == 0
    assert (loose[3].depth_m == exact[3].depth_m).all()


def test_a_swinging_item_stays_at_the_held_point() -> None:
    hung = hang(arc()[0], asked(held=(RADIUS_M, 0.0, 0.0)))
    requests = [asked(step_deg=1.0, sway_mm=sway_mm) for sway_mm in (0.0, 20.0)]
    still, swinging = (turn(hung, each, np.random.default_rng(0)) for each in requests)
    lowest = hung.held_point_m + np.array([0, HEIGHT_M, 0])
    moved = np.array(
        [
            [s.apply(p) - q.apply(p) for p in (hung.held_point_m, lowest)]
            for s, q in zip(swinging.camera_from_view0, still.camera_from_view0, strict=True)
        ]
    )
    assert np.allclose(moved[:, 0], 0)
    assert np.allclose(moved[0], 0)  # angles count from view 0
    assert np.allclose(moved[:, 1].std(axis=0)[[0, 2]], 0.02, rtol=0.15)
    assert swinging.recorded_angles_deg == tuple(map(float, range(360)))
    assert (swinging.recorded_axis.point_m == still.recorded_axis.point_m).all()


def test_recorded_angles_never_fall_on_each_other() -> None:
    loose = asked(step_deg=1.0, angle_error_deg=5.0)
    turning = turn(hang(arc()[0], loose), loose, np.random.default_rng(0))
    recorded = np.sort(np.mod(turning.recorded_angles_deg, 360))
    assert np.diff(recorded, append=recorded[0] + 360).min() > 0.009


# --- requests that cannot be met -------------------------------------------------------------


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"scale": 0.001}, r"sheet\.obj: The mesh is 0.0003 m large, a garment has"),
        ({"held": (1.0, 0.0, 0.0)}, "mm away from that point"),
        ({"held": (float("nan"), 0.0, 0.0)}, "nan mm away from that point"),
        ({"held": None, "held_vertex": 100_000}, "--held-vertex 100000: the mesh has vertices 0 to"),
        ({"up": "-z", "held": (RADIUS_M, 0.0, 0.0)}, "extends only 0 mm below"),
        ({"panel": "sleeve"}, r"--panel sleeve: not a side of this mesh\. Choose 1 \(piece 1\)"),
        ({"panel": "2"}, "--panel 2: not a side"),
        ({"texture": "mesh"}, "has no colors. Choose"),
        ({"texture": "tartan"}, "--texture tartan: unknown"),
        ({"distance_m": 0.1}, "--distance 0.1: choose"),
        ({"distance_m": float("nan")}, "--distance nan: choose"),
        ({"step_deg": 0.0}, "--step 0: choose"),
        ({"sway_mm": 1000.0}, "--sway 1000: choose"),
        ({"twist_deg": 20.0}, "--twist 20: choose"),
        ({"exposure_percent": 90.0}, "--exposure 90: choose"),
        ({"seed": -1}, "--seed -1: choose"),
        ({"size_px": (10, 100)}, "--size 10 100"),
        ({"focal_px": 5.0}, "--focal 5"),
        ({"center_px": (150.0, 50.0)}, "--center 150 50"),
    ],
)
def test_wrong_requests(tmp_path: Path, more: dict[str, object], said: str) -> None:
    with pytest.raises(SynthesisError, match=said):
        synthesize(request(tmp_path, **more))
    assert not (tmp_path / "made").exists()


def test_only_the_back_named(tmp_path: Path) -> None:
    mesh = sheet_obj(tmp_path, groups={"back": np.arange(576)})
    with pytest.raises(SynthesisError, match=r"sheet.obj: The mesh has no group named front"):
        synthesize(request(tmp_path, mesh))


def test_a_front_alone_is_a_single_layer_whose_other_side_is_its_inner_face(tmp_path: Path) -> None:
    mesh = sheet_obj(tmp_path, groups={"front": np.arange(576)})
    recording = made(tmp_path, mesh, step_deg=90.0)
    truth = Truth(recording.location)
    outer = [(truth[n].outer_face & (truth[n].panel == 1)).sum() for n in range(4)]
    inner = [(~truth[n].outer_face & (truth[n].panel == 1)).sum() for n in range(4)]
    assert max(outer) > 100
    assert max(inner) > 100
    assert all((truth[n].panel <= 1).all() for n in range(4))
    for n in range(4):
        mask = recording[n].mask
        assert mask is not None
        assert (truth[n].outer_face[mask] & (truth[n].panel[mask] == 1)).all()


def test_a_flat_panel_too_large_for_the_format(tmp_path: Path) -> None:
    vertices, triangles, _ = arc(160.0)
    mesh = write_obj(tmp_path / "curtain.obj", vertices * (1, 1, 12), triangles)
    with pytest.raises(SynthesisError, match="over 3 m large when flat"):
        synthesize(request(tmp_path, mesh, distance_m=4.0))


def test_an_item_that_leaves_the_image_is_noted(tmp_path: Path) -> None:
    assert not synthesize(request(tmp_path)).warnings
    near = synthesize(request(tmp_path, out=tmp_path / "near", distance_m=0.4))
    assert "leaves the image" in near.warnings[0]


def test_a_folded_truth_is_noted(tmp_path: Path) -> None:
    # A ball with a small hole: no way of laying it flat keeps it from folding.
    ball = trimesh.creation.uv_sphere(0.15, count=(24, 24))
    below = (ball.vertices[ball.faces][..., 2] < 0.1499).all(axis=1)
    mesh = write_obj(tmp_path / "ball.obj", ball.vertices, ball.faces[below])
    result = synthesize(request(tmp_path, mesh, held=None))
    assert "folded on the plane" in result.warnings[0]


# --- the command -----------------------------------------------------------------------------


def test_the_command_makes_a_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "made"
    mesh = str(sheet_obj(tmp_path))
    options = ["--size", "96", "128", "--focal", "180", "--step", "90", "--held", str(RADIUS_M), "0", "0"]
    assert main(["synthesize", mesh, "--out", str(out), "--noise", "d435", "--name", "bent", *options]) == 0
    assert "4 views written" in capsys.readouterr().out
    recording = open_recording(out)
    assert (recording.name, len(recording)) == ("bent", 4)
    assert cv2.imread(str(out / "color" / "000.png")).shape == (128, 96, 3)
    assert main(["synthesize", mesh, "--out", str(out), *options]) == 2
    assert "contains a recording" in capsys.readouterr().err
