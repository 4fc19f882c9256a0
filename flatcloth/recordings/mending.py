"""Mends: a recording read as if a mistake in it had not been made. The recording itself stays as it is.

They are options of its source, so that a session keeps them, and a resumed session has them again.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from flatcloth.core.errors import RecordingError
from flatcloth.core.types import Intrinsics, RgbdFrame, Uint8
from flatcloth.recordings.base import Recording, ViewImages, altered


@dataclass(frozen=True, kw_only=True)
class Mends:
    """What is changed in reading a recording; the defaults change nothing.

    Parameters
    ----------
    reverse : bool
        The item turns the other way than the angles say.
    angle_factor : float
        All angles are multiplied by it.
    view_angles : tuple of (view, degrees)
        The angles of single views, as if recorded.
    leave_out : tuple of int
        Views that are not read; later views count on without them.
    estimate_axis : bool
        The recorded axis and held point are not used; they are estimated.
    mirror : bool
        Images are flipped left to right; the intrinsics are those of the camera, and stay.
    rotate : int
        Images and intrinsics are turned clockwise by 90, 180 or 270 degrees.
    color_shift : (float, float)
        Color is moved by these pixels, right and down.
    color_scale : float
        Color is enlarged by this factor about the middle of the image.
    invert_masks, without_masks : bool
        Masks are inverted where depth was measured, or not used.
    depth_factor, focal_factor : float
        Depth, or the focal length, is multiplied by it.
    """

    reverse: bool = False
    angle_factor: float = 1.0
    view_angles: tuple[tuple[int, float], ...] = ()
    leave_out: tuple[int, ...] = ()
    estimate_axis: bool = False
    mirror: bool = False
    rotate: int = 0
    color_shift: tuple[float, float] = (0.0, 0.0)
    color_scale: float = 1.0
    invert_masks: bool = False
    without_masks: bool = False
    depth_factor: float = 1.0
    focal_factor: float = 1.0

    def __bool__(self) -> bool:
        """Return whether anything is changed."""
        return self != Mends()

    def to_dict(self) -> dict[str, Any]:
        """Return what is changed, for JSON."""
        return {
            field.name: _plain(value)
            for field in dataclasses.fields(self)
            if (value := getattr(self, field.name)) != field.default
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any], where: str) -> Mends:
        """Read mends from a table, of JSON or of a CSV file (lists: numbers, separated by spaces).

        Raises
        ------
        RecordingError
            If a name is unknown or a value is invalid.
        """
        made: dict[str, Any] = {}
        for name, value in values.items():
            if name not in _READ:
                raise RecordingError(f"{where}: unknown mend {name!r:.60}. Known are {', '.join(_READ)}.")
            read, give = _READ[name]
            try:
                made[name] = read(value)
            except (TypeError, ValueError, OverflowError) as error:
                raise RecordingError(f"{where}: {name} is {value!r:.60}. {give}.") from error
        return cls(**made)

    def then(self, more: Mends) -> Mends:
        """Return mends of a recording that is read with these already; single views are named as in it."""
        own = dict(self.view_angles) | dict(more.view_angles)
        return Mends(
            reverse=self.reverse != more.reverse,
            angle_factor=self.angle_factor * more.angle_factor,
            view_angles=tuple(sorted(own.items())),
            leave_out=tuple(sorted({*self.leave_out, *more.leave_out})),
            estimate_axis=self.estimate_axis or more.estimate_axis,
            mirror=self.mirror != more.mirror,
            rotate=(self.rotate + more.rotate) % 360,
            color_shift=(
                self.color_shift[0] + more.color_shift[0],
                self.color_shift[1] + more.color_shift[1],
            ),
            color_scale=self.color_scale * more.color_scale,
            invert_masks=self.invert_masks != more.invert_masks,
            without_masks=self.without_masks or more.without_masks,
            depth_factor=self.depth_factor * more.depth_factor,
            focal_factor=self.focal_factor * more.focal_factor,
        )

    def words(self) -> str:
        """Return the options of the command line that make these mends."""
        said: list[str] = []
        for name, value in self.to_dict().items():
            option = f"--{name.replace('_', '-')}"
            if value is True:
                said.append(option)
            elif name == "view_angles":
                said.append(f"{option} {','.join(f'{view}={angle:g}' for view, angle in value)}")
            elif name == "leave_out":
                said.append(f"{option} {','.join(map(str, value))}")
            elif isinstance(value, list):
                said.append(f"{option} {' '.join(f'{v:g}' for v in value)}")
            else:
                said.append(f"{option} {value:.4g}")
        return " ".join(said)


def _plain(value: Any) -> Any:
    return [_plain(v) for v in value] if isinstance(value, tuple) else value


def yes_or_no(value: Any) -> bool:
    """Return the value of a switch in a table; raises ``ValueError`` if it is neither on nor off."""
    known = {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}
    return known[str(value).lower()] if str(value).lower() in known else _refuse(value)


def _factor(value: Any) -> float:
    factor = float(value)
    return factor if 1e-4 <= factor <= 1e4 else _refuse(value)


def _list(value: Any) -> list[Any]:
    return value.replace(",", " ").split() if isinstance(value, str) else list(value)


def _views(value: Any) -> tuple[int, ...]:
    views = tuple(int(v) for v in _list(value))
    return views if all(v >= 0 for v in views) else _refuse(value)


def _angles(value: Any) -> tuple[tuple[int, float], ...]:
    pairs = [v.split("=") if isinstance(v, str) else v for v in _list(value)]
    found = tuple((int(view), float(angle)) for view, angle in pairs)
    return found if all(v >= 0 and math.isfinite(a) for v, a in found) else _refuse(value)


def _turn(value: Any) -> int:
    turn = int(value)
    return turn if turn in (0, 90, 180, 270) else _refuse(value)


def _shift(value: Any) -> tuple[float, float]:
    right, down = (float(v) for v in _list(value))
    return (right, down) if max(abs(right), abs(down)) < 1e4 else _refuse(value)


def _refuse(value: Any) -> Any:
    raise ValueError(f"{value!r:.60}")


_YES, _FACTOR = (yes_or_no, "Give yes or no"), (_factor, "Give a factor above 0, such as 2")
_READ: dict[str, tuple[Callable[[Any], Any], str]] = {
    **dict.fromkeys(("reverse", "estimate_axis", "mirror", "invert_masks", "without_masks"), _YES),
    **dict.fromkeys(("angle_factor", "color_scale", "depth_factor", "focal_factor"), _FACTOR),
    "view_angles": (_angles, "Give views and their degrees, such as 7=70"),
    "leave_out": (_views, "Give the numbers of views"),
    "rotate": (_turn, "Give 90, 180 or 270"),
    "color_shift": (_shift, "Give two numbers of pixels, right and down"),
}
"""What reads the value of each mend, and what to give if it cannot."""
MEND_NAMES = tuple(_READ)
"""The names of all mends."""


def mended(recording: Recording, mends: Mends) -> Recording:
    """Return a recording read with mends; the recording itself if there are none.

    Raises
    ------
    RecordingError
        If a mend names a view that there is not, or leaves none.
    """
    if not mends:
        return recording
    named = [*mends.leave_out, *(view for view, _ in mends.view_angles)]
    wrong = [view for view in named if view >= len(recording)]
    kept = [n for n in range(len(recording)) if n not in mends.leave_out]
    if wrong or not kept:
        cause = f"has no view {wrong[0]}" if wrong else "has no view left"
        raise RecordingError(f"{recording.location}: {cause}. Correct --leave-out or --view-angles.")
    own = dict(mends.view_angles)
    sign = -mends.angle_factor if mends.reverse else mends.angle_factor
    angles = [sign * own.get(n, recording.angles_deg[n]) for n in kept]

    def read(view: int) -> ViewImages:
        frame = recording[kept[view]]
        return _images(frame, mends)

    return altered(
        recording,
        notes=(*getattr(recording, "notes", ()), f"Mended: {mends.words()}."),
        intrinsics=_camera(recording.intrinsics, mends),
        angles_deg=tuple(angle - angles[0] for angle in angles),
        read=read,
        rotation_axis=None if mends.estimate_axis else recording.rotation_axis,
        held_point_m=None if mends.estimate_axis else recording.held_point_m,
        has_masks=recording.has_masks and not mends.without_masks,
        mends=mends,
    )


def _camera(k: Intrinsics, mends: Mends) -> Intrinsics:
    for _ in range(mends.rotate // 90):
        k = Intrinsics(width=k.height, height=k.width, fx=k.fy, fy=k.fx, cx=k.height - 1 - k.cy, cy=k.cx)
    return dataclasses.replace(k, fx=k.fx * mends.focal_factor, fy=k.fy * mends.focal_factor)


def _images(frame: RgbdFrame, mends: Mends) -> ViewImages:
    color, depth_m = frame.color, frame.depth_m
    masks = [None if mends.without_masks else mask for mask in (frame.mask, frame.other_mask)]
    if mends.invert_masks:
        masks = [None if mask is None else ~mask & (depth_m > 0) for mask in masks]
    if mends.depth_factor != 1.0:
        depth_m = depth_m * np.float32(mends.depth_factor)
    color = scaled_color(color, mends.color_scale, mends.color_shift)
    if mends.mirror:
        color, depth_m = np.ascontiguousarray(color[:, ::-1]), np.ascontiguousarray(depth_m[:, ::-1])
        masks = [None if mask is None else np.ascontiguousarray(mask[:, ::-1]) for mask in masks]
    turns = -(mends.rotate // 90)  # numpy turns anticlockwise
    if turns:
        color = np.ascontiguousarray(np.rot90(color, turns))
        depth_m = np.ascontiguousarray(np.rot90(depth_m, turns))
        masks = [None if mask is None else np.ascontiguousarray(np.rot90(mask, turns)) for mask in masks]
    return ViewImages(color, depth_m, *masks)


def scaled_color(color: Uint8, scale: float, shift_px: tuple[float, float]) -> Uint8:
    """Return color (H, W, 3), enlarged about the middle, moved right and down; the border repeats."""
    if shift_px == (0.0, 0.0) and scale == 1.0:
        return color
    rows, cols = color.shape[:2]
    middle = np.array([(cols - 1) / 2, (rows - 1) / 2])
    moved = np.column_stack([scale * np.eye(2), (1 - scale) * middle + shift_px])
    import cv2

    made = cv2.warpAffine(color, moved, (cols, rows), borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(made, dtype=np.uint8)
