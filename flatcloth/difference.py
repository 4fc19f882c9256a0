"""How two flattened views that are laid on each other differ, pixel by pixel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flatcloth.geometry import height_m
from flatcloth.merging import sample
from flatcloth.types import Bool, FlattenedView, Float32, RotationAxis


@dataclass(frozen=True, kw_only=True)
class Difference:
    """New less current, on the grid of the new view (H, W), NaN where not both have cloth.

    ``color`` float32 is the mean absolute difference of red, green and blue (0 to 255); ``height_m``
    float32 the signed difference of the heights along the turning axis; ``distance_m`` float32 the
    distance of the two points in space (held frame).
    """

    color: Float32
    height_m: Float32
    distance_m: Float32

    @property
    def common(self) -> Bool:
        """(H, W) Where both views have cloth."""
        both: Bool = np.isfinite(self.distance_m)
        return both


def difference(current: FlattenedView, new: FlattenedView, axis: RotationAxis) -> Difference:
    """Compare two flattened views of the same plane where they overlap.

    Parameters
    ----------
    current : FlattenedView
        The shape; read bilinearly.
    new : FlattenedView
        The view laid on it; each of its pixels is compared.
    axis : RotationAxis
        Axis of the recording, for the heights.
    """
    at = np.nonzero(new.valid)
    rc = np.stack(at, axis=1)
    there = sample(_xyz_and_color(current), current.rc_from_uv(new.uv_from_rc(rc)))
    xyz = new.xyz_m[at]

    def spread(values: Float32) -> Float32:
        image = np.full(new.shape, np.nan, dtype=np.float32)
        image[at] = values
        return image

    return Difference(
        color=spread(np.abs(new.rgb[at] - there[:, 3:6]).mean(axis=1)),
        height_m=spread((height_m(xyz, axis) - height_m(there[:, 0:3], axis)).astype(np.float32)),
        distance_m=spread(np.linalg.norm(xyz - there[:, 0:3], axis=1)),
    )


def _xyz_and_color(view: FlattenedView) -> Float32:
    """Return (H, W, 6) float32, NaN off the cloth."""
    return np.concatenate([view.xyz_m, view.rgb.astype(np.float32)], axis=-1)
