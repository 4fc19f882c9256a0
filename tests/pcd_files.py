"""Organised point clouds as PCD files, written by the book."""

import struct
from pathlib import Path

import numpy as np

from flatcloth.core.types import Intrinsics

CAMERA = Intrinsics(width=64, height=48, fx=60.0, fy=61.0, cx=30.5, cy=24.0)


def cloud_points(
    lens: tuple[float, ...] = (0.0,) * 5, size: tuple[int, int] = (48, 64), focal_px: float | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Points (H, W, 3) of a slanted plane as a camera's pixels see it, a corner missing; and colors."""
    height, width = size
    rows, cols = np.mgrid[0:height, 0:width].astype(np.float64)
    if focal_px is None:
        seen_x, seen_y = (cols - CAMERA.cx) / CAMERA.fx, (rows - CAMERA.cy) / CAMERA.fy
    else:
        seen_x, seen_y = (cols - 7.5) / focal_px, (rows - 5.5) / focal_px
    k1, k2, p1, p2, k3 = lens
    x, y = seen_x, seen_y
    for _ in range(60):  # the ray that the lens bends to the pixel, by iteration
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        x, y = (
            (seen_x - 2 * p1 * x * y - p2 * (r2 + 2 * x * x)) / radial,
            (seen_y - p1 * (r2 + 2 * y * y) - 2 * p2 * x * y) / radial,
        )
    z = 0.8 / (1 - 0.3 * x + 0.1 * y)
    points = np.stack([x * z, y * z, z], axis=-1)
    points[:3, :4] = np.nan
    colors = np.stack([cols % 256, rows % 256, (rows + cols) % 256], axis=-1).astype(np.uint8)
    return points, colors


def write_pcd(
    path: Path,
    points: np.ndarray,
    colors: np.ndarray | None,
    *,
    layout: str = "binary",
    rgb_type: str = "F",
) -> Path:
    height, width = points.shape[:2]
    fields: list[tuple[str, str, np.ndarray]] = [
        (name, "F", points[..., n].ravel().astype("<f4")) for n, name in enumerate("xyz")
    ]
    if colors is not None:
        red, green, blue = (colors[..., n].ravel().astype("<u4") for n in range(3))
        packed = (red << 16) | (green << 8) | blue
        fields.append(("rgb", rgb_type, packed if rgb_type == "U" else packed.view("<f4")))
    header = [
        "# .PCD v0.7 - Point Cloud Data file format",
        "VERSION 0.7",
        "FIELDS " + " ".join(name for name, _, _ in fields),
        "SIZE " + " ".join("4" for _ in fields),
        "TYPE " + " ".join(kind for _, kind, _ in fields),
        "COUNT " + " ".join("1" for _ in fields),
        f"WIDTH {width}",
        f"HEIGHT {height}",
        "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {width * height}",
        f"DATA {layout}",
    ]
    start = ("\n".join(header) + "\n").encode()
    if layout == "ascii":
        rows = zip(*(values.tolist() for _, _, values in fields), strict=True)
        data = "\n".join(" ".join(repr(v) for v in row) for row in rows).encode() + b"\n"
    elif layout == "binary":
        data = np.stack([values.view("<u4") for _, _, values in fields], axis=-1).tobytes()
    else:
        plain = b"".join(values.tobytes() for _, _, values in fields)
        packed_bytes = packed_lzf(plain)
        data = struct.pack("<II", len(packed_bytes), len(plain)) + packed_bytes
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(start + data)
    return path


def packed_lzf(data: bytes) -> bytes:
    """LZF of literals only."""
    parts = [data[place : place + 32] for place in range(0, len(data), 32)]
    return b"".join(bytes([len(part) - 1]) + part for part in parts)
