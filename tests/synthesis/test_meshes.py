"""Meshes of every kind are read alike, however they are spelled; what cannot be read is one clear line."""

import gzip
import json
import re
import struct
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
from garment_meshes import arc, binary_ply_of, write_glb, write_obj, write_ply
from PIL import Image

from flatcloth.cli import main
from flatcloth.core.errors import SynthesisError
from flatcloth.core.subprocess_worker import Worker
from flatcloth.synthesis import meshes
from flatcloth.synthesis.meshes import GarmentMesh, inside_out, read_mesh
from flatcloth.synthesis.rendering import load_open3d

VERTICES, TRIANGLES, UV = arc(columns=6, rows=4)
RED_BGR = np.full((4, 4, 3), (10, 20, 200), np.uint8)
LINEN = "newmtl linen\nKd 1 1 1\n"
_READERS: list[Worker] = []


@pytest.fixture(autouse=True)
def one_reader(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let one process read all meshes, as long as none ends it; each takes half a second to start."""

    def reader(module: str, _: Path) -> Worker:
        if not _READERS or not _READERS[-1].close.alive:
            _READERS.append(Worker(module))
        return _READERS[-1]

    monkeypatch.setattr(meshes, "Worker", reader)


def plain(folder: Path) -> str:
    """Write an OBJ of the mesh, which names a material library, and return its text."""
    head = "mtllib cloth.mtl\nusemtl linen"
    return write_obj(folder / "in.obj", VERTICES, TRIANGLES, UV, head=head).read_text()


@pytest.fixture
def red(tmp_path: Path) -> Path:
    """A folder with a red texture, and a library that names it."""
    assert cv2.imwrite(str(tmp_path / "red.png"), RED_BGR)
    (tmp_path / "cloth.mtl").write_text(LINEN + "map_Kd red.png\n")
    return tmp_path


def assert_cloth(mesh: GarmentMesh, *, textured: bool) -> None:
    """Compare a mesh with what was written, corner by corner."""
    np.testing.assert_allclose(mesh.vertices[mesh.triangles], VERTICES[TRIANGLES], atol=1e-5)
    if textured:
        assert mesh.corner_uv is not None
        np.testing.assert_allclose(mesh.corner_uv, UV[TRIANGLES], atol=1e-5)
        (image,) = mesh.images
        assert mesh.image is None or (mesh.image == 0).all()
        assert np.abs(image.astype(int) - RED_BGR[0, 0, ::-1]).max() <= 3


# --- OBJ ------------------------------------------------------------------------------------------


def homogeneous(text: str) -> str:
    def doubled(match: re.Match[str]) -> str:
        return "v " + " ".join(str(2 * float(number)) for number in match[1].split()) + " 2"

    return re.sub(r"^v (.*)$", doubled, text, flags=re.MULTILINE)


def counted_from_the_end(text: str) -> str:
    def back(match: re.Match[str]) -> str:
        return f"{int(match[1]) - len(VERTICES) - 1}/{int(match[2]) - len(VERTICES) - 1}"

    return re.sub(r"(\d+)/(\d+)", back, text)


SPELLED: dict[str, Callable[[str], bytes]] = {
    "continued": lambda t: re.sub(r"^(f \S+) ", r"\1 \\\n  ", t, flags=re.MULTILINE).encode(),
    "continued-vertices": lambda t: re.sub(r"^(v \S+) ", "\\1\\\\\r\n", t, flags=re.MULTILINE).encode(),
    "comments-behind": lambda t: t.replace("\n", " # of Rhino\n").encode(),
    "byte-order-mark": lambda t: b"\xef\xbb\xbf" + t.strip().encode(),
    "utf-16": lambda t: t.encode("utf-16"),
    "crlf": lambda t: t.replace("\n", "\r\n").encode(),
    "old-mac": lambda t: t.replace("\n", "\r").encode(),
    "decimal-commas": lambda t: (
        re.sub(r"(\d)\.(\d)", r"\1,\2", t).encode().replace(b"cloth,mtl", b"cloth.mtl")
    ),
    "exponents": lambda t: re.sub(r"0\.(\d)(\d+)", r"\1.\2e-1", t).encode(),
    "homogeneous": lambda t: homogeneous(t).encode(),
    "from-the-end": lambda t: counted_from_the_end(t).encode(),
    "normals": lambda t: (re.sub(r"(\d+/\d+)", r"\1/1", t).replace("\nv ", "\nvn 0 0 1\nv ", 1)).encode(),
    "other-elements": lambda t: (t + "l 1 2 3\np 4\ncurv 0 1 1 2\nvp 0.1 0.2\ns off\n").encode(),
    "gzip-by-content": lambda t: gzip.compress(t.encode()),
    "a-face-on-one-vertex": lambda t: (t + "f 1/1 1/1 2/2\n").encode(),
}


@pytest.mark.parametrize("spelling", SPELLED)
def test_an_obj_is_read_however_it_is_spelled(red: Path, spelling: str) -> None:
    text = plain(red)
    (red / "in.obj").write_bytes(SPELLED[spelling](text))
    assert_cloth(read_mesh(red / "in.obj"), textured=True)


def test_groups_are_told_and_polygons_and_vertices_that_no_triangle_uses_are_understood(
    tmp_path: Path,
) -> None:
    half = len(TRIANGLES) // 2
    halves = {"front": np.arange(half), "back": np.arange(half, 2 * half)}
    mesh = read_mesh(write_obj(tmp_path / "a.obj", VERTICES, TRIANGLES, UV, halves))
    assert [mesh.group_names[g] for g in mesh.group] == ["front"] * half + ["back"] * half
    file = tmp_path / "quad.obj"
    file.write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 99\nf 1 2 3 4\n")
    mesh = read_mesh(file)
    assert mesh.triangles.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert (mesh.corner_uv, len(mesh.vertices)) == (None, 5)  # the numbers stay
    assert mesh.vertices[:, 2].max() == 0  # what none uses is not the highest point


@pytest.mark.parametrize(
    ("reference", "file", "library", "head"),
    [
        ("map_Kd my red cloth.png", "my red cloth.png", "cloth.mtl", "cloth.mtl"),
        ("map_Kd -s 1 1 1 -o 0 0 -bm 0.5 my red.png", "my red.png", "cloth.mtl", "cloth.mtl"),
        ("map_Kd C:\\Users\\me\\Red.PNG", "red.png", "cloth.mtl", "cloth.mtl"),
        ("map_Kd textures\\red.png", "textures/red.png", "cloth.mtl", "cloth.mtl"),
        ("map_kd /mnt/textures/red.png", "red.png", "cloth.mtl", "cloth.mtl"),
        ("map_Kd red.tga # of Maya", "red.tga", "cloth.mtl", "cloth.mtl"),
        ("map_Kd red.bmp", "red.bmp", "my cloth.mtl", "my cloth.mtl"),
        ("map_Kd red.png", "red.png", "b.mtl", "cloth.mtl b.mtl"),
        ("map_Kd red.png", "made/red.png", "made/b.mtl", "made\\b.mtl"),
        ("map_Kd rot-grün.png", "rot-grün.png", "cloth.mtl", "cloth.mtl"),
    ],
)
def test_a_texture_is_found_beside_the_mesh(
    tmp_path: Path, reference: str, file: str, library: str, head: str
) -> None:
    (tmp_path / file).parent.mkdir(exist_ok=True)
    Image.fromarray(RED_BGR[..., ::-1]).save(tmp_path / file)
    (tmp_path / "cloth.mtl").write_text("newmtl silk\nmap_Kd nowhere.png\n")  # not used, so not missed
    (tmp_path / library).write_text(LINEN + reference + "\n", encoding="cp1252")
    text = plain(tmp_path)
    (tmp_path / "in.obj").write_text(text.replace("cloth.mtl", head))
    assert_cloth(read_mesh(tmp_path / "in.obj"), textured=True)


@pytest.mark.parametrize(
    "reference", ["red.png", "../red.png", "C:\\a\\red.png", "/etc/hostname", "red\0.png"]
)
def test_a_texture_that_is_not_there_is_missed_only_where_it_is_needed(
    tmp_path: Path, reference: str
) -> None:
    folder = tmp_path / "mesh"
    folder.mkdir()
    for file in (tmp_path / "red.png", folder / "red.jpg"):  # the first is outside its folder
        assert cv2.imwrite(str(file), RED_BGR)
    (folder / "cloth.mtl").write_text(LINEN + f"map_Kd {reference}\n")
    plain(folder)
    with pytest.raises(SynthesisError, match=r"in\.obj: its texture .* is not a file inside its") as refused:
        read_mesh(folder / "in.obj")
    said = str(refused.value)
    assert said.endswith("--texture.")
    assert "\n" not in said
    assert ("there is red.jpg" in said) == ("red" in reference and "\0" not in reference)
    assert_cloth(read_mesh(folder / "in.obj", with_images=False), textured=False)


def test_what_is_not_read_of_the_colors_is_noted(
    tmp_path: Path, red: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plain(red)
    (red / "cloth.mtl").write_text(LINEN + "map_Kd -s 2 2 1 red.png")
    mesh = str(red / "in.obj")
    small = ["--size", "64", "64", "--focal", "50", "--step", "90"]
    assert main(["synthesize", mesh, "--out", str(tmp_path / "out"), *small]) == 0
    assert "note: -s 2 2 1 of cloth.mtl is not applied" in capsys.readouterr().out
    (red / "cloth.mtl").unlink()
    assert main(["synthesize", mesh, "--out", str(tmp_path / "b"), "--texture", "mesh"]) == 2
    assert "has no colors (cloth.mtl is not beside the mesh)" in capsys.readouterr().err


# --- other formats --------------------------------------------------------------------------------


def binary_ply(order: str, texture: str = "", names: str = "") -> bytes:
    more = {name: UV[:, k] for k, name in enumerate(names.split())}
    return binary_ply_of(VERTICES, TRIANGLES, order, texture, more)


def of_trimesh(kind: str) -> bytes:
    made = trimesh.Trimesh(VERTICES, TRIANGLES, process=False).export(file_type=kind)
    return made if isinstance(made, bytes) else made.encode()


def glb(folder: Path) -> bytes:
    """Return a glb whose second half has vertices of its own, as textures tear them."""
    torn = TRIANGLES.copy()
    torn[len(torn) // 2 :] += len(VERTICES)
    vertices, uv = (np.concatenate([each, each]) for each in (VERTICES, UV))
    return write_glb(folder / "made.glb", vertices, torn, uv, RED_BGR).read_bytes()


def gltf(folder: Path) -> bytes:
    """Return a glTF whose buffer is a file of its own, named with an escaped space."""
    data = glb(folder)
    length = struct.unpack("<I", data[12:16])[0]
    content = json.loads(data[20 : 20 + length])
    (folder / "my data.bin").write_bytes(data[28 + length :])
    content["buffers"][0]["uri"] = "my%20data.bin"
    return json.dumps(content).encode()


def text_ply(folder: Path) -> bytes:
    return write_ply(folder / "made.ply", VERTICES, TRIANGLES).read_bytes()


@pytest.mark.parametrize(
    ("name", "made", "textured"),
    [
        ("text.ply", text_ply, False),
        ("big.ply", lambda _: binary_ply(">"), False),
        ("st.ply", lambda _: binary_ply("<", "red.png", "s t"), True),
        ("uv.PLY", lambda _: binary_ply(">", "RED.png", "texture_u texture_v"), True),
        ("solid.stl", lambda _: b"solid" + of_trimesh("stl")[5:], False),
        ("text.stl", lambda _: of_trimesh("stl_ascii"), False),
        ("counts.off", lambda _: of_trimesh("off").replace(b"OFF\n", b"OFF ", 1), False),
        ("a.glb", glb, True),
        ("a.gltf", gltf, True),
        ("a-glb-with-another-name.obj", glb, True),
        ("packed.ply.gz", lambda _: gzip.compress(binary_ply("<")), False),
    ],
)
def test_other_formats_are_read(red: Path, name: str, made: Callable[[Path], bytes], textured: bool) -> None:
    (red / name).write_bytes(made(red))
    mesh = read_mesh(red / name)
    assert_cloth(mesh, textured=textured)
    if "stl" not in name:
        assert len(mesh.vertices) == len(VERTICES), "what a texture tears is welded"


def test_colors_of_vertices_come_from_obj_and_ply(tmp_path: Path) -> None:
    rgb = np.arange(3 * len(VERTICES)).reshape(-1, 3) % 256
    obj = read_mesh(write_obj(tmp_path / "a.obj", VERTICES, TRIANGLES, rgb=rgb / 255.0))
    ply = read_mesh(write_ply(tmp_path / "a.ply", VERTICES, TRIANGLES, rgb))
    for mesh in (obj, ply):
        assert np.abs(mesh.vertex_rgb[mesh.triangles].astype(int) - rgb[TRIANGLES]).max() <= 1


def test_turned_inside_out(tmp_path: Path) -> None:
    mesh = read_mesh(write_obj(tmp_path / "a.obj", VERTICES, TRIANGLES, UV))
    turned = inside_out(mesh)
    assert volume(turned) == pytest.approx(-volume(mesh))
    assert turned.corner_uv is not None
    assert np.allclose(turned.corner_uv, UV[turned.triangles], atol=1e-6)


def volume(mesh: GarmentMesh) -> float:
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    return float((np.cross(a, b) * c).sum() / 6)


# --- what is not read -----------------------------------------------------------------------------


def requiring(extension: str) -> Callable[[Path], bytes]:
    def made(folder: Path) -> bytes:
        return json.dumps(json.loads(gltf(folder)) | {"extensionsRequired": [extension]}).encode()

    return made


def without_buffer(folder: Path) -> bytes:
    made = gltf(folder)
    (folder / "my data.bin").unlink()
    return made


@pytest.mark.parametrize(
    ("name", "made", "said"),
    [
        ("a.gltf", requiring("KHR_draco_mesh_compression"), "needs KHR_draco_.*, which is not read"),
        ("a.gltf", requiring("EXT_meshopt_compression"), "without compression"),
        ("a.gltf", without_buffer, "names my%20data.bin, which is not beside it .* Copy it there"),
        ("a.glb", lambda folder: glb(folder)[:-60], "damaged"),
        ("a.ply", lambda folder: text_ply(folder)[:-100], "cut off: has .* of 48 faces"),
        ("a.ply", b"ply\nformat ascii 1.0\n", "damaged"),
        ("a.ply", lambda _: binary_ply("<")[:-100], "damaged"),
        ("a.ply", lambda folder: text_ply(folder).rstrip()[:-2] + b"99\n", "a vertex that does not exist"),
        ("a.ply", lambda _: binary_ply("<", "gone.png", "s t"), "its texture gone.png is not a file"),
        ("a.off", lambda _: of_trimesh("off")[:-100], "cut off|damaged"),
        ("a.stl", lambda _: of_trimesh("stl")[:-70], "damaged"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nl 1 2\n", "only l. Export the surface"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 \\\n 4\n", "line 5 .*4 is not among the 3"),
        ("a.obj", b"v 0 0 0\n", "has no triangles"),
        ("a.obj", b"v 0 0\n", "line 1 is not valid OBJ"),
        ("a.obj", b"v 0 0 zero\n", "line 1 is not valid OBJ"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\n\nf 1 2 3\n", "line 4 is not valid OBJ"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nf 1 2\n", "line 3 is not valid OBJ"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nv 1 1 0\nf 0 1 2\n", "line 4 is not valid OBJ"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nv 1 nan 0\nf 1 2 3\n", "is not a number below"),
        ("a.obj", b"\x00\xff\xfe" * 50, "has no triangles"),
        ("a.obj.gz", gzip.compress(b"v 0 0 0\n" * 99, mtime=0)[:-9], r"read \(not a whole gzip file\)"),
        ("a.fbx", b"Kaydara FBX Binary  \0", "is FBX. Convert it with Blender"),
        ("a.blend", b"BLENDER-v300", "is a file of Blender. Export"),
        ("a.usdc", b"PXR-USDC\0\0", "is USD. Convert it"),
        ("a.3mf", b"PK\x03\x04\x14\0", "a ZIP archive. .*3MF"),
        ("a.dae", b'<?xml version="1.0"?><COLLADA/>', "COLLADA"),
        ("a.obj", b"version https://git-lfs.github.com/spec/v1\n", "git lfs pull"),
        ("a.3ds", b"MM\0\0", r"not a mesh file\. flatcloth reads \.obj, \.ply, \.glb"),
        ("gone.obj", None, "no such file"),
    ],
)
def test_what_is_not_read_is_named(
    tmp_path: Path, name: str, made: Callable[[Path], bytes] | bytes | None, said: str
) -> None:
    if made is not None:
        (tmp_path / name).write_bytes(made if isinstance(made, bytes) else made(tmp_path))
    with pytest.raises(SynthesisError, match=said) as refused:
        read_mesh(tmp_path / name)
    assert str(tmp_path / name) in str(refused.value)
    assert "\n" not in str(refused.value)


def test_faces_without_area_count_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """They are dropped in the end, so that only reading them could take for ever."""
    monkeypatch.setattr(meshes, "_MOST_TRIANGLES", 1000)
    path = tmp_path / "degenerate.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n" + "f 1 1 1\n" * 1000)
    with pytest.raises(SynthesisError, match=r"line 1004 .*the limit is 1000 triangles: decimate"):
        read_mesh(path)


def test_open3d_that_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "open3d", None)
    with pytest.raises(SynthesisError, match=r"needs Open3D, .* not installed. Run: pip install 'flatcloth"):
        load_open3d()
