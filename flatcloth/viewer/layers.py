"""The pictures of a flattened view: its layers as PNG, and their legends with units."""

from __future__ import annotations

from typing import Any

import numpy as np

from flatcloth.errors import FlatclothError
from flatcloth.geometry import height_m
from flatcloth.types import FlattenedView, RotationAxis, Uint8
from flatcloth.viewer.colormaps import (
    apply_table,
    diverging_table,
    height_table,
    view_colors,
)

LAYERS = ("color", "height", "z_angle", "source")
"""Names of the layers, in the order of their keys 1 to 4."""

Z_ANGLE_SPAN_DEG = 90.0
"""The colours of the Z-angle end here, so that they mean the same in every view."""


def rgba(view: FlattenedView, layer: str, axis: RotationAxis, n_views: int) -> Uint8:
    """Return a layer as an image (H, W, 4) uint8; transparent where the view has no cloth.

    Raises
    ------
    FlatclothError
        If there is no such layer.
    """
    image = np.zeros((*view.shape, 4), dtype=np.uint8)
    image[..., 3] = np.where(view.valid, 255, 0)
    valid = view.valid
    match layer:
        case "color":
            image[valid, :3] = view.rgb[valid]
        case "height":
            low, high = height_range_m(view, axis)
            image[valid, :3] = apply_table(height_table(), height_m(view.xyz_m[valid], axis), low, high)
        case "z_angle":
            angles = view.z_angle_deg[valid]
            image[valid, :3] = apply_table(diverging_table(), angles, -Z_ANGLE_SPAN_DEG, Z_ANGLE_SPAN_DEG)
        case "source":
            index = np.clip(view.view_index[valid], 0, n_views - 1)
            image[valid, :3] = view_colors(n_views)[index]
        case _:
            raise FlatclothError(f"There is no layer {layer!r:.40}; known are {', '.join(LAYERS)}.")
    return image


def png(image: Uint8) -> bytes:
    """Encode an RGBA image (H, W, 4) without loss; fast rather than small."""
    import cv2

    done, data = cv2.imencode(".png", image[..., [2, 1, 0, 3]], [cv2.IMWRITE_PNG_COMPRESSION, 1])
    if not done:
        raise FlatclothError("A layer could not be encoded as PNG; see the log.")
    return bytes(data)


def height_range_m(view: FlattenedView, axis: RotationAxis) -> tuple[float, float]:
    """Return the lowest and highest height of the valid pixels, 0 and 1 if there are none."""
    if not view.valid.any():
        return 0.0, 1.0
    height = height_m(view.xyz_m[view.valid], axis)
    return float(height.min()), float(height.max())


def legends(view: FlattenedView, axis: RotationAxis, angles_deg: tuple[float, ...]) -> dict[str, Any]:
    """Return what the page needs to explain each layer: ticks with units, colours, names."""
    low, high = height_range_m(view, axis)
    colors = view_colors(len(angles_deg))
    used = sorted({int(i) for i in np.unique(view.view_index[view.valid])} - {-1})
    return {
        "color": {"kind": "none", "title": "Color"},
        "height": _ramp("Height z (mm)", height_table(), low * 1000, high * 1000),
        "z_angle": _ramp("Z-angle (deg)", diverging_table(), -Z_ANGLE_SPAN_DEG, Z_ANGLE_SPAN_DEG),
        "source": {
            "kind": "classes",
            "title": "Source view",
            "classes": [
                {"label": f"{i} ({angles_deg[i]:g}°)", "color": _hex(colors[i])}
                for i in used
                if i < len(angles_deg)
            ],
        },
    }


def _ramp(title: str, table: Uint8, low: float, high: float) -> dict[str, Any]:
    return {
        "kind": "ramp",
        "title": title,
        "low": low,
        "high": high,
        "colors": [_hex(c) for c in table[:: len(table) // 16]] + [_hex(table[-1])],
    }


def _hex(color: Uint8) -> str:
    return "#" + bytes(color.tolist()).hex()
