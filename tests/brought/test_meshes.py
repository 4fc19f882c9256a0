"""Meshes as people bring them: read like the same mesh written plainly, or one true line names the cause."""

from __future__ import annotations

import gzip
import json
import re
import struct
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
from garment_meshes import arc, binary_ply_of, write_glb, write_obj, write_ply

from flatcloth.cli import main
from flatcloth.core.subprocess_worker import Worker

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

    monkeypatch.setattr("flatcloth.synthesis.meshes.Worker", reader)


def plain(folder: Path) -> str:
    """Return the text of an OBJ of the mesh, with its material library beside it."""
    head = "mtllib cloth.mtl\nusemtl linen"
    return write_obj(folder / "in.obj", VERTICES, TRIANGLES, UV, head=head).read_text()


def synthesized(mesh: Path, *options: str, out: str = "out") -> Path:
    folder = mesh.parent / out
    small = ("--size", "64", "64", "--focal", "50", "--step", "90")
    assert main(["synthesize", str(mesh), "--out", str(folder), *small, *options]) == 0
    return folder


def view(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return the color and the depth of the first view."""
    files = json.loads((folder / "recording.json").read_text())["views"][0]
    color, depth = (cv2.imread(str(folder / files[k]), cv2.IMREAD_UNCHANGED) for k in ("color", "depth"))
    return color, depth


@pytest.fixture(scope="module")
def truth(tmp_path_factory: pytest.TempPathFactory) -> tuple[np.ndarray, np.ndarray]:
    """Color and depth of the mesh with its red texture."""
    folder = tmp_path_factory.mktemp("truth")
    assert cv2.imwrite(str(folder / "red.png"), RED_BGR)
    (folder / "cloth.mtl").write_text(LINEN + "map_Kd red.png\n")
    plain(folder)
    return view(synthesized(folder / "in.obj"))


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
}


@pytest.mark.parametrize("spelling", SPELLED)
def test_an_obj_is_read_however_it_is_spelled(
    tmp_path: Path, truth: tuple[np.ndarray, np.ndarray], spelling: str
) -> None:
    assert cv2.imwrite(str(tmp_path / "red.png"), RED_BGR)
    (tmp_path / "cloth.mtl").write_text(LINEN + "map_Kd red.png\n")
    text = plain(tmp_path)
    (tmp_path / "in.obj").write_bytes(SPELLED[spelling](text))
    color, depth = view(synthesized(tmp_path / "in.obj"))
    np.testing.assert_allclose(depth, truth[1], atol=2)
    np.testing.assert_allclose(color.astype(int), truth[0], atol=3)


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
    tmp_path: Path, truth: tuple[np.ndarray, np.ndarray], reference: str, file: str, library: str, head: str
) -> None:
    from PIL import Image

    (tmp_path / file).parent.mkdir(exist_ok=True)
    Image.fromarray(RED_BGR[..., ::-1]).save(tmp_path / file)
    (tmp_path / "cloth.mtl").write_text("newmtl silk\nmap_Kd nowhere.png\n")  # not used, so not missed
    (tmp_path / library).write_text(
        LINEN + reference + "\n", encoding="utf-8-sig" if "&" in file else "cp1252"
    )
    text = plain(tmp_path)
    (tmp_path / "in.obj").write_text(text.replace("cloth.mtl", head))
    color, depth = view(synthesized(tmp_path / "in.obj"))
    np.testing.assert_array_equal(depth, truth[1])
    np.testing.assert_allclose(color.astype(int), truth[0], atol=3)


@pytest.mark.parametrize(
    "reference", ["red.png", "../red.png", "C:\\a\\red.png", "/etc/hostname", "red\0.png"]
)
def test_a_texture_that_is_not_there_is_missed_only_where_it_is_needed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], reference: str
) -> None:
    folder = tmp_path / "mesh"
    folder.mkdir()
    assert cv2.imwrite(str(tmp_path / "red.png"), RED_BGR)  # outside its folder
    assert cv2.imwrite(str(folder / "red.jpg"), RED_BGR)
    (folder / "text.png").write_text("no picture")
    (folder / "cloth.mtl").write_text(LINEN + f"map_Kd {reference}\n")
    plain(folder)
    assert main(["synthesize", str(folder / "in.obj"), "--out", str(tmp_path / "refused")]) == 2
    said = capsys.readouterr().err
    assert re.match(
        r"flatcloth: .*in\.obj: its texture .* is not a file inside its folder.*--texture\.\n$", said
    )
    assert ("there is red.jpg" in said) == ("red" in reference and "\0" not in reference)
    synthesized(folder / "in.obj", "--texture", "checker")  # the remedy works


@pytest.mark.parametrize(
    ("library", "note"),
    [
        (None, "cloth.mtl is not beside the mesh"),
        ("map_Kd -s 2 2 1 red.png", "-s 2 2 1 of cloth.mtl is not applied"),
    ],
)
def test_what_is_not_read_of_the_colors_is_noted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], library: str | None, note: str
) -> None:
    assert cv2.imwrite(str(tmp_path / "red.png"), RED_BGR)
    if library is not None:
        (tmp_path / "cloth.mtl").write_text(LINEN + library)
    plain(tmp_path)
    synthesized(tmp_path / "in.obj")
    assert f"note: {note}" in capsys.readouterr().out
    if library is None:
        mesh, out = str(tmp_path / "in.obj"), str(tmp_path / "b")
        assert main(["synthesize", mesh, "--out", out, "--texture", "mesh"]) == 2
        assert f"has no colors ({note})" in capsys.readouterr().err


def binary_ply(order: str, texture: str = "", names: str = "") -> bytes:
    return binary_ply_of(
        VERTICES, TRIANGLES, order, texture, {n: UV[:, k] for k, n in enumerate(names.split())}
    )


def of_trimesh(kind: str) -> bytes:
    made = trimesh.Trimesh(VERTICES, TRIANGLES, process=False).export(file_type=kind)
    return made if isinstance(made, bytes) else made.encode()


def glb(folder: Path) -> bytes:
    down = UV * (1, -1) + (0, 1)
    return write_glb(folder / "made.glb", VERTICES, TRIANGLES, down, RED_BGR).read_bytes()


def gltf(folder: Path) -> bytes:
    """Return a glTF whose buffer is a file of its own, named with an escaped space."""
    data = glb(folder)
    length = struct.unpack("<I", data[12:16])[0]
    content = json.loads(data[20 : 20 + length])
    (folder / "my data.bin").write_bytes(data[28 + length :])
    content["buffers"][0]["uri"] = "my%20data.bin"
    return json.dumps(content).encode()


@pytest.mark.parametrize(
    ("name", "made", "has_color"),
    [
        ("little.ply", lambda _: binary_ply("<"), False),
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
def test_other_formats_are_read(
    tmp_path: Path,
    truth: tuple[np.ndarray, np.ndarray],
    name: str,
    made: Callable[[Path], bytes],
    has_color: bool,
) -> None:
    assert cv2.imwrite(str(tmp_path / "red.png"), RED_BGR)
    (tmp_path / name).write_bytes(made(tmp_path))
    color, depth = view(synthesized(tmp_path / name, "--up", "z"))
    np.testing.assert_allclose(depth, truth[1], atol=2)
    if has_color:
        np.testing.assert_allclose(color.astype(int), truth[0], atol=3)


def requiring(extension: str) -> Callable[[Path], bytes]:
    def made(folder: Path) -> bytes:
        return json.dumps(json.loads(gltf(folder)) | {"extensionsRequired": [extension]}).encode()

    return made


def without_buffer(folder: Path) -> bytes:
    made = gltf(folder)
    (folder / "my data.bin").unlink()
    return made


def text_ply(folder: Path) -> bytes:
    return write_ply(folder / "made.ply", VERTICES, TRIANGLES).read_bytes()


@pytest.mark.parametrize(
    ("name", "made", "said"),
    [
        ("a.gltf", requiring("KHR_draco_mesh_compression"), "needs KHR_draco_.*, which is not read"),
        ("a.gltf", requiring("EXT_meshopt_compression"), "without compression"),
        ("a.gltf", without_buffer, "names my%20data.bin, which is not beside it .* Copy it there"),
        ("a.glb", lambda folder: glb(folder)[:-60], "damaged"),
        ("a.ply", lambda folder: text_ply(folder)[:-100], "cut off: has .* of 48 faces"),
        ("a.ply", lambda _: binary_ply("<")[:-100], "damaged"),
        ("a.ply", lambda folder: text_ply(folder).rstrip()[:-2] + b"99\n", "a vertex that does not exist"),
        ("a.ply", lambda _: binary_ply("<", "gone.png", "s t"), "its texture gone.png is not a file"),
        ("a.off", lambda _: of_trimesh("off")[:-100], "cut off|damaged"),
        ("a.stl", lambda _: of_trimesh("stl")[:-70], "damaged"),
        ("a.obj", lambda _: b"v 0 0 0\nv 1 0 0\nl 1 2\n", "only l. Export the surface"),
        ("a.obj", lambda _: b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 \\\n 4\n", "line 5 .*4 is not among the 3"),
        ("a.fbx", lambda _: b"Kaydara FBX Binary  \0", "is FBX. Convert it with Blender"),
        ("a.blend", lambda _: b"BLENDER-v300", "is a file of Blender. Export"),
        ("a.usdc", lambda _: b"PXR-USDC\0\0", "is USD. Convert it"),
        ("a.3mf", lambda _: b"PK\x03\x04\x14\0", "a ZIP archive. .*3MF"),
        ("a.dae", lambda _: b'<?xml version="1.0"?><COLLADA/>', "COLLADA"),
        ("a.obj", lambda _: b"version https://git-lfs.github.com/spec/v1\n", "git lfs pull"),
        ("a.3ds", lambda _: b"MM\0\0", "not a mesh file"),
    ],
)
def test_what_is_not_read_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, made: Callable[[Path], bytes], said: str
) -> None:
    (tmp_path / name).write_bytes(made(tmp_path))
    assert main(["synthesize", str(tmp_path / name), "--out", str(tmp_path / "out")]) == 2
    told = capsys.readouterr().err
    assert re.match(rf"flatcloth: .*{re.escape(name)}: .*({said}).*\n$", told), told
