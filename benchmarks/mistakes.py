"""Mistakes of recordings, made on right ones: which the check finds, names and mends, and what it costs.

Each kind has up to three strengths. A mistake is found if the check has a finding, named if the first one has
a name that is right, and mended if one of its mends gives the right recording again: the same images and
camera, angles to 2.2 degrees (four deviations of careful recordings), focal length to 2 %, color to 2 pixels.
Recordings as they are must have no finding. The time is that of the processor, of all threads together, and U
is measured in the same way beside each case, since other work on the machine slows both.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.inputs import measure_each
from benchmarks.output import Options, Row
from benchmarks.speed import unit_s
from flatcloth.checking.check import check_recording
from flatcloth.checking.findings import Check
from flatcloth.core.geometry import wrapped_deg
from flatcloth.core.types import RgbdFrame, RotationAxis
from flatcloth.recordings import open_recording
from flatcloth.recordings.base import Recording, ViewImages, altered, images_of
from flatcloth.recordings.mending import Mends, mended

_ANGLE_DEG, _FOCAL = 2.2, 0.02
_REPEATS = 5


@dataclass(frozen=True)
class Kind:
    """A kind of mistake: names that are right for it, strengths, how it is made, whether it can be mended."""

    name: str
    names: tuple[str, ...]
    strengths: tuple[float, ...]
    make: Callable[[Recording, float], Recording]
    has_mend: bool = True


def _angles(change: Callable[[np.ndarray, float], Any]) -> Callable[[Recording, float], Recording]:
    def make(recording: Recording, strength: float) -> Recording:
        made = change(np.array(recording.angles_deg), strength)
        return mended(recording, Mends(view_angles=tuple((n, float(a)) for n, a in enumerate(made))))

    return make


def _by(**of: Callable[[float], Any]) -> Callable[[Recording, float], Recording]:
    return lambda recording, strength: mended(
        recording, Mends(**{name: value(strength) for name, value in of.items()})
    )


def _order(angles: np.ndarray, strength: float) -> np.ndarray:
    n = len(angles)
    if strength == 1:  # two views exchanged
        made = angles.copy()
        made[[n // 7, n // 2]] = angles[[n // 2, n // 7]]
        return made
    if strength == 2:  # files sorted as text: 0, 1, 10, 11, ...
        return angles[np.argsort(np.argsort([str(i) for i in range(n)]))]
    return np.random.default_rng(7).permutation(angles)


def _one_view(angles: np.ndarray, by_deg: float) -> np.ndarray:
    made = angles.copy()
    made[len(angles) // 3] += by_deg
    return made


def _slipped(angles: np.ndarray, by_deg: float) -> np.ndarray:
    return np.where(np.arange(len(angles)) > len(angles) // 2, angles - by_deg, angles)


def _images(change: Callable[[Recording, int, float], ViewImages]) -> Callable[[Recording, float], Recording]:
    def make(recording: Recording, strength: float) -> Recording:
        return altered(recording, read=lambda n: change(recording, n, strength))

    return make


def _still(recording: Recording, n: int, _: float) -> ViewImages:
    frame = recording[5]
    random = np.random.default_rng(n)
    noise = random.normal(0, 0.0005, frame.depth_m.shape).astype(np.float32)
    return ViewImages(frame.color, np.where(frame.depth_m > 0, frame.depth_m + noise, 0), frame.mask)


def _inverted(recording: Recording, n: int, _: float) -> ViewImages:
    frame = recording[n]
    assert frame.mask is not None
    return ViewImages(frame.color, frame.depth_m, ~frame.mask)


def _masks_beside(recording: Recording, n: int, by_px: float) -> ViewImages:
    frame = recording[n]
    assert frame.mask is not None
    moved = np.zeros_like(frame.mask)
    moved[:, int(by_px) :] = frame.mask[:, : -int(by_px)]
    return ViewImages(frame.color, frame.depth_m, moved)


def _exposed(recording: Recording, n: int, factor: float) -> ViewImages:
    frame = recording[n]
    color = frame.color if n % 4 else np.clip(frame.color * factor, 0, 255).astype(np.uint8)
    return ViewImages(color, frame.depth_m, frame.mask)


def _axis_beside(recording: Recording, by_mm: float) -> Recording:
    axis = recording.rotation_axis
    assert axis is not None
    beside = axis.point_m + np.array([0.6, 0.0, 0.8]) * by_mm / 1e3
    return altered(recording, rotation_axis=replace(axis, point_m=beside))


def _axis_tilted(recording: Recording, by_deg: float) -> Recording:
    axis = recording.rotation_axis
    assert axis is not None
    tilt = math.radians(by_deg)
    leaning = np.array([math.sin(tilt), 0.0, 0.0]) + math.cos(tilt) * axis.direction
    return altered(recording, rotation_axis=RotationAxis(point_m=axis.point_m, direction=leaning))


def _few(recording: Recording, every: float) -> Recording:
    return mended(recording, Mends(leave_out=tuple(n for n in range(len(recording)) if n % int(every))))


def _swinging(recording: Recording, n: int, std_deg: float) -> ViewImages:
    """The view after a rotation about the held point, drawn anew from the nearest points."""
    frame, held = recording[n], recording.held_point_m
    k, (rows, cols) = frame.intrinsics, np.nonzero(frame.depth_m > 0)
    z = frame.depth_m[rows, cols].astype(np.float64)
    points = np.stack([(cols - k.cx) / k.fx * z, (rows - k.cy) / k.fy * z, z], axis=1)
    pivot = points[rows.argmin()] if held is None else held
    swing = np.random.default_rng(n).normal(0.0, math.radians(std_deg), 2)
    moved = (points - pivot) @ Rotation.from_rotvec([swing[0], 0.0, swing[1]]).as_matrix().T + pivot
    at = np.rint(moved[:, :2] / moved[:, 2:] * (k.fx, k.fy) + (k.cx, k.cy)).astype(int)
    order = np.argsort(-moved[:, 2])  # the nearest is drawn last
    order = order[((at >= 0) & (at < (k.width, k.height))).all(axis=1)[order]]
    rows_to, cols_to = at[order, 1], at[order, 0]
    depth, color = np.zeros_like(frame.depth_m), np.zeros_like(frame.color)
    depth[rows_to, cols_to] = moved[order, 2]
    color[rows_to, cols_to] = frame.color[rows[order], cols[order]]
    mask = None
    if frame.mask is not None:
        mask = np.zeros_like(frame.mask)
        mask[rows_to, cols_to] = frame.mask[rows[order], cols[order]]
    return ViewImages(color, depth, mask)


def _background(recording: Recording, n: int, share: float) -> ViewImages:
    """A board beside the item, as large as a share of its area, taken for the item."""
    frame = recording[n]
    first = recording[0]
    rows, cols = np.nonzero(first.depth_m > 0)
    side = int(math.sqrt(share * len(rows)))
    top = max(int(np.median(rows)) - side // 2, 0)
    left = max(int(cols.min()) - side - 2, 0) if cols.min() > side else int(cols.max()) + 2
    board = np.zeros(frame.depth_m.shape, dtype=bool)
    board[top : top + side, left : left + side] = True
    board &= ~(frame.depth_m > 0)
    depth, color = frame.depth_m.copy(), frame.color.copy()
    random = np.random.default_rng(n)
    far = float(np.median(first.depth_m[rows, cols])) + 0.1
    depth[board] = (far + random.normal(0, 0.001, int(board.sum()))).astype(np.float32)
    color[board] = 120
    return ViewImages(color, depth, None if frame.mask is None else frame.mask | board)


KINDS = (
    Kind("turned the other way", ("sense",), (1,), _by(reverse=lambda _: True)),
    Kind("angles too small or too large", ("factor",), (0.5, 2.0, 1.5), _by(angle_factor=float)),
    Kind("views in another order", ("order", "views"), (1, 2, 3), _angles(_order)),
    Kind("angle of a view wrong", ("views", "order"), (15.0, 35.0, 155.0), _angles(_one_view)),
    Kind("turntable slipped", ("views",), (12.0, 16.0, 25.0), _angles(_slipped)),
    Kind("item does not turn", ("still",), (1,), _images(_still), False),
    Kind("images mirrored", ("sense",), (1,), _by(mirror=lambda _: True)),
    Kind("images upside down", ("rotated",), (180,), _by(rotate=int)),
    Kind("images on their side", ("rotated",), (90, 270), _by(rotate=int)),
    Kind("focal length wrong", ("focal",), (0.8, 1.2, 1.3), _by(focal_factor=float)),
    Kind("unit of depth wrong", ("unit",), (0.1, 10.0, 0.25), _by(depth_factor=float)),
    Kind("masks inverted", ("masks",), (1,), _images(_inverted)),
    Kind("masks beside the item", ("masks",), (60.0, 100.0, 150.0), _images(_masks_beside)),
    Kind("color beside depth", ("color",), (8, 15, 30), _by(color_shift=lambda px: (px, 0.0))),
    Kind("color larger than depth", ("color",), (0.9, 1.1, 1.2), _by(color_scale=float)),
    Kind("axis beside the item's", ("axis",), (40.0, 80.0, 150.0), _axis_beside),
    Kind("axis tilted", ("axis",), (8.0, 15.0, 25.0), _axis_tilted),
    Kind("item swings", ("sway",), (1.5, 2.5, 4.0), _images(_swinging), False),
    Kind("background taken for the item", ("background",), (0.3, 0.6, 1.0), _images(_background), False),
    Kind("exposure jumps", ("exposure",), (1.8, 2.5, 0.4), _images(_exposed), False),
    Kind("views too far apart", ("coverage",), (5, 6, 9), _few, False),
)


def right_mend(right: Recording, wrong: Recording, check: Check) -> Mends | None:
    """Return the first mend of a finding that gives the right recording again; None if none does."""
    proposed = (mends for finding in check.findings for mends in finding.mends)
    return next((mends for mends in proposed if _same(right, mended(wrong, mends))), None)


def _same(right: Recording, other: Recording) -> bool:
    if len(other) != len(right) or (other.rotation_axis is not None and not _same_axis(right, other)):
        return False
    turned = np.array(other.angles_deg) - np.array(right.angles_deg)
    turned -= np.median(turned)
    if np.abs(wrapped_deg(turned)).max() > _ANGLE_DEG * (4 if right.name.endswith("loose") else 1):
        return False
    if other.intrinsics.width != right.intrinsics.width:
        return False
    if abs(math.log(other.intrinsics.fx / right.intrinsics.fx)) > _FOCAL:
        return False
    one, two = right[3], other[3]
    if not np.allclose(one.depth_m, two.depth_m, rtol=1e-3, atol=1e-4):
        return False
    if (
        right.has_masks
        and two.mask is not None
        and (one.mask & (one.depth_m > 0) != two.mask & (two.depth_m > 0)).any()
    ):
        return False
    inside = one.depth_m > 0
    near = np.abs(one.color.astype(int) - two.color.astype(int))[inside].mean()
    far = np.abs(one.color.astype(int) - np.roll(one.color, (2, 3), (0, 1)).astype(int))[inside].mean()
    return near <= far


def _same_axis(right: Recording, other: Recording) -> bool:
    one, two = right.rotation_axis, other.rotation_axis
    assert one is not None
    assert two is not None
    return bool(np.allclose(one.point_m, two.point_m) and np.allclose(one.direction, two.direction))


def run(options: Options) -> None:
    """Measure and print; write ``results/mistakes.json`` unless ``quick``."""
    measure_each("mistakes", rows_of, options)


def rows_of(source: str) -> list[Row]:
    """Return what the check says of a recording as it is, and with each mistake at each strength."""
    file = open_recording(source)
    frames = [file[n] for n in range(len(file))]
    right = altered(file, read=lambda n: images_of(frames[n]))
    rows = [_row(file, right, right, None, 0.0)]
    for kind in KINDS:
        rows += [_row(file, right, kind.make(right, strength), kind, strength) for strength in kind.strengths]
    return rows


def _row(file: Recording, right: Recording, wrong: Recording, kind: Kind | None, strength: float) -> Row:
    made = [wrong[n] for n in range(len(wrong))]  # a wrong recording on disk is not made while it is read

    def read(n: int) -> RgbdFrame:
        file[n]
        return made[n]

    began_s = time.process_time()
    check = check_recording(wrong, read)
    seconds = time.process_time() - began_s
    first = check.findings[0] if check.findings else None
    return {
        "recording": right.name,
        "mistake": "none" if kind is None else kind.name,
        "strength": strength,
        "findings": [finding.name for finding in check.findings],
        "probability": 0.0 if first is None else round(first.probability, 4),
        "certain": bool(check.certain),
        "found": first is not None,
        "named": kind is not None and first is not None and first.name in kind.names,
        "mended": None if kind is None or not kind.has_mend else right_mend(right, wrong, check) is not None,
        "time_u": round(seconds / unit_s(_REPEATS, time.process_time), 1),
    }
