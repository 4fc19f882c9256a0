"""Meshes of every kind are read alike, and what cannot be read is said in one line."""

from __future__ import annotations

import gzip
import sys
from pathlib import Path

import numpy as np
import pytest
from garment_meshes import arc, write_glb, write_obj, write_ply

from flatcloth.core.errors import SynthesisError
from flatcloth.synthesis import meshes
from flatcloth.synthesis.meshes import inside_out, read_mesh
from flatcloth.synthesis.rendering import load_open3d


def volume(vertices: np.ndarray, triangles: np.ndarray) -> float:
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    return float((np.cross(a, b) * c).sum() / 6)


def test_an_obj_keeps_groups_texture_coordinates_and_the_order_of_vertices(tmp_path: Path) -> None:
    vertices, triangles, uv = arc(columns=4, rows=3)
    halves = {"front": np.arange(12), "back": np.arange(12, 24)}
    mesh = read_mesh(write_obj(tmp_path / "a.obj", vertices, triangles, uv, halves))
    assert np.allclose(mesh.vertices, vertices, atol=1e-6)
    assert (mesh.triangles == triangles).all()
    assert [mesh.group_names[g] for g in mesh.group] == ["front"] * 12 + ["back"] * 12
    assert mesh.corner_uv is not None
    assert np.allclose(mesh.corner_uv, uv[triangles], atol=1e-6)


def test_an_obj_may_have_polygons_counted_from_the_end(tmp_path: Path) -> None:
    file = tmp_path / "quad.obj"
    file.write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvn 0 0 1\nf -4//1 -3//1 -2//1 -1//1\n")
    mesh = read_mesh(file)
    assert mesh.triangles.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert mesh.corner_uv is None


def test_a_triangle_on_one_vertex_is_dropped(tmp_path: Path) -> None:
    file = tmp_path / "sliver.obj"
    file.write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\nf 1 1 2\n")
    assert read_mesh(file).triangles.tolist() == [[0, 1, 2]]


def test_what_no_triangle_uses_is_not_the_highest_point(tmp_path: Path) -> None:
    file = tmp_path / "loose.obj"
    file.write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 0 99\nf 1 2 3\n")
    mesh = read_mesh(file)
    assert len(mesh.vertices) == 4  # the numbers stay
    assert mesh.vertices[:, 2].max() == 0


def test_colors_of_vertices_come_from_obj_and_ply(tmp_path: Path) -> None:
    vertices, triangles, _ = arc(columns=2, rows=2)
    rgb = np.arange(27).reshape(9, 3) * 9
    obj = read_mesh(write_obj(tmp_path / "a.obj", vertices, triangles, rgb=rgb / 255.0))
    ply = read_mesh(write_ply(tmp_path / "a.ply", vertices, triangles, rgb))
    for mesh in (obj, ply):
        assert mesh.vertex_rgb is not None
        at = [int(np.linalg.norm(mesh.vertices - v, axis=1).argmin()) for v in vertices]
        assert np.abs(mesh.vertex_rgb[at].astype(int) - rgb).max() <= 1


def test_a_glb_is_welded_where_its_texture_tears_it(tmp_path: Path) -> None:
    vertices, triangles, uv = arc(columns=2, rows=2)
    torn = triangles.copy()
    doubled = np.concatenate([vertices, vertices])
    torn[4:] += len(vertices)
    bgr = np.zeros((2, 2, 3), np.uint8)
    bgr[0], bgr[1] = (0, 0, 255), (255, 0, 0)
    file = write_glb(tmp_path / "a.glb", doubled, torn, np.concatenate([uv, uv]), bgr)
    mesh = read_mesh(file)
    assert len(mesh.vertices) == len(vertices)
    assert mesh.corner_uv is not None
    down = np.concatenate([uv, uv])[torn]
    assert np.allclose(mesh.corner_uv, down * (1, -1) + (0, 1), atol=1e-5)  # v up
    assert mesh.images[0][0, 0].tolist() == [255, 0, 0]


def test_turned_inside_out(tmp_path: Path) -> None:
    vertices, triangles, uv = arc(columns=3, rows=2)
    mesh = read_mesh(write_obj(tmp_path / "a.obj", vertices, triangles, uv))
    turned = inside_out(mesh)
    assert volume(turned.vertices, turned.triangles) == pytest.approx(-volume(mesh.vertices, mesh.triangles))
    assert turned.corner_uv is not None
    assert np.allclose(turned.corner_uv, uv[turned.triangles], atol=1e-6)


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.dat", b"solid", r"not a mesh file\. flatcloth reads \.obj, \.ply, \.glb"),
        ("a.obj", b"v 0 0 0\n", "has no triangles"),
        ("a.obj", b"v 0 0\n", "line 1 is not valid OBJ"),
        ("a.obj", b"v 0 0 zero\n", "line 1 is not valid OBJ"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\n\nf 1 2 3\n", "line 4 is not valid OBJ"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nf 1 2\n", "line 3 is not valid OBJ"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nv 1 1 0\nf 0 1 2\n", "line 4 is not valid OBJ"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nv 1 nan 0\nf 1 2 3\n", "is not a number below"),
        ("a.obj", b"\x00\xff\xfe" * 50, "has no triangles"),
        (
            "a.obj.gz",
            gzip.compress(b"v 0 0 0\n" * 99, mtime=0)[:-9],
            r"cannot be read \(not a whole gzip file\)",
        ),
        ("a.ply", b"ply\nformat ascii 1.0\n", "damaged"),
        ("gone.obj", None, "no such file"),
    ],
)
def test_what_cannot_be_read(tmp_path: Path, name: str, content: bytes | None, said: str) -> None:
    file = tmp_path / name
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(SynthesisError, match=said) as raised:
        read_mesh(file)
    assert str(file) in str(raised.value)
    assert "\n" not in str(raised.value)


def test_open3d_that_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "open3d", None)
    with pytest.raises(SynthesisError, match="Rendering needs Open3D"):
        load_open3d()


def test_faces_without_area_count_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """They are dropped in the end, so that only reading them could take for ever."""
    monkeypatch.setattr(meshes, "_MOST_TRIANGLES", 1000)
    path = tmp_path / "degenerate.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n" + "f 1 1 1\n" * 1000)
    with pytest.raises(SynthesisError, match=r"line 1004 .*the limit is 1000 triangles: decimate"):
        read_mesh(path)
