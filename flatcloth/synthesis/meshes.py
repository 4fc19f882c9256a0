"""Reading garment meshes: OBJ (also gzipped) by this module, PLY and GLB by Open3D.

OBJ has its own reader because Open3D's drops the groups and splits the surface where the texture
coordinates do; both are needed to find the panels.
"""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from flatcloth.core.errors import RecordingError, SynthesisError
from flatcloth.core.plain_files import open_plain, read_plain
from flatcloth.core.subprocess_worker import Worker, reader_errors_as
from flatcloth.core.types import Float64, Int32, Uint8
from flatcloth.recordings.files.images import decode_color, read_header
from flatcloth.recordings.files.text import shortened
from flatcloth.synthesis.native import MOST_TEXTURE_PIXELS

SUFFIXES = (".obj", ".ply", ".glb")
_MOST_TRIANGLES = 500_000
"""Limits of a mesh file. Chosen: they bound time and memory; a face of an OBJ takes up to 20 microseconds."""
_MOST_LINES = 4 * _MOST_TRIANGLES
"""See ``_MOST_TRIANGLES``: a triangle has about a face, a vertex, a texture vertex and a normal."""
_MOST_LINE_BYTES = 100_000
"""See ``_MOST_TRIANGLES``."""
_LARGEST_COORDINATE = 1e9
"""See ``_MOST_TRIANGLES``: larger ones overflow where they are squared in float32."""


@dataclass(frozen=True, kw_only=True)
class GarmentMesh:
    """A triangle mesh in which each place of the cloth is a single vertex.

    ``vertices`` (N, 3) in the file's unit; ``triangles`` (T, 3), counterclockwise seen from outside;
    ``group`` (T,) index into ``group_names``; ``corner_uv`` (T, 3, 2) texture coordinates, v up;
    ``vertex_rgb`` (N, 3); ``images`` RGB, with ``image`` (T,) the image of each triangle (-1 none).
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


def read_mesh(path: Path) -> GarmentMesh:
    """Read a mesh file.

    Raises
    ------
    SynthesisError
        If the file is missing, of another format, damaged, or has no triangles.
    """
    suffix = path.suffix.lower()
    if path.name.lower().endswith(".obj.gz"):
        suffix = ".obj"
    if suffix not in SUFFIXES:
        raise SynthesisError(f"{path}: not a mesh file. flatcloth reads {', '.join(SUFFIXES)}.")
    if not path.is_file():
        raise SynthesisError(f"{path}: no such file. Name a mesh file ({', '.join(SUFFIXES)}).")
    mesh = _ObjReader(path).mesh() if suffix == ".obj" else _read_in_worker(path)
    return _checked(mesh, path)


def _checked(mesh: GarmentMesh, path: Path) -> GarmentMesh:
    mesh = _without_slivers(mesh)
    if len(mesh.triangles) == 0:
        raise SynthesisError(f"{path}: has no triangles. Export the surface, not points or lines.")
    if len(mesh.triangles) > _MOST_TRIANGLES:
        raise SynthesisError(
            f"{path}: {len(mesh.triangles)} triangles, the limit is {_MOST_TRIANGLES}. Decimate it."
        )
    if mesh.triangles.min() < 0 or mesh.triangles.max() >= len(mesh.vertices):
        raise SynthesisError(f"{path}: a face names a vertex that does not exist. Export the mesh again.")
    used = mesh.vertices[mesh.triangles]
    for values in (used, mesh.corner_uv):
        # Also true for NaN.
        if values is not None and not np.abs(values).max() < _LARGEST_COORDINATE:
            raise SynthesisError(
                f"{path}: a coordinate is not a number below {_LARGEST_COORDINATE:g}. Export the mesh again."
            )
    # Unused vertices must not count as the highest or the farthest point.
    vertices = mesh.vertices.copy()
    vertices[np.setdiff1d(np.arange(len(vertices)), mesh.triangles)] = vertices[mesh.triangles[0, 0]]
    return replace(mesh, vertices=vertices)


def inside_out(mesh: GarmentMesh) -> GarmentMesh:
    """Return the mesh with the orientation of its faces reversed."""
    return replace(
        mesh,
        triangles=np.ascontiguousarray(mesh.triangles[:, ::-1]),
        corner_uv=None if mesh.corner_uv is None else mesh.corner_uv[:, ::-1],
    )


def _without_slivers(mesh: GarmentMesh) -> GarmentMesh:
    """Drop triangles with two equal corners."""
    t = mesh.triangles
    kept = (t[:, 0] != t[:, 1]) & (t[:, 1] != t[:, 2]) & (t[:, 2] != t[:, 0])
    return replace(
        mesh,
        triangles=t[kept],
        group=mesh.group[kept],
        corner_uv=None if mesh.corner_uv is None else mesh.corner_uv[kept],
        image=None if mesh.image is None else mesh.image[kept],
    )


class _ObjReader:
    """Reads one OBJ file; every error names the line."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._vertices: list[tuple[float, ...]] = []
        self._texture: list[tuple[float, ...]] = []
        self._triangles: list[tuple[int, int, int]] = []
        self._corners: list[tuple[int, int, int]] = []
        self._groups: dict[str, int] = {}
        self._group: list[int] = []
        self._materials: dict[str, int] = {}
        self._material: list[int] = []
        self._libraries: list[str] = []

    def mesh(self) -> GarmentMesh:
        group, material, number = "", "", 0
        try:
            for key, words in self._lines():
                number += 1
                if key == "v":
                    self._vertices.append(tuple(map(float, words[:6])))
                    if len(words) < 3:
                        raise ValueError("a vertex has three numbers")
                elif key == "vt":
                    self._texture.append((float(words[0]), float(words[1])))
                elif key == "f":
                    self._face(words, group, material)
                elif key in ("g", "o"):
                    group = " ".join(words)
                elif key == "usemtl":
                    material = " ".join(words)
                elif key == "mtllib":
                    self._libraries.append(" ".join(words))
        except (ValueError, IndexError) as error:
            raise SynthesisError(
                f"{self._path}: line {max(number, 1)} is not valid OBJ ({shortened(str(error), 120)}). "
                "Export the mesh again."
            ) from error
        return self._assembled()

    def _lines(self) -> Iterator[tuple[str, list[str]]]:
        try:
            with open_plain(self._path) as packed:
                file = gzip.GzipFile(fileobj=packed) if self._path.suffix.lower() == ".gz" else packed
                for number, line in enumerate(iter(lambda: file.readline(_MOST_LINE_BYTES), b"")):
                    if len(line) == _MOST_LINE_BYTES:
                        raise ValueError(f"the line is longer than {_MOST_LINE_BYTES} characters")
                    if number == _MOST_LINES:
                        raise ValueError(f"the limit is {_MOST_LINES} lines: decimate the mesh")
                    key, *words = line.decode("utf-8", errors="replace").split() or ("",)
                    yield key, words
        except (OSError, EOFError, zlib.error) as error:
            cause = getattr(error, "strerror", None) or "not a whole gzip file"
            raise SynthesisError(f"{self._path}: cannot be read ({cause}). Name a mesh file.") from error

    def _face(self, words: list[str], group: str, material: str) -> None:
        corners = [word.split("/") for word in words]
        if len(corners) < 3:
            raise ValueError("a face needs at least three corners")
        points = [self._index(c[0], len(self._vertices)) for c in corners]
        textures = [self._index(c[1], len(self._texture)) if len(c) > 1 and c[1] else -1 for c in corners]
        if len(self._triangles) + len(corners) - 2 > _MOST_TRIANGLES:  # also those without area
            raise ValueError(f"the limit is {_MOST_TRIANGLES} triangles: decimate the mesh")
        for k in range(1, len(corners) - 1):
            self._triangles.append((points[0], points[k], points[k + 1]))
            self._corners.append((textures[0], textures[k], textures[k + 1]))
            self._group.append(self._groups.setdefault(group, len(self._groups)))
            self._material.append(self._materials.setdefault(material, len(self._materials)))

    @staticmethod
    def _index(word: str, count: int) -> int:
        """Convert a number of the file (from 1; negative from the end) to an index."""
        number = int(word)
        index = number - 1 if number > 0 else count + number
        if number == 0 or not 0 <= index < count:
            raise ValueError(f"{word} is not among the {count} defined so far")
        return index

    def _assembled(self) -> GarmentMesh:
        corners = np.array(self._corners, dtype=np.int32).reshape(-1, 3)
        has_uv = len(corners) > 0 and bool((corners >= 0).all())
        rgb = None
        if self._vertices and all(len(v) == 6 for v in self._vertices):
            level = np.array([v[3:] for v in self._vertices])
            rgb = np.clip(np.nan_to_num(level) * (255 if level.max() <= 1 else 1), 0, 255).astype(np.uint8)
        images, image_of_material = self._images()
        return GarmentMesh(
            vertices=np.array([v[:3] for v in self._vertices], dtype=np.float64).reshape(-1, 3),
            triangles=np.array(self._triangles, dtype=np.int32).reshape(-1, 3),
            group=np.array(self._group, dtype=np.int32),
            group_names=tuple(self._groups),
            corner_uv=np.array(self._texture)[corners] if has_uv else None,
            vertex_rgb=rgb,
            images=images,
            image=image_of_material[self._material] if images and has_uv else None,
        )

    def _images(self) -> tuple[tuple[Uint8, ...], Int32]:
        """Read the color images of the materials in use; -1 for a material without an image."""
        files: dict[str, Path] = {}
        folder, name = self._path.parent.resolve(), ""
        for library in self._libraries:
            for key, *words in _words_of(_inside(folder, library, self._path)):
                if key == "newmtl":
                    name = " ".join(words)
                elif key == "map_Kd" and words:
                    files[name] = _inside(folder, words[-1], self._path)
        images: list[Uint8] = []
        place = np.full(max(len(self._materials), 1), -1, dtype=np.int32)
        for name, index in self._materials.items():
            if name in files:
                place[index] = len(images)
                images.append(_texture(files[name]))
        return tuple(images), place


def _words_of(path: Path) -> list[list[str]]:
    try:
        text = read_plain(path).decode("utf-8", errors="replace")
    except OSError:
        return []  # without a material library only the colors are missing
    return [line.split() for line in text.splitlines() if line.split()]


def _inside(folder: Path, name: str, mesh: Path) -> Path:
    try:
        path = (folder / name).resolve()
    except (OSError, RuntimeError, ValueError):  # a loop of links, or not a valid name
        path = None
    if path is None or not path.is_relative_to(folder) or not name.isprintable():
        raise SynthesisError(
            f"{mesh}: {shortened(name)} is not a file inside its folder. Copy the file into that folder."
        )
    return path


def _texture(path: Path) -> Uint8:
    try:
        header = read_header(path)
        if header.width * header.height > MOST_TEXTURE_PIXELS:
            raise RecordingError(f"{path}: {header.width}x{header.height} px. Make it smaller.")
        return decode_color(path)
    except RecordingError as error:
        raise SynthesisError(
            f"{error} Correct this texture, or choose a generated pattern with --texture."
        ) from error


def _read_in_worker(path: Path) -> GarmentMesh:
    with reader_errors_as(SynthesisError, path, "damaged", "Export the surface again."):
        found = Worker("flatcloth.synthesis.native", path).ask({"path": str(path)}).arrays
    count = sum(name.startswith("image") for name in found) - 1
    return GarmentMesh(
        vertices=found["vertices"],
        triangles=found["triangles"],
        group=np.zeros(len(found["triangles"]), dtype=np.int32),
        group_names=("",),
        corner_uv=found.get("uv"),
        vertex_rgb=found.get("rgb"),
        images=tuple(found[f"image{n}"] for n in range(count)),
        image=found.get("image"),
    )
