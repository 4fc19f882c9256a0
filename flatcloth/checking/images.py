"""Are the images what they are taken for? Depth unit, masks, color against depth, exposure, coverage."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flatcloth.checking.findings import Finding
from flatcloth.checking.units import DEPTHS, allowed
from flatcloth.core.types import Bool, Float32, RgbdFrame, RotationAxis
from flatcloth.recordings.options import Mends

EXTENT_M = 0.35
"""The item lies within this of its usual depth: half the width of a large garment, hanging. Chosen."""
_HEIGHT_M, _HEIGHT_STD = 0.8, 0.45
"""Usual height of a hanging garment, and the deviation of its logarithm. Chosen: socks and coats are within
two deviations."""
_DISTANCE_M, _DISTANCE_STD = 0.9, 0.5
"""Usual distance of an item from a depth camera, and the deviation of its logarithm. Chosen: D435 and Azure
Kinect measure 0.3 to 3 m, two deviations."""
_RIGHT_UNIT = 0.99
"""Probability that the unit is right, before anything is looked at. Chosen."""
_MOST_MENDS = 3
"""Units that are proposed. Chosen: size and distance alone tell a factor to 40 %."""
_ROUGH = 0.2
"""A factor without a name, and with a larger deviation, mends nothing. Chosen."""
_AXIS_STD = 0.15
"""Deviation of the logarithm of the item's distance over that of the axis, for folds off the axis. Chosen."""
_ON_ITEM = 0.7
"""Share of a mask that lies on the item, at least. Measured: 1.0 on the 34 recordings, whose masks are right;
masks drawn by hand reach over outlines and holes."""
_BRIGHTER = math.log(1.6)
"""Change of the exposure between neighbouring views that is told. Chosen: twice that of the recordings whose
exposure wavers."""
_FAR_DEG, _FEW = 40.0, 4
"""Neighbouring views farther apart share too little cloth, and fewer views are no turn. Set by hand: garments
are seen to about 50 degrees from the front (paper, 4.1)."""
_OFTEN = 0.9
"""What is taken for the item in more than this share of the views may be background. Chosen."""
_STILL_OF_DEPTH = 0.005
"""Depth that stays within this times its square (m) stays: twice the noise of a D435 at short range, whose
error grows with the square (its datasheet: 2 % at 2 m)."""
_STILL_GRAY = 8.0
"""Brightness that stays within this of 255 stays. Chosen: several times the noise of a camera."""
_MOST_STILL, _ALL_STILL = 0.15, 0.9
"""More of the item than the first share keeps still if background is part of it: at most 0.06 do on the 34
recordings. If more than the second does, the item does not turn. Measured; chosen."""


@dataclass(frozen=True, kw_only=True)
class ViewLook:
    """What one view shows: ``height_m`` the extent of the item, upright in the image.

    ``mask_share`` of the masked pixels lie on the item; ``masked`` is the share of the image under the mask,
    ``brightness`` the logarithm of the item's mean color.
    ``thinned`` (h, w, 2) are depth (m) and brightness of what is taken for the item, NaN elsewhere.
    """

    view_index: int
    height_m: float
    mask_share: float
    masked: float
    brightness: float
    thinned: Float32


def look_at(frame: RgbdFrame, item: Bool, every: int = 4) -> ViewLook:
    """Look at every ``every``-th row and column of a view; ``item`` (H, W) are the pixels of the item."""
    near = item[::every, ::every]
    depth, color = frame.depth_m[::every, ::every], frame.color[::every, ::every]
    rows = np.flatnonzero(near.any(axis=1))
    depth_m = float(np.median(depth[near])) if near.any() else math.nan
    height = every * (int(rows[-1]) - int(rows[0])) if len(rows) else 0
    mask = None if frame.mask is None else frame.mask[::every, ::every]
    masked = 0 if mask is None else int(mask.sum())
    both = 0 if mask is None else int((mask & near).sum())
    gray = (color[..., 0].astype(np.float32) + color[..., 1] + color[..., 2]) / np.float32(3)
    taken = near if mask is None else near & mask
    return ViewLook(
        view_index=frame.view_index,
        height_m=height / frame.intrinsics.fy * depth_m,
        mask_share=both / masked if masked else math.nan,
        masked=masked / near.size,
        brightness=math.log(float(color[near].mean()) + 1.0) if near.any() else math.nan,
        thinned=np.where(taken[..., None], np.dstack([depth, gray]), np.float32(np.nan)),
    )


def unit_findings(depth_m: float, height_m: float, axis: RotationAxis | None) -> list[Finding]:
    """Return whether the unit of depth is another, from distance and height of the item and from the axis."""
    if not (depth_m > 0 and height_m > 0):
        return []
    told = [(_HEIGHT_M / height_m, _HEIGHT_STD), (_DISTANCE_M / depth_m, _DISTANCE_STD)]
    if axis is not None:
        told.append((_distance(axis) / depth_m, _AXIS_STD))
    logs, stds = np.log([factor for factor, _ in told]), np.array([std for _, std in told])
    std = float(np.sum(stds**-2.0) ** -0.5)
    log = float(np.sum(logs * stds**-2.0)) * std**2
    units = allowed(math.exp(log), std, DEPTHS)
    # Of all factors, the likeliest explains the same lengths as 1 does.
    off = 0.5 * min((log / std) ** 2 - (math.log(units[0].factor) - log) ** 2 / std**2, 60.0)
    right = _RIGHT_UNIT / (_RIGHT_UNIT + (1.0 - _RIGHT_UNIT) * math.exp(off) / len(DEPTHS))
    if right > 0.5:
        return []
    text = f"Depth is in another unit: the item would be {_length(height_m)} high, {_length(depth_m)} away"
    if axis is not None:
        text += f", and turn about an axis {_length(_distance(axis))} away"
    text += f"; it is {' or '.join(unit.name for unit in units[:_MOST_MENDS] if unit.name) or 'unknown'}"
    is_told = bool(units[0].name) or std < _ROUGH
    mends = tuple(Mends(depth_factor=unit.factor) for unit in units[:_MOST_MENDS] if is_told)
    return [Finding(name="unit", text=text, probability=1.0 - right, mends=mends)]


def _distance(axis: RotationAxis) -> float:
    return max(float(np.linalg.norm(np.cross(axis.point_m, axis.direction))), 0.05)


def _length(metres: float) -> str:
    return f"{1e3 * metres:.0f} mm" if metres < 0.1 else f"{metres:.2g} m"


def mask_findings(looks: Sequence[ViewLook]) -> list[Finding]:
    """Return whether the masks are inverted, or off the item."""
    masked = [look for look in looks if look.masked > 0]
    if not masked:
        return []
    share = float(np.median([look.mask_share for look in masked]))
    if share >= _ON_ITEM:
        return []
    worst = min(masked, key=lambda look: look.mask_share)
    most = float(np.median([look.masked for look in masked]))
    inverted = most > 0.5 and share < 0.5
    text = f"Only {share:.0%} of the masks lies on the item"
    text += ", they cover the background" if inverted else ""
    mends = Mends(invert_masks=True) if inverted else Mends(without_masks=True)
    probability = 1.0 - 0.01 * share / _ON_ITEM
    views = worst.view_index, worst.view_index
    return [Finding(name="masks", text=text, probability=probability, mends=(mends,), views=views)]


def background_findings(looks: Sequence[ViewLook]) -> list[Finding]:
    """Return whether something that stands still is taken for a part of the item."""
    if len(looks) < _FEW:
        return []
    seen = np.stack([look.thinned for look in looks])
    is_item = np.isfinite(seen[..., 0])
    often = is_item.mean(axis=0) > _OFTEN
    if not often.any():
        return []
    middle = np.nanmedian(seen[:, often], axis=0)
    off = np.nanmedian(np.abs(seen[:, often] - middle), axis=0)
    # What keeps its place, depth and color in all views.
    still = (off[:, 0] < _STILL_OF_DEPTH * middle[:, 0] ** 2) & (off[:, 1] < _STILL_GRAY)
    share = float(np.count_nonzero(still) / np.median(is_item.sum(axis=(1, 2))))
    if not _MOST_STILL < share < _ALL_STILL:
        return []
    text = f"{share:.0%} of what is taken for the item never moves: masks must leave out the background"
    probability = 1.0 - 0.01 * _MOST_STILL / share
    views = looks[0].view_index, looks[len(looks) // 2].view_index
    return [Finding(name="background", text=text, probability=probability, views=views)]


def exposure_findings(looks: Sequence[ViewLook]) -> list[Finding]:
    """Return whether the exposure jumps between neighbouring views; ``looks`` in order of their angles."""
    bright = np.array([look.brightness for look in looks])
    jumps = np.nan_to_num(np.abs(np.diff(bright)))
    if not len(jumps) or jumps.max() < _BRIGHTER:
        return []
    n = int(np.argmax(jumps))
    count = int(np.count_nonzero(jumps >= _BRIGHTER))
    text = f"The exposure jumps {count} times, by a factor of up to {math.exp(jumps[n]):.1f}"
    views = looks[n].view_index, looks[n + 1].view_index
    return [Finding(name="exposure", text=text, probability=0.99, stops=False, views=views)]


def coverage_findings(angles_deg: Sequence[float]) -> list[Finding]:
    """Return whether there are too few views, or too distant ones; the widest gap of a turn may be unseen."""
    if len(angles_deg) < 2:
        return []
    turned = np.sort(np.mod(angles_deg, 360.0))
    gaps = np.sort(np.diff(turned, append=turned[0] + 360.0))[:-1]
    far = int(np.count_nonzero(gaps > _FAR_DEG))
    if not far and len(angles_deg) >= _FEW:
        return []
    text = f"{far} of {len(gaps)} steps turn by more than {_FAR_DEG:.0f} degrees, and share little cloth"
    if not far:
        text = f"{len(angles_deg)} views show a part of the item only"
    return [Finding(name="coverage", text=text, probability=0.99, stops=False)]
