"""Find the item without a mask: the object that hangs on the axis and turns with it, without the gripper.

Four tests remove other objects, and report what they removed. Depth layers far from the axis are background.
A region apart from the item is another object. A region that stays in place while the item turns is a stand,
a table or an arm. A region above the held point, or one of another colour that is connected to the top of
the item by a narrow neck, is the gripper. Last, the item ends where its colour does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

import cv2
import numpy as np
from scipy.spatial import cKDTree

from flatcloth.core.config import SurfaceConfig
from flatcloth.core.errors import SegmentationError, SurfaceError
from flatcloth.core.geometry import window_of
from flatcloth.core.types import Bool, Float32, Float64, RgbdFrame, RotationAxis, Uint8
from flatcloth.flattening.surface import about_axis, foreground_mask
from flatcloth.registration.axis import THREADS, TOP_M

_T = TypeVar("_T")
_APART_M = 0.03
"""Regions farther than this from the largest are other objects. Nearer to the axis, the item hardly moves
either. Set by hand."""
_STILL_SHARE = 0.9
"""Least share of the views in which a pixel of the background has the same depth. Chosen: noise and dropouts
affect the others. If there are so few views that the share is all of them, they may all show cloth near the
axis at the same depth: by 2, 3 and 4 views of the bundled T-shirt's simulated cell, 241, 38 and 14 cm2 of it
were cut off as a stand."""
_STILL_DEPTH = 0.005
"""Same depth: at most this share of it apart. Chosen: about 3 sigma of a D435 at 0.85 m (1.5 mm)."""
LEAST_AREA_M2 = 2e-4
"""Smaller regions are not cut off, and smaller changes not reported. Chosen: 14 x 14 mm are noise or a
button."""
_UNLIKE = 14.0
"""Distance in CIELAB from all colours of the item beyond which a pixel has another colour. Set by hand."""
_SMALL_SHARE = 0.3
"""A gripper is a small part: it lies in this upper share of the item, touches the item along at most this
share of its outline, and is at most this share of what is seen. Chosen."""
_FATTENED_PX = 6
"""Depth reaches at most so far over an outline. Chosen: rendered stereo images widen outlines by up to 4
pixels (docs/tried.md), and colour may be a pixel or two off depth."""


@dataclass(frozen=True, kw_only=True)
class CutOff:
    """A region that was removed from the item in a view: kind of object, area, and the reason in words."""

    view_index: int
    kind: str
    area_m2: float
    text: str


@dataclass(frozen=True, kw_only=True)
class Item:
    """The measured pixels of the item in each view, (H, W) bool, and the regions that were cut off.

    ``outlined`` are those without the color of the background: masks are made of these, while sides are
    separated by all.
    """

    masks: tuple[Bool, ...]
    outlined: tuple[Bool, ...]
    cut_off: tuple[CutOff, ...]


def find_item(
    frames: Sequence[RgbdFrame],
    axis: RotationAxis | None,
    held_point_m: Float64 | None,
    config: SurfaceConfig,
    check: Callable[[], None] = lambda: None,
) -> Item:
    """Find the item in all views.

    Parameters
    ----------
    frames : sequence of RgbdFrame
        All views; their masks are not used.
    axis : RotationAxis, optional
        Camera frame. Without one, the item is what is nearest to the camera.
    held_point_m : (3,) float64, optional
        Camera frame; regions above it are the gripper.
    config : SurfaceConfig
        Limits of the foreground.
    check : callable
        Called after each view; may raise ``CancelledError``.

    Raises
    ------
    SegmentationError
        If no view shows an item, or most show two.
    """
    with ThreadPoolExecutor(THREADS) as pool:
        parts = checked(pool.map(lambda frame: _hanging(frame, axis, config), frames), check)
    near, doubles, far = zip(*parts, strict=True)
    if not any(mask.any() for mask in near):
        raise SegmentationError(
            "Nothing hangs in front of the camera in any view: the foreground is empty. Check depth and axis."
        )
    if 2 * sum(doubles) > len(frames):
        view = frames[int(np.argmax(doubles))].view_index
        raise SegmentationError(
            f"View {view}: two items hang side by side, about as large; take one away, or give masks."
        )
    still = _still(frames)

    def freed(n: int) -> tuple[Bool, list[CutOff], Bool]:
        mask, cuts = _without_holder(frames[n], near[n], still, axis, held_point_m)
        return mask, cuts, without_background(frames[n].color, mask)

    with ThreadPoolExecutor(THREADS) as pool:
        masks, cuts, outlined = zip(*checked(pool.map(freed, range(len(frames))), check), strict=True)
    cut_off = tuple(cut for own in (*far, *cuts) for cut in own)
    if not any(mask.any() for mask in outlined):
        raise SegmentationError("Nothing in view turns with the axis; check the angles, or give masks.")
    return Item(masks=masks, outlined=outlined, cut_off=cut_off)


def checked(made: Iterable[_T], check: Callable[[], None]) -> list[_T]:
    """Return a list of what is made one by one; ``check`` is called after each, and may end it by raising."""
    found = []
    for one in made:
        found.append(one)
        check()
    return found


def _hanging(
    frame: RgbdFrame, axis: RotationAxis | None, config: SurfaceConfig
) -> tuple[Bool, bool, list[CutOff]]:
    """Return the item near the axis in a view, whether there are two items, and what was cut off."""
    cuts: list[CutOff] = []
    mask = _foreground(frame, axis, config)
    off: Bool = (frame.depth_m > 0) & ~mask
    if mask.any():
        # A wrongly matched pixel at 60 m would cover 200 cm2 there; at the item's depth it is tiny.
        off = _large(frame, off, mask)
    _note(cuts, frame, off, "background", "is too far from what hangs nearest to the axis")
    mask, doubled = _largest(frame, mask, cuts)
    return mask, doubled, cuts


def _foreground(frame: RgbdFrame, axis: RotationAxis | None, config: SurfaceConfig) -> Bool:
    """Return the pixels about as far from the axis as the large regions nearest to it."""
    measured: Bool = frame.depth_m > 0
    try:
        large = foreground_mask(frame, axis, config)
    except SurfaceError:
        return np.zeros_like(measured)
    if not large.any():
        return large
    away = (
        frame.depth_m[measured].astype(np.float64) if axis is None else about_axis(frame, measured, axis)[1]
    )
    most = float(away[large[measured]].max()) + _APART_M
    item = measured.copy()
    item[measured] = away <= most
    return item


def _note(cuts: list[CutOff], frame: RgbdFrame, off: Bool, kind: str, why: str) -> None:
    area = _area_m2(frame, off)
    if area >= LEAST_AREA_M2:
        text = f"View {frame.view_index}: {1e4 * area:.0f} cm2 cut off as {kind}: it {why}."
        cuts.append(CutOff(view_index=frame.view_index, kind=kind, area_m2=area, text=text))


def _area_m2(frame: RgbdFrame, off: Bool) -> float:
    depth = frame.depth_m[off].astype(np.float64)
    return float((depth**2).sum() / (frame.intrinsics.fx * frame.intrinsics.fy))


def _largest(frame: RgbdFrame, mask: Bool, cuts: list[CutOff]) -> tuple[Bool, bool]:
    """Keep the largest region and those near it; return also whether another is about as large."""
    if not mask.any():
        return mask, False
    joined = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
    count, label = cv2.connectedComponents(joined, connectivity=8)
    if count <= 2:
        return mask, False
    weight = np.bincount(label[mask], frame.depth_m[mask] ** 2, count)
    weight[0] = 0.0
    largest = int(weight.argmax())
    away = cv2.distanceTransform((label != largest).astype(np.uint8), cv2.DIST_L2, 5)
    pitch_m = float(np.median(frame.depth_m[mask])) / frame.intrinsics.fx
    nearest = np.full(count, np.inf)
    np.minimum.at(nearest, label[mask].astype(np.intp), away[mask])
    apart = nearest * pitch_m > _APART_M
    apart[[0, largest]] = False
    doubled = bool((weight[apart] >= 0.5 * weight[largest]).any()) if apart.any() else False
    off: Bool = mask & apart[label]
    _note(cuts, frame, off, "another object", f"hangs more than {100 * _APART_M:.0f} cm away from the item")
    return mask & ~off, doubled


def _still(frames: Sequence[RgbdFrame]) -> tuple[Bool, Float32] | None:
    """Pixels (H, W) whose depth stays while the item turns, and that depth; None if it turns too little.

    None of them stays if there are so few views that cloth near the axis may have the same depth in all.
    """
    angles = np.array([frame.angle_deg for frame in frames])
    if np.ptp(angles) < 90.0:  # less shows too little of what stands still
        return None
    if len({frame.depth_m.shape for frame in frames}) != 1:
        return None
    if len(frames) * (1.0 - _STILL_SHARE) < 1.0:
        return np.zeros(frames[0].depth_m.shape, np.bool_), frames[0].depth_m
    chosen = [frames[n] for n in np.unique(np.linspace(0, len(frames) - 1, 12).astype(int))]
    still, middle = np.empty(frames[0].depth_m.shape, np.bool_), np.empty_like(frames[0].depth_m)
    for rows in np.array_split(np.arange(len(middle)), len(chosen)):  # all rows together would take 60 MB
        depth = np.stack([frame.depth_m[rows] for frame in chosen])
        middle[rows] = np.median(depth, axis=0)
        close = np.abs(depth - middle[rows]) <= _STILL_DEPTH * middle[rows]
        still[rows] = (middle[rows] > 0) & (close.mean(axis=0) >= _STILL_SHARE)
    return still, middle


def _without_holder(
    frame: RgbdFrame,
    mask: Bool,
    still: tuple[Bool, Float32] | None,
    axis: RotationAxis | None,
    held_point_m: Float64 | None,
) -> tuple[Bool, list[CutOff]]:
    cuts: list[CutOff] = []
    if not mask.any():
        return mask, cuts
    if axis is not None:
        height, radius = about_axis(frame, mask, axis)
        off = np.zeros_like(mask)
        if still is not None:
            stays, there_m = still[0][mask], still[1][mask]
            off[mask] = (
                (radius > _APART_M)
                & stays
                & (np.abs(frame.depth_m[mask] - there_m) <= _STILL_DEPTH * there_m)
            )
            off = _large(frame, off)
            _note(cuts, frame, off, "a stand", "stays in place while the item turns")
        if held_point_m is not None:
            above = np.zeros_like(mask)
            above[mask] = height > (held_point_m - axis.point_m) @ axis.direction + TOP_M
            above = _large(frame, above & ~off)
            _note(cuts, frame, above, "gripper", "lies above the held point")
            off |= above
        mask = mask & ~off
    if still is None:
        off = _gripper(frame, mask)
        _note(cuts, frame, off, "gripper", "sticks to the top by a narrow neck and has another colour")
        mask = mask & ~off
    return mask, cuts


def _large(frame: RgbdFrame, off: Bool, like: Bool | None = None) -> Bool:
    """Keep the regions of ``off`` that are large enough to be an object at the distance of ``like``.

    Without ``like``, their own distance counts.
    """
    part, count = window_of(off), int(np.count_nonzero(off))
    if part is None:
        return off
    depth_m = float(np.median(frame.depth_m[off if like is None else like]))
    least_px = LEAST_AREA_M2 * frame.intrinsics.fx * frame.intrinsics.fy / depth_m**2
    kept = np.zeros_like(off)
    if count < least_px:
        return kept
    _, label, stats, _ = cv2.connectedComponentsWithStats(off[part].astype(np.uint8), connectivity=8)
    large = stats[:, cv2.CC_STAT_AREA] >= least_px
    large[0] = False
    kept[part] = large[label]
    return kept


def _gripper(frame: RgbdFrame, mask: Bool) -> Bool:
    """Regions (H, W) of another colour at the top that touch the item along a small part of their outline."""
    none = np.zeros_like(mask)
    rows = np.flatnonzero(mask.any(axis=1))
    if rows.size < 8:
        return none
    lab = cv2.cvtColor(frame.color, cv2.COLOR_RGB2LAB).astype(np.float32)
    lab[..., 0] *= 0.5  # lamps shade folds
    body = mask.copy()
    body[: int(rows[0] + _SMALL_SHARE * rows.size)] = False
    if body.sum() < 50:
        return none
    sample = lab[body][:: max(1, int(body.sum()) // 4000)]
    unlike = np.zeros(mask.shape, dtype=np.uint8)
    top = mask & ~body
    unlike[top] = np.isinf(cKDTree(sample).query(lab[top], distance_upper_bound=_UNLIKE)[0])
    unlike = cv2.morphologyEx(unlike, cv2.MORPH_CLOSE, np.ones((9, 9), np.uint8)) & mask.astype(np.uint8)
    opened = cv2.morphologyEx(unlike, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    count, label = cv2.connectedComponents(opened, connectivity=4)
    off = none.copy()
    for n in range(1, count):
        region = label == n
        grown = cv2.dilate(region.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
        rim = grown & ~region
        touching = (rim & mask & (opened == 0)).sum() / max(int(rim.sum()), 1)
        if touching <= _SMALL_SHARE and region.sum() <= _SMALL_SHARE * mask.sum():
            off |= region
    if not off.any():
        return none
    # Remove also the rest of the gripper's rim, which the gripper separates from the item.
    count, label, stats, _ = cv2.connectedComponentsWithStats((mask & ~off).astype(np.uint8), connectivity=4)
    stats[0, cv2.CC_STAT_AREA] = 0
    main = label == int(stats[:, cv2.CC_STAT_AREA].argmax())
    near = cv2.dilate(off.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
    for n in range(1, count):
        region = label == n
        if not (region & main).any() and (region & near).any():
            off |= region
    return _large(frame, off)


def without_background(color: Uint8, item: Bool) -> Bool:
    """Return the item (H, W) without pixels at its outline that have the color of the background.

    A stereo sensor makes near surfaces larger than they are (edge fattening): matching windows at an outline
    see the item and the background, and follow the item, so its depth reaches over the background. The
    colors of both nearby are taken as normally distributed; a pixel within ``_FATTENED_PX`` of the outline
    is removed if it is far more probable in the background. Nothing is removed where both look alike. Color
    that is aligned to depth is black beyond the outline; there the item's outermost pixels stand for the
    background.

    Parameters
    ----------
    color : (H, W, 3) uint8
        Aligned with ``item``.
    item : (H, W) bool
        The measured pixels of the item.
    """
    around = window_of(item, 3 * _FATTENED_PX)
    if around is None:
        return item
    rgb, shown = color[around], item[around].astype(np.uint8)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * _FATTENED_PX + 1,) * 2)
    whole = _without_holes(shown)  # what is not measured within the item is no background
    inside, outside = cv2.erode(whole, disc) > 0, (cv2.dilate(whole, disc) == 0) & rgb.any(axis=-1)
    rim, outermost = (shown > 0) & ~inside, (shown > 0) & (cv2.erode(whole, np.ones((3, 3), np.uint8)) == 0)
    unlike_item, unlike_background = _unlike(rgb, inside, rim), _unlike(rgb, outside, rim)
    if np.isinf(unlike_background).any():
        unlike_background = np.where(
            np.isinf(unlike_background), _unlike(rgb, outermost, rim), unlike_background
        )
    kept = item.copy()
    # Better by more than 2 for each channel, as Akaike's criterion asks of a model with more parameters.
    is_background = unlike_item - unlike_background > 2 * rgb.shape[-1]
    kept[around][rim] = np.isinf(unlike_item) | ~is_background
    return kept


def _without_holes(shown: Uint8) -> Uint8:
    """Return an image (H, W) of 0 and 1 with the regions of 0 that do not reach its border filled."""
    framed = cv2.copyMakeBorder(shown, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
    cv2.floodFill(framed, None, (0, 0), 2)
    return np.asarray(framed[1:-1, 1:-1] != 2, dtype=np.uint8)


def _unlike(rgb: Uint8, sample: Bool, rim: Bool) -> Float32:
    """Return -2 log of the probability density of each color on the ``rim`` by those of a sample nearby.

    Both are masks (H, W); the result (K,) is inf where there is no sample.
    """
    side = (6 * _FATTENED_PX + 1,) * 2  # around each judged pixel, so that it reaches item and background
    chosen = cv2.merge((rgb, np.ones_like(rgb[..., 0]))) * sample[..., None]
    total = cv2.boxFilter(chosen, cv2.CV_32S, side, normalize=False)[rim].astype(np.float32)
    squares = cv2.sqrBoxFilter(chosen, cv2.CV_32S, side, normalize=False)[rim].astype(np.float32)
    count = np.maximum(total[:, 3:], 1)
    middle = total[:, :3] / count
    variance = np.maximum(squares[:, :3] / count - middle**2, 1)  # at least a step of 8 bits
    density = (np.square(rgb[rim] - middle) / variance + np.log(variance)).sum(axis=-1)
    return np.where(total[:, 3] > 0, density, np.inf).astype(np.float32)
