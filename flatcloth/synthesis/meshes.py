"""Garment meshes from files: OBJ is read here, PLY and GLB by Open3D.

OBJ has a reader of its own because Open3D's loses the groups and tears the surface apart where
texture coordinates do, and both say what the panels are.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from flatcloth.synthesis.errors import SynthesisError
from flatcloth.synthesis.native import load_open3d
from flatcloth.types import Float64, Int32, Uint8

SUFFIXES = (".obj", ".ply", ".glb")
_MOST_TRIANGLES = 2_000_000


@dataclass(frozen=True, kw_only=True)
class GarmentMesh:
    """A triangle mesh as its file has it, the same place of the cloth being one vertex.

    ``vertices`` (N, 3) in the file's unit; ``triangles`` (T, 3), counterclockwise seen from outside;
    ``group`` (T,) index into ``group_names``; ``corner_uv`` (T, 3, 2) texture coordinates, v up;
    ``vertex_rgb`` (N, 3); ``images`` RGB, with ``image`` (T,) which of them colors a triangle (-1
    none). What a file does not have is None or empty.
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
        If the file is missing, of another kind, damaged, or has no triangles.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise SynthesisError(f"{path}: not a mesh file. flatcloth reads {', '.join(SUFFIXES)}.")
    if not path.is_file():
        raise SynthesisError(f"{path}: no such file. Name a mesh file ({', '.join(SUFFIXES)}).")
    mesh = _ObjReader(path).mesh() if suffix == ".obj" else _read_with_open3d(path)
    return _checked(mesh, path)


def _checked(mesh: GarmentMesh, path: Path) -> GarmentMesh:
    mesh = _without_slivers(mesh)
    if len(mesh.triangles) == 0:
        raise SynthesisError(f"{path}: has no triangles. Export the surface, not points or lines.")
    if len(mesh.triangles) > _MOST_TRIANGLES:
        raise SynthesisError(
            f"{path}: {len(mesh.triangles)} triangles, at most {_MOST_TRIANGLES} are read. Decimate it."
        )
    if mesh.triangles.min() < 0 or mesh.triangles.max() >= len(mesh.vertices):
        raise SynthesisError(f"{path}: a face names a vertex that does not exist. Export the mesh again.")
    corner_uv = mesh.corner_uv
    used = mesh.vertices[mesh.triangles]
    if not np.isfinite(used).all() or (corner_uv is not None and not np.isfinite(corner_uv).all()):
        raise SynthesisError(f"{path}: a coordinate is not a finite number. Export the mesh again.")
    # What no triangle uses must not count as the highest or the farthest point.
    vertices = mesh.vertices.copy()
    vertices[np.setdiff1d(np.arange(len(vertices)), mesh.triangles)] = vertices[mesh.triangles[0, 0]]
    return replace(mesh, vertices=vertices)


def inside_out(mesh: GarmentMesh) -> GarmentMesh:
    """Return the mesh with its faces turned over."""
    return replace(
        mesh,
        triangles=np.ascontiguousarray(mesh.triangles[:, ::-1]),
        corner_uv=None if mesh.corner_uv is None else mesh.corner_uv[:, ::-1],
    )


def _without_slivers(mesh: GarmentMesh) -> GarmentMesh:
    """Drop triangles of which two corners are one vertex."""
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
    """Reads one OBJ file; every complaint names the line."""

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
        group, material = "", ""
        for number, (key, words) in enumerate(self._lines(), start=1):
            try:
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
                    f"{self._path}: line {number} is not valid OBJ ({error}). Export the mesh again."
                ) from error
        return self._assembled()

    def _lines(self) -> Iterator[tuple[str, list[str]]]:
        try:
            with self._path.open(encoding="utf-8", errors="replace") as file:
                for line in file:
                    key, *words = line.split() or ("",)
                    yield key, words
        except OSError as error:
            raise SynthesisError(f"{self._path}: cannot be read ({error.strerror}).") from error

    def _face(self, words: list[str], group: str, material: str) -> None:
        corners = [word.split("/") for word in words]
        if len(corners) < 3:
            raise ValueError("a face has three corners or more")
        points = [self._index(c[0], len(self._vertices)) for c in corners]
        textures = [self._index(c[1], len(self._texture)) if len(c) > 1 and c[1] else -1 for c in corners]
        for k in range(1, len(corners) - 1):
            self._triangles.append((points[0], points[k], points[k + 1]))
            self._corners.append((textures[0], textures[k], textures[k + 1]))
            self._group.append(self._groups.setdefault(group, len(self._groups)))
            self._material.append(self._materials.setdefault(material, len(self._materials)))

    @staticmethod
    def _index(word: str, count: int) -> int:
        """Turn a number of the file (from 1; negative from the end) into an index."""
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
            rgb = np.clip(level * (255 if level.max() <= 1 else 1), 0, 255).astype(np.uint8)
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
        """Read the color images of the materials in use; -1 for a material without one."""
        files: dict[str, Path] = {}
        folder = self._path.parent.resolve()
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
                bgr = cv2.imread(str(files[name]), cv2.IMREAD_COLOR)
                if bgr is None:
                    raise SynthesisError(
                        f"{files[name]}: the texture cannot be read. Put it beside the mesh, "
                        "or choose a generated pattern with --texture."
                    )
                place[index] = len(images)
                images.append(np.ascontiguousarray(bgr[..., ::-1]).astype(np.uint8))
        return tuple(images), place


def _words_of(path: Path) -> list[list[str]]:
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return []  # a missing material library only costs the colors
    return [line.split() for line in text.splitlines() if line.split()]


def _inside(folder: Path, name: str, mesh: Path) -> Path:
    path = (folder / name).resolve()
    if not path.is_relative_to(folder):
        raise SynthesisError(f"{mesh}: {name!r} leads outside its folder. Copy the file beside the mesh.")
    return path


def _read_with_open3d(path: Path) -> GarmentMesh:
    o3d = load_open3d()
    with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
        read = o3d.io.read_triangle_mesh(str(path))
    vertices, triangles = np.asarray(read.vertices).copy(), np.asarray(read.triangles, dtype=np.int32)
    if len(triangles) == 0:
        raise SynthesisError(f"{path}: damaged, or has no triangles. Export the surface again.")
    rgb = None
    if read.has_vertex_colors():
        rgb = np.clip(np.asarray(read.vertex_colors) * 255, 0, 255).astype(np.uint8)
    uv = np.asarray(read.triangle_uvs).reshape(-1, 3, 2).copy() if read.has_triangle_uvs() else None
    images: list[Uint8] = []
    image = np.full(len(triangles), -1, dtype=np.int32)
    materials = np.asarray(read.triangle_material_ids)
    for n, texture in enumerate(read.textures):
        pixels = np.asarray(texture)
        if not texture.is_empty() and pixels.dtype == np.uint8 and pixels.ndim == 3:
            image[materials == n if len(materials) == len(triangles) else slice(None)] = len(images)
            # Open3D turns the images of such a mesh upside down.
            images.append(np.ascontiguousarray(pixels[::-1, :, :3]))
    vertices, triangles, rgb = _welded(vertices, triangles, rgb)
    return GarmentMesh(
        vertices=vertices,
        triangles=triangles,
        group=np.zeros(len(triangles), dtype=np.int32),
        group_names=("",),
        corner_uv=uv,
        vertex_rgb=rgb,
        images=tuple(images) if uv is not None else (),
        image=image if images and uv is not None else None,
    )


def _welded(vertices: Float64, triangles: Int32, rgb: Uint8 | None) -> tuple[Float64, Int32, Uint8 | None]:
    """Make vertices one that a file doubles along texture seams."""
    grain = 1e-6 * max(float(np.ptp(vertices, axis=0).max()), 1e-12)
    _, first, place = np.unique(np.rint(vertices / grain), axis=0, return_index=True, return_inverse=True)
    merged = place.reshape(-1)[triangles].astype(np.int32)
    return vertices[first], merged, None if rgb is None else rgb[first]
