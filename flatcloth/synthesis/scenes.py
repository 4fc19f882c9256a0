"""Meshes of PLY, STL, OFF and glTF files, read by trimesh in a worker process with limited memory.

trimesh skips what it cannot read. What a file announces is therefore compared with what was read.
"""

from __future__ import annotations

import gzip
import io
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from flatcloth.core.errors import SynthesisError
from flatcloth.core.plain_files import open_plain, read_plain
from flatcloth.core.subprocess_worker import Message, serve
from flatcloth.core.types import Progress
from flatcloth.recordings.files.text import shortened
from flatcloth.synthesis.texture_files import file_beside, read_texture, rgb_of

_MOST_BYTES = 1_000_000_000
"""Largest file. Chosen: above what the memory of the worker holds."""
_COUNTS = {
    ".ply": re.compile(rb"^element\s+face\s+(\d+)", re.MULTILINE),
    ".off": re.compile(rb"OFF\s+(?:#.*\s+)*\d+\s+(\d+)"),
}
_HEAD_BYTES = 100_000
"""Where the number of faces stands. Chosen: headers are shorter."""
_HARMLESS = re.compile(r"KHR_(materials|lights)_.*|EXT_texture_webp")
"""Extensions of glTF without which the shape and its colors are right."""
_MOVED = "KHR_texture_transform"
"""Extension without which a texture may lie elsewhere, or have another size."""


class _Beside:
    """Finds the files that a mesh names, for trimesh; ``missing`` are the names of those not there."""

    def __init__(self, mesh: Path) -> None:
        self._folder, self.missing = mesh.parent, list[str]()

    def get(self, name: str) -> bytes:
        path = file_beside(self._folder, name)
        if path is None:
            self.missing.append(name)
            raise FileNotFoundError(name)
        return read_plain(path, _MOST_BYTES)

    __getitem__ = get


def _answer(question: Mapping[str, Any], _progress: Progress) -> Message:
    """Return ``vertices`` (N, 3), ``triangles`` (T, 3), and the other content of a mesh file.

    These are ``rgb`` (N, 3) uint8, ``uv`` (T, 3, 2), and ``image`` (T,) with ``image0``, ... (H, W, 3) RGB.
    """
    import trimesh

    path, kind, with_images = Path(question["path"]), question["kind"], question["with_images"]
    with open_plain(path) as file:
        data = file.read(_MOST_BYTES)
    data = gzip.decompress(data) if data.startswith(b"\x1f\x8b") else data
    header = _gltf_header(data) if kind in (".glb", ".gltf") else {}
    needed = [name for name in header.get("extensionsRequired", ()) if not _HARMLESS.fullmatch(name)]
    if needed:
        raise SynthesisError(
            f"{path}: needs {shortened(', '.join(needed))}, which is not read. Export it again without "
            "compression (Draco, meshopt, KTX2)."
        )
    beside: Any = _Beside(path)
    try:
        scene = trimesh.load_scene(io.BytesIO(data), file_type=kind[1:], resolver=beside, process=False)
    except Exception as error:
        cause = (
            f"names {shortened(beside.missing[0])}, which is not beside it" if beside.missing else "damaged"
        )
        remedy = "Copy it there" if beside.missing else "Export the surface again"
        raise SynthesisError(f"{path}: {cause} ({shortened(str(error), 120)}). {remedy}.") from error
    materials = header.get("materials", ()) if with_images else ()
    has_textures = any("baseColorTexture" in m.get("pbrMetallicRoughness", {}) for m in materials)
    with_images = with_images and (has_textures or b"TextureFile" in data[:_HEAD_BYTES])
    parts: list[Any] = [part for part in scene.dump() if len(getattr(part, "faces", ())) > 0]
    if any(part.faces.min() < 0 or part.faces.max() >= len(part.vertices) for part in parts):
        raise SynthesisError(f"{path}: a face names a vertex that does not exist. Export the mesh again.")
    if not parts:
        raise SynthesisError(f"{path}: damaged, or has no triangles. Export the surface again.")
    arrays = _joined(parts, with_images)
    found = len(arrays["triangles"])
    count = _COUNTS[kind].search(data[:_HEAD_BYTES]) if kind in _COUNTS else None
    if count and found < int(count[1]):
        raise SynthesisError(
            f"{path}: cut off: has {found} of {int(count[1])} faces. Copy or export it again."
        )
    if with_images and beside.missing:
        read_texture(path, beside.missing[0])  # raises the error
    if with_images and "image" not in arrays:
        raise SynthesisError(
            f"{path}: its textures cannot be read. Export PNG or JPEG, or choose a pattern with --texture."
        )
    moved = with_images and _MOVED in header.get("extensionsUsed", ())
    return Message({"notes": [f"{_MOVED} of {path.name} is not applied"] if moved else []}, arrays)


def _gltf_header(data: bytes) -> Any:
    """Return the description in a glTF file, text or binary; an empty one if it is damaged."""
    length = int.from_bytes(data[12:16], "little")
    try:
        header = json.loads(data[20 : 20 + length] if data.startswith(b"glTF") else data)
    except ValueError:
        return {}
    return header if isinstance(header, dict) else {}


def _joined(parts: list[Any], with_images: bool) -> dict[str, Any]:
    """Return the arrays of some meshes of trimesh as those of one; data that a mesh lacks are neutral."""
    sizes = [len(part.vertices) for part in parts]
    triangles = [part.faces + before for part, before in zip(parts, np.cumsum([0, *sizes[:-1]]), strict=True)]
    vertices = np.concatenate([part.vertices for part in parts])
    # Files duplicate vertices along texture seams.
    extent = float(np.ptp(vertices, axis=0).max())
    grain = 1e-6 * max(extent, 1e-12) if np.isfinite(extent) else 1.0
    _, kept, place = np.unique(np.rint(vertices / grain), axis=0, return_index=True, return_inverse=True)
    welded = place.reshape(-1)[np.concatenate(triangles)].astype(np.int32)
    arrays: dict[str, Any] = {"vertices": vertices[kept], "triangles": welded}
    if all(getattr(part.visual, "uv", None) is not None for part in parts):
        arrays["uv"] = np.concatenate([part.visual.uv[part.faces] for part in parts])
        materials = [part.visual.material if with_images else None for part in parts]
        images = [getattr(m, "baseColorTexture", getattr(m, "image", None)) for m in materials]
        found = [image for image in images if image is not None]
        for number, image in enumerate(found):
            arrays[f"image{number}"] = rgb_of(image, "a texture in the file")
        numbers = [-1 if image is None else found.index(image) for image in images]
        if found:
            counts = [len(part.faces) for part in parts]
            arrays["image"] = np.repeat(np.array(numbers, dtype=np.int32), counts)
    if any(part.visual.kind in ("vertex", "face") for part in parts):
        colors = [getattr(part.visual, "to_color", lambda v=part.visual: v)() for part in parts]
        arrays["rgb"] = np.concatenate([color.vertex_colors[:, :3] for color in colors])[kept]
    return arrays


def main() -> None:
    """Answer the requests until the input ends."""
    serve(_answer, SynthesisError)
