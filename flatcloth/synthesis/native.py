"""Open3D, loaded on first use; a worker process reads PLY and GLB with it, since it may crash."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from flatcloth.core.errors import SynthesisError
from flatcloth.core.subprocess_worker import Message, serve
from flatcloth.core.types import Float64, Int32, Progress, Uint8
from flatcloth.recordings.realsense.library import load_libusb

MOST_TEXTURE_PIXELS = 8192**2
"""Largest texture. Chosen: 200 MB of memory."""


def load_open3d() -> Any:
    """Return the module ``open3d``.

    Raises
    ------
    SynthesisError
        If it is not installed, or a library it needs is missing.
    """
    try:
        load_libusb()  # Open3D links to it by name
        import open3d
    except (ImportError, OSError) as error:
        raise SynthesisError(
            f"Rendering needs Open3D, which cannot be loaded ({error}). "
            "Run: pip install 'flatcloth[synthesis]', and install the system library named here."
        ) from error
    return open3d


def read_with_open3d(path: Path) -> Message:
    """Return ``vertices`` (N, 3), ``triangles`` (T, 3), and the other content of a mesh file.

    These are ``rgb`` (N, 3) uint8, ``uv`` (T, 3, 2), and ``image`` (T,) with ``image0``, ... (H, W, 3) RGB.

    Raises
    ------
    SynthesisError
        If Open3D is missing, or the file has no triangles.
    """
    o3d = load_open3d()
    with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
        read = o3d.io.read_triangle_mesh(str(path))
    vertices, triangles = np.asarray(read.vertices).copy(), np.asarray(read.triangles, dtype=np.int32)
    if len(triangles) == 0 or len(vertices) == 0:
        raise SynthesisError(f"{path}: damaged, or has no triangles. Export the surface again.")
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        raise SynthesisError(f"{path}: a face names a vertex that does not exist. Export the mesh again.")
    arrays: dict[str, Any] = {}
    if read.has_triangle_uvs():
        arrays["uv"] = np.asarray(read.triangle_uvs).reshape(-1, 3, 2)
        arrays |= _images(path, read, len(triangles))
    rgb = np.clip(np.nan_to_num(np.asarray(read.vertex_colors)) * 255, 0, 255).astype(np.uint8)
    vertices, triangles, place = _welded(vertices, triangles)
    if read.has_vertex_colors():
        arrays["rgb"] = rgb[place]
    return Message({}, {"vertices": vertices, "triangles": triangles, **arrays})


def _images(path: Path, read: Any, count: int) -> dict[str, Any]:
    """Return the color images, and for each triangle the index of its image (-1 none)."""
    images: list[Uint8] = []
    image = np.full(count, -1, dtype=np.int32)
    materials = np.asarray(read.triangle_material_ids)
    for n, texture in enumerate(read.textures):
        pixels = np.asarray(texture)
        if texture.is_empty() or pixels.dtype != np.uint8 or pixels.ndim != 3 or pixels.shape[2] < 3:
            continue
        if pixels.shape[0] * pixels.shape[1] > MOST_TEXTURE_PIXELS:
            raise SynthesisError(
                f"{path}: its texture is {pixels.shape[1]}x{pixels.shape[0]} px. Make it smaller."
            )
        image[materials == n if len(materials) == count else slice(None)] = len(images)
        # Open3D returns the images of such a mesh upside down.
        images.append(np.ascontiguousarray(pixels[::-1, :, :3]))
    return {"image": image, **{f"image{n}": pixels for n, pixels in enumerate(images)}} if images else {}


def _welded(vertices: Float64, triangles: Int32) -> tuple[Float64, Int32, Int32]:
    """Merge vertices that a file duplicates along texture seams; also return which ones were kept."""
    extent = float(np.ptp(vertices, axis=0).max())
    grain = 1e-6 * max(extent, 1e-12) if np.isfinite(extent) else 1.0
    _, first, place = np.unique(np.rint(vertices / grain), axis=0, return_index=True, return_inverse=True)
    return vertices[first], place.reshape(-1)[triangles].astype(np.int32), first.astype(np.int32)


def _answer(question: Mapping[str, Any], _progress: Progress) -> Message:
    return read_with_open3d(Path(question["path"]))


def main() -> None:
    """Answer the requests until the input ends."""
    serve(_answer, SynthesisError)
