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
    loss_table,
    view_colors,
)

LAYERS = ("color", "height", "z_angle", "source", "stretch", "incidence", "density", "place")
"""Names of the layers, in the order of their keys 1 to 8."""

QUALITY_LAYERS = {"density": 0, "incidence": 1, "stretch": 2}
"""Layers of the quality, with their channel in ``FlattenedView.quality``."""

Z_ANGLE_SPAN_DEG = 90.0
"""The colours of the Z-angle end here, so that they mean the same in every view."""


STRETCH_SPAN = 0.10
PLACE_SPAN_M = 0.020
INCIDENCE_SPAN_DEG = 80.0
"""Fixed as well; grazing surface is not flattened beyond about that."""

_UNKNOWN = (128, 128, 128)


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
        case "stretch" | "incidence" | "density":
            image[valid, :3] = _quality_colors(view, layer)
        case "place":
            image[valid, :3] = _place_colors(view)
        case _:
            raise FlatclothError(f"There is no layer {layer!r:.40}; known are {', '.join(LAYERS)}.")
    return image


def png(image: Uint8) -> bytes:
    """Encode an RGBA image (H, W, 4) without loss; fast rather than small."""
    import cv2

    # Run lengths alone are faster than matching, and smaller: flat layers and camera noise both suit them.
    fast = [cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE]
    done, data = cv2.imencode(".png", cv2.cvtColor(image, cv2.COLOR_RGBA2BGRA), fast)
    if not done:
        raise FlatclothError("A layer could not be encoded as PNG; see the log.")
    return bytes(data)


def height_range_m(view: FlattenedView, axis: RotationAxis) -> tuple[float, float]:
    """Return the lowest and highest height of the valid pixels, 0 and 1 if there are none."""
    if not view.valid.any():
        return 0.0, 1.0
    height = height_m(view.xyz_m[view.valid], axis)
    return float(height.min()), float(height.max())


def quality_range(view: FlattenedView, layer: str) -> tuple[float, float]:
    """Return what the first and the last colour of a quality layer stand for, in the layer's unit."""
    if layer == "stretch":
        return 0.0, STRETCH_SPAN
    if layer == "incidence":
        return 0.0, INCIDENCE_SPAN_DEG
    values = np.zeros(0) if view.quality is None else view.quality[view.valid, QUALITY_LAYERS["density"]]
    values = values[np.isfinite(values)]
    if not values.size:
        return 0.0, 1.0
    # A few pixels at the rim are seen ten times as densely as the rest; they may saturate.
    low, high = np.percentile(values, [2, 98])
    return float(low), float(high)


def _quality_colors(view: FlattenedView, layer: str) -> Uint8:
    if view.quality is None:
        return np.array(_UNKNOWN, dtype=np.uint8)
    values = view.quality[view.valid, QUALITY_LAYERS[layer]]
    table = height_table() if layer == "density" else loss_table()
    colors = apply_table(table, values, *quality_range(view, layer))
    colors[~np.isfinite(values)] = _UNKNOWN
    return colors


def _place_colors(view: FlattenedView) -> Uint8:
    if view.placement_std_m is None:
        return np.array(_UNKNOWN, dtype=np.uint8)
    return apply_table(loss_table(), view.placement_std_m[view.valid], 0.0, PLACE_SPAN_M)


def legends(view: FlattenedView, axis: RotationAxis, angles_deg: tuple[float, ...]) -> dict[str, Any]:
    """Return what the page needs to explain each layer: ticks with units, colours, names."""
    return {layer: legend(view, layer, axis, angles_deg) for layer in LAYERS}


def legend(
    view: FlattenedView, layer: str, axis: RotationAxis, angles_deg: tuple[float, ...]
) -> dict[str, Any]:
    """Return what the page needs to explain one layer."""
    if layer in QUALITY_LAYERS and view.quality is None:
        return {"kind": "classes", "title": "Not measured", "classes": []}
    if layer == "place" and view.placement_std_m is None:
        return {"kind": "classes", "title": "Not known by this method", "classes": []}
    match layer:
        case "height":
            low, high = height_range_m(view, axis)
            return _ramp("Height z (mm)", height_table(), low * 1000, high * 1000)
        case "z_angle":
            return _ramp("Z-angle (deg)", diverging_table(), -Z_ANGLE_SPAN_DEG, Z_ANGLE_SPAN_DEG)
        case "source":
            return {"kind": "classes", "title": "Source view", "classes": _sources(view, angles_deg)}
        case "stretch":
            return _ramp("Stretch (%)", loss_table(), 0.0, 100 * STRETCH_SPAN)
        case "incidence":
            return _ramp("Incidence (deg)", loss_table(), 0.0, INCIDENCE_SPAN_DEG)
        case "density":
            return _ramp("Density (px/cm²)", height_table(), *quality_range(view, "density"))
        case "place":
            return _ramp("Std of place (mm)", loss_table(), 0.0, 1000 * PLACE_SPAN_M)
    return {"kind": "none", "title": "Color"}


def _sources(view: FlattenedView, angles_deg: tuple[float, ...]) -> list[dict[str, str]]:
    colors = view_colors(len(angles_deg))
    used = sorted({int(i) for i in np.unique(view.view_index[view.valid])} - {-1})
    return [
        {"label": f"{i} ({angles_deg[i]:g}°)", "color": _hex(colors[i])} for i in used if i < len(angles_deg)
    ]


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
