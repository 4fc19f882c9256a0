"""Checks of a camera's image: item too near, too far, missing, or cut off."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flatcloth.core.config import SurfaceConfig
from flatcloth.core.errors import SurfaceError
from flatcloth.core.types import Bool, RgbdFrame
from flatcloth.flattening.surface import foreground_mask

NEAREST_M = 0.35
"""Above the least distance of a D435 at its full resolution (datasheet: 0.28 m), with a margin."""
FARTHEST_M = 1.3
"""Chosen: the noise of stereo depth grows with the square of the distance, here to 2.3 times that at 0.85
m."""
BEST = "0.5 to 1.0 m is best"

_NEAREST_SHARE = 5.0
"""Percentile of the distances that is the nearest. Chosen: fewer are outliers."""
_CUT_SHARE = 0.01
"""Share of a border of the image that the item may touch. Chosen."""
_LEAST_MEASURED = 0.002
"""Share of the image that must be measured at all. Chosen."""


@dataclass(frozen=True, kw_only=True)
class FrameCheck:
    """The item in a frame: its pixels (H, W), none if nothing was measured, and warnings."""

    item: Bool
    warnings: tuple[str, ...]


def check_frame(frame: RgbdFrame) -> FrameCheck:
    """Find the item and check how well the camera sees it.

    Notes
    -----
    A D435 measures nothing nearer than about 0.3 m, and its error grows with the square of the
    distance. The upper border may cut the holder; the other borders must not cut the item.
    640x480 px take about 20 ms.
    """
    depth = frame.depth_m
    nothing = np.zeros(depth.shape, dtype=np.bool_)
    if np.count_nonzero(depth) < _LEAST_MEASURED * depth.size:
        text = "No depth is measured: the lens may be covered, or everything is nearer than 0.3 m."
        return FrameCheck(item=nothing, warnings=(text,))
    try:
        item = foreground_mask(frame, None, SurfaceConfig())
    except SurfaceError as error:
        return FrameCheck(item=nothing, warnings=(str(error),))
    distances = depth[item]
    nearest, middle = (float(x) for x in np.percentile(distances, [_NEAREST_SHARE, 50]))
    warnings = []
    if nearest < NEAREST_M:
        warnings.append(f"Too near: {nearest:.2f} m; {BEST}.")
    if middle > FARTHEST_M:
        warnings.append(f"Too far: {middle:.2f} m, where depth is noisy; {BEST}.")
    sides = [
        name
        for name, rim in (("left", item[:, :2]), ("right", item[:, -2:]), ("lower", item[-2:]))
        if rim.any(axis=0 if name == "lower" else 1).mean() > _CUT_SHARE
    ]
    if sides and middle <= FARTHEST_M:
        border = "border" if len(sides) == 1 else "borders"
        warnings.append(
            f"The garment is cut by the {' and '.join(sides)} {border} of the image: move the camera back."
        )
    return FrameCheck(item=item, warnings=tuple(warnings))
