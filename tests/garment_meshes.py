"""Small garments with closed-form places on the plane, and the files they come in."""

from pathlib import Path

import numpy as np
import trimesh
from PIL import Image
from trimesh.visual import TextureVisuals

RADIUS_M, HEIGHT_M = 0.10, 0.30


def arc(
    span_deg: float = 160.0, columns: int = 24, rows: int = 12, start_deg: float | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A sheet bent about the z axis, its outer face outwards, facing +x; z up, its top at 0.

    Returns vertices (N, 3), triangles (T, 3) and the places (N, 2) of the vertices when flat, in
    metres: u to the right as seen from outside, v up.
    """
    first = -span_deg / 2 if start_deg is None else start_deg
    angle = np.radians(first + span_deg * np.arange(columns + 1) / columns)
    height = -HEIGHT_M * np.arange(rows + 1) / rows
    a, z = (x.ravel() for x in np.meshgrid(angle, height))
    vertices = np.stack([RADIUS_M * np.cos(a), RADIUS_M * np.sin(a), z], axis=1)
    i = np.arange((rows + 1) * (columns + 1)).reshape(rows + 1, columns + 1)
    upper = np.stack([i[:-1, :-1], i[1:, :-1], i[1:, 1:]], axis=-1).reshape(-1, 3)
    lower = np.stack([i[:-1, :-1], i[1:, 1:], i[:-1, 1:]], axis=-1).reshape(-1, 3)
    # Seen from +x, the angle grows to the right: y is to the right there.
    return vertices, np.concatenate([upper, lower]), np.stack([RADIUS_M * a, z], axis=1)


def tube(columns: int = 36, rows: int = 10) -> tuple[np.ndarray, np.ndarray]:
    """A closed ring of cloth, open above and below: vertices and triangles."""
    vertices, triangles, _ = arc(360.0, columns, rows)
    last = np.arange(len(vertices)) % (columns + 1) == columns
    place = np.where(last, np.arange(len(vertices)) - columns, np.arange(len(vertices)))
    kept, triangles = np.unique(place[triangles], return_inverse=True)
    return vertices[kept], triangles.reshape(-1, 3)


def write_obj(
    path: Path,
    vertices: np.ndarray,
    triangles: np.ndarray,
    uv: np.ndarray | None = None,
    groups: dict[str, np.ndarray] | None = None,
    rgb: np.ndarray | None = None,
    head: str = "",
) -> Path:
    """Write an OBJ; ``uv`` belongs to the vertices, ``groups`` holds triangle numbers by name."""
    colors = np.zeros((len(vertices), 0)) if rgb is None else rgb
    lines = [
        head,
        *("v " + " ".join(f"{x:.6f}" for x in (*v, *c)) for v, c in zip(vertices, colors, strict=True)),
    ]
    lines += [] if uv is None else [f"vt {u:.6f} {v:.6f}" for u, v in uv]
    for name, members in (groups or {"": np.arange(len(triangles))}).items():
        lines.append(f"g {name}")
        lines += [
            "f " + " ".join(f"{k}/{k}" if uv is not None else f"{k}" for k in t)
            for t in triangles[members] + 1
        ]
    path.write_text("\n".join(lines) + "\n")
    return path


def write_ply(path: Path, vertices: np.ndarray, triangles: np.ndarray, rgb: np.ndarray | None = None) -> Path:
    """Write a text PLY, with colors 0 to 255 of the vertices."""
    color = [] if rgb is None else [f"property uchar {c}" for c in ("red", "green", "blue")]
    head = ["ply", "format ascii 1.0", f"element vertex {len(vertices)}"]
    head += [f"property float {c}" for c in "xyz"] + color
    head += [f"element face {len(triangles)}", "property list uchar int vertex_indices", "end_header"]
    colors = np.zeros((len(vertices), 0), dtype=int) if rgb is None else rgb
    body = [" ".join(map(str, (*v, *c))) for v, c in zip(vertices, colors, strict=True)]
    body += ["3 " + " ".join(map(str, t)) for t in triangles]
    path.write_text("\n".join(head + body) + "\n")
    return path


def binary_ply_of(
    vertices: np.ndarray,
    triangles: np.ndarray,
    order: str = "<",
    texture: str = "",
    more: dict[str, np.ndarray] | None = None,
) -> bytes:
    """Return a binary PLY of a byte order, with more properties of its vertices, and a texture's name."""
    fields = dict(zip("xyz", vertices.T, strict=True)) | (more or {})
    faces = np.zeros(len(triangles), dtype=[("n", "u1"), ("v", f"{order}i4", 3)])
    faces["n"], faces["v"] = 3, triangles
    head = f"ply\nformat binary_{'big' if order == '>' else 'little'}_endian 1.0\n"
    head += f"comment TextureFile {texture}\n" if texture else ""
    head += f"element vertex {len(vertices)}\n" + "".join(f"property float {name}\n" for name in fields)
    head += f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n"
    return (
        head.encode() + np.column_stack([*fields.values()]).astype(f"{order}f4").tobytes() + faces.tobytes()
    )


def write_glb(
    path: Path, vertices: np.ndarray, triangles: np.ndarray, uv: np.ndarray, bgr: np.ndarray
) -> Path:
    """Write a binary glTF with one textured mesh; ``uv`` with v up, glTF has it down."""
    visual = TextureVisuals(uv=uv, image=Image.fromarray(bgr[..., ::-1]))
    trimesh.Trimesh(vertices, triangles, visual=visual, process=False).export(path)
    return path
