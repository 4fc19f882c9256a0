"""The layers of a flattened view as PNG, and their legends with units."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from flatcloth.core.errors import FlatclothError
from flatcloth.core.geometry import height_m
from flatcloth.core.types import FlattenedView, Float32, Floats, RotationAxis, Uint8
from flatcloth.flattening.resampling import sample
from flatcloth.rendering.colormaps import apply_table, color_table, view_colors

LayerName = Literal[
    "color", "height", "z_angle", "source", "stretch", "incidence", "density", "place", "truth"
]
LAYERS: tuple[LayerName, ...] = get_args(LayerName)
"""Names of the layers, in the order of their keys; the last one shows the error of recordings with a kit."""

QUALITY_LAYERS = {"density": 0, "incidence": 1, "stretch": 2}
"""Quality layers and their channel in ``FlattenedView.quality``."""

Z_ANGLE_SPAN_DEG, ERROR_SPAN_M = 90.0, 0.020
"""Ranges of the Z-angle, and of errors and their deviations. Chosen: larger ones are plain errors."""


class Scalar(NamedTuple):
    """A layer of values: its title, its own colour map, the factor to the title's unit, and its range.

    The range is fixed, so that colours mean the same in every view; None: it is the view's own.
    """

    title: str
    map: str
    scale: float = 1.0
    span: tuple[float, float] | None = None


SCALARS = {
    "height": Scalar("Height z (mm)", "sequential", 1000.0),
    "z_angle": Scalar("Z-angle (deg)", "diverging", 1.0, (-Z_ANGLE_SPAN_DEG, Z_ANGLE_SPAN_DEG)),
    "stretch": Scalar("Stretch (%)", "loss", 100.0, (0.0, 0.10)),
    "incidence": Scalar("Incidence (deg)", "loss", 1.0, (0.0, 80.0)),  # more is not flattened
    "density": Scalar("Density (px/cm²)", "sequential"),
    "place": Scalar("Uncertainty, std (mm)", "loss", 1000.0, (0.0, ERROR_SPAN_M)),
    "truth": Scalar("Error by the kit (mm)", "loss", 1000.0, (0.0, ERROR_SPAN_M)),
}

DIFFERENCES = {
    "color": Scalar("Color, difference", "loss", 1.0, (0.0, 64.0)),  # a quarter of the range of 8 bits
    "height": Scalar("Height, B − A (mm)", "diverging", 1000.0, (-ERROR_SPAN_M, ERROR_SPAN_M)),
    "position": Scalar("Distance in 3D (mm)", "loss", 1000.0, (0.0, ERROR_SPAN_M)),
}
"""The kinds of difference between proposal and shape."""
CONFLICT_M = 0.010
"""Points of proposal and shape at one place of the plane that are farther apart in space are in conflict.
Chosen: half the range of the colours of this difference."""

_UNKNOWN = (128, 128, 128)
"""Color of pixels without a value: middle grey."""


def rgba(
    view: FlattenedView,
    layer: str,
    axis: RotationAxis,
    n_views: int,
    like: FlattenedView | None = None,
    *,
    colors: int = 256,
) -> Uint8:
    """Return a layer as an image (H, W, 4) uint8; transparent where the view has no cloth.

    ``like`` is the view whose range the colours span, if it is another one; ``colors`` is the number of
    colours of a map of values.

    Raises
    ------
    FlatclothError
        If the layer is unknown.
    """
    if layer not in LAYERS:
        raise FlatclothError(f"Unknown layer {layer!r:.40}; choose one of {', '.join(LAYERS)}.")
    image = np.zeros((*view.shape, 4), dtype=np.uint8)
    valid = view.valid
    image[..., 3] = np.where(valid, 255, 0)
    if layer == "color":
        image[valid, :3] = view.rgb[valid]
    elif layer == "source":
        image[valid, :3] = view_colors(n_views)[np.clip(view.view_index[valid], 0, n_views - 1)]
    elif (values := _values(view, layer, axis)) is None:
        image[valid, :3] = _UNKNOWN
    else:
        low, high = layer_range(view if like is None else like, layer, axis)
        image[valid, :3] = _colors(values, SCALARS[layer].map, low, high, colors)
    return image


def difference_rgba(found: Mapping[str, Float32], kind: str) -> Uint8:
    """Return a heat map (H, W, 4) uint8 of a :func:`difference`; transparent where not both have cloth."""
    scalar, common = DIFFERENCES[kind], np.isfinite(found["position"])
    assert scalar.span is not None
    image = np.zeros((*common.shape, 4), dtype=np.uint8)
    image[common, 3] = 255
    image[common, :3] = _colors(found[kind][common], scalar.map, *scalar.span)
    return image


def png(image: Uint8) -> bytes:
    """Encode an image (H, W, 3 or 4) as PNG, optimised for speed."""
    import cv2

    # Run-length encoding alone is faster than matching, and smaller for flat layers and camera noise.
    fast = [cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE]
    code = cv2.COLOR_RGBA2BGRA if image.shape[2] == 4 else cv2.COLOR_RGB2BGR
    return bytes(cv2.imencode(".png", cv2.cvtColor(image, code), fast)[1])


def layer_range(view: FlattenedView, layer: str, axis: RotationAxis) -> tuple[float, float]:
    """Return the values of the first and the last colour of a layer, in the view's own unit.

    Those of the height and the density are the view's, 0 and 1 where it has none.
    """
    if (span := SCALARS[layer].span) is not None:
        return span
    values = _values(view, layer, axis)
    values = np.zeros(0) if values is None else values[np.isfinite(values)]
    if not values.size:
        return 0.0, 1.0
    # A few pixels at the outline are ten times denser than the rest; they may saturate.
    low, high = np.percentile(values, [2, 98] if layer == "density" else [0, 100])
    return float(low), float(high)


def _values(view: FlattenedView, layer: str, axis: RotationAxis) -> Floats | None:
    """Return a layer's values (N,) at the valid pixels; None if the view does not have them."""
    match layer:
        case "height":
            return height_m(view.xyz_m[view.valid], axis)
        case "z_angle":
            return view.z_angle_deg[view.valid]
        case "place":
            return None if view.placement_std_m is None else view.placement_std_m[view.valid]
        case "truth":
            return None if view.error_m is None else view.error_m[view.valid]
    return None if view.quality is None else view.quality[view.valid, QUALITY_LAYERS[layer]]


def _colors(values: Floats, own_map: str, low: float, high: float, count: int = 256) -> Uint8:
    table = color_table(own_map)
    table = table[np.linspace(0, len(table) - 1, count).round().astype(np.intp)]
    colors = apply_table(table, values, low, high)
    colors[~np.isfinite(values)] = _UNKNOWN
    return colors


def is_known(view: FlattenedView, layer: str, axis: RotationAxis) -> bool:
    """Return whether a view has a layer."""
    return layer in ("color", "source") or _values(view, layer, axis) is not None


def legends(view: FlattenedView, axis: RotationAxis, angles_deg: tuple[float, ...]) -> dict[str, Any]:
    """Return the legend of each layer for the page: ticks with units, colours, names."""
    return {layer: legend(view, layer, axis, angles_deg) for layer in LAYERS}


def legend(
    view: FlattenedView, layer: str, axis: RotationAxis, angles_deg: tuple[float, ...]
) -> dict[str, Any]:
    """Return the legend of a layer for the page."""
    if not is_known(view, layer, axis):
        lacking = {"place": "Not provided by this method", "truth": "No kit was recorded"}
        return {"kind": "classes", "title": lacking.get(layer, "Not measured"), "classes": []}
    if layer == "source":
        colors = view_colors(len(angles_deg))
        used = sorted({int(i) for i in np.unique(view.view_index[view.valid])} - {-1})
        classes = [
            {"label": f"{i} ({angles_deg[i]:g}°)", "color": hex_of(colors[i])}
            for i in used
            if i < len(angles_deg)
        ]
        return {"kind": "classes", "title": "Source view", "classes": classes}
    if layer == "color":
        return {"kind": "none", "title": "Color"}
    return _ramp(SCALARS[layer], layer_range(view, layer, axis))


def difference_legends() -> dict[str, Any]:
    """Return the legend of each of ``DIFFERENCES`` for the page."""
    return {kind: _ramp(scalar, scalar.span) for kind, scalar in DIFFERENCES.items() if scalar.span}


def _ramp(scalar: Scalar, span: tuple[float, float]) -> dict[str, Any]:
    low, high = (scalar.scale * value for value in span)
    return {
        "kind": "ramp",
        "title": scalar.title,
        "map": scalar.map,
        "low": low,
        "high": high,
        "colors": ramp_colors(color_table(scalar.map)),
    }


def ramp_colors(table: Uint8) -> list[str]:
    """Return a table's colours at equal distances, for a colour bar on the page."""
    return [hex_of(c) for c in table[:: len(table) // 16]] + [hex_of(table[-1])]


def hex_of(color: Uint8) -> str:
    """Return a colour (3,) as a CSS color."""
    return "#" + bytes(color.tolist()).hex()


def difference(current: FlattenedView, new: FlattenedView, axis: RotationAxis) -> dict[str, Float32]:
    """Compare two flattened views of the same plane where they overlap.

    Parameters
    ----------
    current : FlattenedView
        The shape; it is interpolated bilinearly.
    new : FlattenedView
        The view placed on it; each of its pixels is compared.
    axis : RotationAxis
        Axis of the recording, for the heights.

    Returns
    -------
    dict of (H, W) float32
        New minus current on the grid of the new view, by the kinds of ``DIFFERENCES``: the mean absolute
        difference of red, green and blue (0 to 255), that of the heights along the turning axis, m, and the
        distance of the two points in space, m, which is NaN where not both have cloth.
    """
    at = np.nonzero(new.valid)
    rc = np.stack(at, axis=1)
    shown = np.concatenate([current.xyz_m, current.rgb.astype(np.float32)], axis=-1)  # NaN off the cloth
    there = sample(shown, current.rc_from_uv(new.uv_from_rc(rc)))
    xyz = new.xyz_m[at]

    def spread(values: Float32) -> Float32:
        image = np.full(new.shape, np.nan, dtype=np.float32)
        image[at] = values
        return image

    return {
        "color": spread(np.abs(new.rgb[at] - there[:, 3:6]).mean(axis=1)),
        "height": spread((height_m(xyz, axis) - height_m(there[:, 0:3], axis)).astype(np.float32)),
        "position": spread(np.linalg.norm(xyz - there[:, 0:3], axis=1)),
    }
