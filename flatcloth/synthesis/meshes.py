"""Reading garment meshes: OBJ with its materials by this module, other formats by trimesh.

trimesh and Open3D read OBJ too, but take a file whose faces name vertices that do not exist, drop the groups,
and split the surface where the texture coordinates do; groups and surface are needed to find the panels.
"""

from __future__ import annotations

import gzip
import io
import re
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from flatcloth.core.errors import SynthesisError, os_errors_as
from flatcloth.core.plain_files import open_plain, read_plain
from flatcloth.core.subprocess_worker import Worker, reader_errors_as
from flatcloth.core.types import Float64, Int32, Uint8
from flatcloth.recordings.files.text import shortened
from flatcloth.synthesis.texture_files import file_beside, read_texture

SUFFIXES = (".obj", ".ply", ".glb", ".gltf", ".stl", ".off")
_STARTS = {b"glTF": ".glb", b"ply": ".ply", b"OFF": ".off", b"COFF": ".off"}
"""How files of some formats begin, whatever their name is."""
_NO_MESHES = {
    b"version https://git-lfs": "a pointer of Git LFS, not the file. Run: git lfs pull",
    b"PK\x03\x04": "a ZIP archive. Unpack it, or convert 3MF and USDZ with MeshLab or Blender to OBJ",
    b"<": "XML or HTML, not a mesh that is read. Convert it (COLLADA, X3D) with Blender to OBJ or GLB",
    b"Kaydara FBX": "FBX. Convert it with Blender to OBJ or GLB",
    b"BLENDER": "a file of Blender. Export OBJ or GLB there",
    b"PXR-USDC": "USD. Convert it with Blender to OBJ or GLB",
    b"#usda": "USD. Convert it with Blender to OBJ or GLB",
    b"DRACO": "a mesh packed by Draco. Export it without compression",
}
"""How files begin that users take for meshes, and what to do."""
_LARGEST_COORDINATE = 1e9
"""Chosen: larger ones overflow where they are squared in float32."""
_MOST_TRIANGLES = 500_000
"""Limit of a mesh file. Chosen: it bounds time and memory; a face of an OBJ takes up to 20 microseconds."""
_MOST_LINES = 4 * _MOST_TRIANGLES
"""Chosen: a triangle has about a face, a vertex, a texture vertex and a normal."""
_MOST_LINE_CHARACTERS = 100_000
"""Longest line. Chosen: far above what programs write."""
_COMMENT = re.compile(r"(^|\s)#.*")
_BYTE_ORDER_MARKS = {b"\xef\xbb\xbf": "utf-8-sig", b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}
_TEXTURE_OPTION = re.compile(
    r"-(?:([ost])(?:\s+[-+.\deE]+){1,3}|mm\s+\S+\s+\S+|(?:blendu|blendv|bm|boost|cc|clamp|imfchan|texres|type)\s+\S+)\s+"
)


@dataclass(frozen=True, kw_only=True)
class GarmentMesh:
    """A triangle mesh in which each place of the cloth is a single vertex.

    ``vertices`` (N, 3) in the file's unit; ``triangles`` (T, 3), counterclockwise seen from outside;
    ``group`` (T,) index into ``group_names``; ``corner_uv`` (T, 3, 2) texture coordinates, v up;
    ``vertex_rgb`` (N, 3); ``images`` RGB, with ``image`` (T,) the image of each triangle (-1 none);
    ``notes`` on what is not read of its colors, for the user.
    Data that the file does not have are None or empty.
    """

    vertices: Float64
    triangles: Int32
    group: Int32
    group_names: tuple[str, ...]
    corner_uv: Float64 | None = None
    vertex_rgb: Uint8 | None = None
    images: tuple[Uint8, ...] = ()
    image: Int32 | None = None
    notes: tuple[str, ...] = ()

    @property
    def has_colors(self) -> bool:
        """Whether the cloth need not be dyed."""
        return self.image is not None or self.vertex_rgb is not None


def suffix_of(path: Path) -> str:
    """Return the suffix of a mesh file in small letters, without that of gzip."""
    return Path(path.name.lower().removesuffix(".gz")).suffix


def read_mesh(path: Path, *, with_images: bool = True) -> GarmentMesh:
    """Read a mesh file; without ``with_images``, its textures are neither read nor missed.

    Raises
    ------
    SynthesisError
        If the file is missing, of another format, damaged, or has no triangles.
    """
    if not path.is_file():
        raise SynthesisError(f"{path}: no such file. Name a mesh file ({', '.join(SUFFIXES)}).")
    with (
        os_errors_as(SynthesisError, f"{path}: cannot be read", "Check its permissions."),
        open_plain(path) as file,
    ):
        start = file.read(32).removeprefix(b"\xef\xbb\xbf").lstrip()
    for mark, told in _NO_MESHES.items():
        if start.startswith(mark):
            raise SynthesisError(f"{path}: is {told}.")
    kind = next((k for mark, k in _STARTS.items() if start.startswith(mark)), suffix_of(path))
    if kind not in SUFFIXES:
        raise SynthesisError(
            f"{path}: not a mesh file. flatcloth reads {', '.join(SUFFIXES)}. Convert it with Blender."
        )
    mesh = _read_obj(path, with_images) if kind == ".obj" else _read_in_worker(path, kind, with_images)
    return _checked(mesh, path)


def _checked(mesh: GarmentMesh, path: Path) -> GarmentMesh:
    """Return a mesh without triangles that have two equal corners."""
    t = mesh.triangles
    kept = (t[:, 0] != t[:, 1]) & (t[:, 1] != t[:, 2]) & (t[:, 2] != t[:, 0])
    if not kept.any():
        raise SynthesisError(f"{path}: has no triangles. Export the surface, not points or lines.")
    if np.count_nonzero(kept) > _MOST_TRIANGLES:
        raise SynthesisError(
            f"{path}: {np.count_nonzero(kept)} triangles, the limit is {_MOST_TRIANGLES}. Decimate it."
        )
    for values in (mesh.vertices[t[kept]], mesh.corner_uv):
        # Also true for NaN.
        if values is not None and not np.abs(values).max() < _LARGEST_COORDINATE:
            raise SynthesisError(
                f"{path}: a coordinate is not a number below {_LARGEST_COORDINATE:g}. Export the mesh again."
            )
    # Unused vertices must not count as the highest or the farthest point.
    vertices = mesh.vertices.copy()
    vertices[np.setdiff1d(np.arange(len(vertices)), t[kept])] = vertices[t[kept][0, 0]]
    return replace(
        mesh,
        vertices=vertices,
        triangles=t[kept],
        group=mesh.group[kept],
        corner_uv=None if mesh.corner_uv is None else mesh.corner_uv[kept],
        image=None if mesh.image is None else mesh.image[kept],
    )


def inside_out(mesh: GarmentMesh) -> GarmentMesh:
    """Return the mesh with the orientation of its faces reversed."""
    return replace(
        mesh,
        triangles=np.ascontiguousarray(mesh.triangles[:, ::-1]),
        corner_uv=None if mesh.corner_uv is None else mesh.corner_uv[:, ::-1],
    )


def _read_obj(path: Path, with_images: bool) -> GarmentMesh:
    """Read an OBJ file; every error names the line."""
    vertices, texture = list[list[float]](), list[tuple[float, float]]()
    rows: list[tuple[int, ...]] = []  # of each triangle: vertices, texture vertices, group, material
    groups, materials = dict[str, int](), dict[str, int]()
    libraries, others, number, group, material = list[str](), set[str](), 1, "", ""
    try:
        for line in _lines(path):
            number, key, words = line
            if key == "v":  # its position, and its color if it has one
                numbers = [_number(word) for word in words]
                if len(numbers) < 3:
                    raise ValueError("a vertex has three numbers")
                scale = numbers[3] if len(numbers) == 4 and numbers[3] else 1.0  # homogeneous
                vertices.append([one / scale for one in numbers[: 6 if len(numbers) >= 6 else 3]])
            elif key == "vt":
                texture.append((_number(words[0]), _number(words[1]) if len(words) > 1 else 0.0))
            elif key == "f":
                if len(words) < 3:
                    raise ValueError("a face needs at least three corners")
                if len(rows) + len(words) - 2 > _MOST_TRIANGLES:  # also those without area
                    raise ValueError(f"the limit is {_MOST_TRIANGLES} triangles: decimate the mesh")
                corners = [(*word.split("/"), "")[:2] for word in words]
                at = [_index(first, len(vertices)) for first, _ in corners]
                uv = [_index(second, len(texture)) if second else -1 for _, second in corners]
                own = groups.setdefault(group, len(groups)), materials.setdefault(material, len(materials))
                rows += [
                    (*(places[n] for places in (at, uv) for n in (0, k, k + 1)), *own)
                    for k in range(1, len(corners) - 1)
                ]
            elif key in ("g", "o"):
                group = " ".join(words)
            elif key == "usemtl":
                material = " ".join(words)
            elif key == "mtllib":
                libraries.append(" ".join(words))
            else:
                others.add(key)
    except (ValueError, IndexError) as error:
        cause = f"line {number} is not valid OBJ ({shortened(str(error), 120)})"
        raise SynthesisError(f"{path}: {cause}. Export the mesh again.") from error
    surfaces = ", ".join(sorted(others & {"curv", "l", "p", "surf"}))
    if not rows and surfaces:
        raise SynthesisError(f"{path}: has no triangles, only {surfaces}. Export the surface as a mesh.")
    table = np.array(rows, dtype=np.int32).reshape(-1, 8)
    has_uv, rgb = bool(rows) and bool((table[:, 3:6] >= 0).all()), None
    if vertices and all(len(v) == 6 for v in vertices):
        level = np.array([v[3:] for v in vertices])
        rgb = np.clip(np.nan_to_num(level) * (255 if level.max() <= 1 else 1), 0, 255).astype(np.uint8)
    images, notes = _images(path, libraries, materials) if with_images and has_uv else ({}, ())
    place = np.array([list(images).index(name) if name in images else -1 for name in materials], np.int32)
    return GarmentMesh(
        vertices=np.array([v[:3] for v in vertices], dtype=np.float64).reshape(-1, 3),
        triangles=table[:, :3],
        group=table[:, 6],
        group_names=tuple(groups),
        corner_uv=np.array(texture)[table[:, 3:6]] if has_uv else None,
        vertex_rgb=rgb,
        images=tuple(images.values()),
        image=place[table[:, 7]] if images else None,
        notes=notes,
    )


def _lines(path: Path) -> Iterator[tuple[int, str, list[str]]]:
    """Yield number, keyword and words of each line, without comments; a backslash continues a line."""
    try:
        with open_plain(path) as packed:
            file = gzip.GzipFile(fileobj=packed) if packed.read(2) == b"\x1f\x8b" else packed
            packed.seek(0)
            start = file.read(3)
            file.seek(0)
            coding = (name for mark, name in _BYTE_ORDER_MARKS.items() if start.startswith(mark))
            text = io.TextIOWrapper(file, next(coding, "utf-8"), errors="replace")
            begun = ""
            for number, line in enumerate(iter(lambda: text.readline(_MOST_LINE_CHARACTERS), ""), start=1):
                if len(begun) + len(line) >= _MOST_LINE_CHARACTERS or number > _MOST_LINES:
                    limits = f"{_MOST_LINES} lines of {_MOST_LINE_CHARACTERS} characters"
                    raise SynthesisError(f"{path}: line {number}: the limit is {limits}. Decimate the mesh.")
                line = begun + _COMMENT.sub("", line).strip()
                begun = line[:-1] + " " if line.endswith("\\") else ""
                if line and not begun:
                    key, *words = line.split()
                    yield number, key, words
    except (OSError, EOFError, zlib.error) as error:
        cause = getattr(error, "strerror", None) or "not a whole gzip file"
        raise SynthesisError(f"{path}: cannot be read ({cause}). Name a mesh file.") from error


def _index(word: str, count: int) -> int:
    """Convert a number of the file (from 1; negative from the end) to an index."""
    number = int(word)
    index = number - 1 if number > 0 else count + number
    if number == 0 or not 0 <= index < count:
        raise ValueError(f"{word} is not among the {count} defined so far")
    return index


def _images(
    path: Path, libraries: list[str], materials: Iterable[str]
) -> tuple[dict[str, Uint8], tuple[str, ...]]:
    """Return the textures of the materials in use that have one, by material, and notes."""
    named: dict[str, tuple[str, Path]] = {}
    notes: list[str] = []
    for line in libraries:
        whole = file_beside(path.parent, line)  # the name of one file, or names of several
        for name in [line] if whole is not None else line.split():
            file = file_beside(path.parent, name)
            if file is None:
                notes.append(f"{shortened(line)} is not beside the mesh")
                break
            named |= {material: (name, file) for material, name in _textures_of(file, notes).items()}
    images = {name: read_texture(path, *named[name]) for name in materials if name in named}
    return images, tuple(notes)


def _textures_of(library: Path, notes: list[str]) -> dict[str, str]:
    """Return the name of each material's color texture; add to the notes what of it is not applied."""
    with os_errors_as(SynthesisError, f"{library}: cannot be read", "Check its permissions."):
        data = read_plain(library)
    coding = next((name for mark, name in _BYTE_ORDER_MARKS.items() if data.startswith(mark)), "utf-8")
    try:
        text = data.decode(coding)
    except UnicodeDecodeError:
        text = data.decode("cp1252", errors="replace")
    found, material = {}, ""
    for line in text.splitlines():
        key, rest = (*line.split(None, 1), "", "")[:2]
        if key == "newmtl":
            material = " ".join(_COMMENT.sub("", rest).split())
        elif key.lower() == "map_kd":
            name = rest.strip()
            while option := _TEXTURE_OPTION.match(name):
                name = name[option.end() :]
                if option[1] and {float(word) for word in option[0].split()[1:]} != {float(option[1] == "s")}:
                    notes.append(f"{shortened(option[0].strip())} of {library.name} is not applied")
            found[material] = name if file_beside(library.parent, name) else _COMMENT.sub("", name).strip()
    return found


def _number(word: str) -> float:
    return float(word.replace(",", "."))  # a decimal comma


def _read_in_worker(path: Path, kind: str, with_images: bool) -> GarmentMesh:
    question = {"path": str(path), "kind": kind, "with_images": with_images}
    with reader_errors_as(SynthesisError, path, "damaged", "Export the surface again."):
        answer = Worker("flatcloth.synthesis.scenes", path).ask(question)
    found = answer.arrays
    count = sum(name.startswith("image") for name in found) - 1
    return GarmentMesh(
        vertices=found["vertices"],
        triangles=found["triangles"],
        group=np.zeros(len(found["triangles"]), dtype=np.int32),
        group_names=("",),
        corner_uv=found.get("uv"),
        vertex_rgb=found.get("rgb"),
        images=tuple(found[f"image{n}"] for n in range(count)),
        notes=tuple(answer.table["notes"]),
        image=found.get("image"),
    )
