"""Mends: a recording read as if a mistake in it had not been made. The recording itself stays as it is.

They are options of its source, so that a session keeps them, and a resumed session has them again.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, TypeVar

import msgspec
import numpy as np

from flatcloth.core.decoding import Finite, MisfitError, fitted
from flatcloth.core.errors import RecordingError
from flatcloth.core.types import Intrinsics, RgbdFrame
from flatcloth.recordings.base import Recording, ViewImages, altered

T = TypeVar("T")
Factor = Annotated[float, msgspec.Meta(ge=1e-4, le=1e4)]
View = Annotated[int, msgspec.Meta(ge=0)]
Pixels = Annotated[float, msgspec.Meta(gt=-1e4, lt=1e4)]


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
    depth_views : tuple of (view, view)
        The first has the depth of the second; color, masks and angle stay.
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
    angle_factor: Factor = 1.0
    view_angles: tuple[tuple[View, Finite], ...] = ()
    depth_views: tuple[tuple[View, View], ...] = ()
    leave_out: tuple[View, ...] = ()
    estimate_axis: bool = False
    mirror: bool = False
    rotate: Annotated[int, msgspec.Meta(ge=0, le=270, multiple_of=90)] = 0
    color_shift: tuple[Pixels, Pixels] = (0.0, 0.0)
    color_scale: Factor = 1.0
    invert_masks: bool = False
    without_masks: bool = False
    depth_factor: Factor = 1.0
    focal_factor: Factor = 1.0

    def __bool__(self) -> bool:
        """Return whether anything is changed."""
        return self != Mends()

    def to_dict(self) -> dict[str, Any]:
        """Return what is changed, for JSON."""
        return {
            field.name: value
            for field in dataclasses.fields(self)
            if (value := getattr(self, field.name)) != field.default
        }

    def then(self, more: Mends) -> Mends:
        """Return mends of a recording that is read with these already; single views are named as in it."""
        (right, down), (more_right, more_down) = self.color_shift, more.color_shift
        factors = ("angle_factor", "color_scale", "depth_factor", "focal_factor")
        return Mends(
            view_angles=tuple(sorted((dict(self.view_angles) | dict(more.view_angles)).items())),
            depth_views=tuple(sorted((dict(self.depth_views) | dict(more.depth_views)).items())),
            leave_out=tuple(sorted({*self.leave_out, *more.leave_out})),
            estimate_axis=self.estimate_axis or more.estimate_axis,
            rotate=(self.rotate + more.rotate) % 360,
            color_shift=(right + more_right, down + more_down),
            without_masks=self.without_masks or more.without_masks,
            **{name: getattr(self, name) * getattr(more, name) for name in factors},
            **{name: getattr(self, name) != getattr(more, name) for name in _TWICE_IS_NONE},
        )

    def words(self) -> str:
        """Return the options of the command line that make these mends."""
        said: list[str] = []
        for name, value in self.to_dict().items():
            said.append(f"--{name.replace('_', '-')}")
            if name == "view_angles":
                said.append(",".join(f"{view}={angle:g}" for view, angle in value))
            elif name == "depth_views":
                said.append(",".join(_runs(self.depth_views)))
            elif name == "leave_out":
                said.append(",".join(map(str, value)))
            elif value is not True:
                said += [f"{v:g}" for v in value] if isinstance(value, tuple) else [f"{value:.4g}"]
        return " ".join(said)


def _runs(pairs: Sequence[tuple[int, int]]) -> list[str]:
    """Return pairs of views as runs: ``0-34=1-35``."""
    runs: list[list[tuple[int, int]]] = []
    for view, other in pairs:
        step = (other - runs[-1][-1][1]) if runs and view == runs[-1][-1][0] + 1 else 0
        is_on = abs(step) == 1 and (len(runs[-1]) < 2 or runs[-1][1][1] - runs[-1][0][1] == step)
        runs[-1:] = [[*runs[-1], (view, other)]] if is_on else [*runs[-1:], [(view, other)]]
    ends = [zip(run[0], run[-1], strict=True) if len(run) > 1 else zip(run[0], strict=True) for run in runs]
    return ["=".join("-".join(map(str, side)) for side in sides) for sides in ends]


_TWICE_IS_NONE = ("reverse", "mirror", "invert_masks")
"""Mends that undo themselves. By definition."""
MENDS = tuple(field.name for field in dataclasses.fields(Mends))
"""The names of all mends."""
_GIVE = {
    "view_angles": "views and their degrees, such as 7=70",
    "depth_views": "views and those whose depth they have, such as 0-34=1-35",
    "leave_out": "the numbers of views",
    "rotate": "90, 180 or 270",
    "color_shift": "two numbers of pixels, right and down",
    "angles": "the name of a file",
    "camera_file": "the name of a file",
    "fov_deg": "two angles in degrees, horizontal and vertical",
    "sweep": "forth or back",
}
"""What to give for an option, where its type says too little."""


def options_of(kind: type[T], values: Mapping[str, Any], where: str) -> T:
    """Read options from a table: of JSON, or of the command line and CSV files, whose values are text.

    Raises
    ------
    RecordingError
        If a name is unknown or a value is invalid.
    """
    types = {field.name: str(field.type) for field in dataclasses.fields(kind)}  # type: ignore[arg-type]
    for name, value in values.items():
        if name not in types:
            raise RecordingError(f"{where}: unknown option {name!r:.60}. Known are {', '.join(types)}.")
        try:
            if "\0" in str(value):  # no file has it in its name
                raise MisfitError(name, "text with a zero character", "")
            fitted({name: _untexted(value, types[name])}, kind, strict=False)
        except MisfitError as error:
            give = _GIVE.get(name, error.expected or "another value")
            raise RecordingError(f"{where}: {name} is {value!r:.60}. Give {give}.") from error
    return fitted({n: _untexted(v, types[n]) for n, v in values.items()}, kind, strict=False)


def _untexted(value: Any, kind: str) -> Any:
    if not isinstance(value, str) or not kind.startswith("tuple"):
        return {"yes": True, "no": False}.get(str(value).lower(), value) if kind.startswith("bool") else value
    listed: list[Any] = []
    for item in value.replace(",", " ").split():  # a value, a pair, or the pairs of a run (``0-34=1-35``)
        run = re.fullmatch(r"(\d+)-(\d+)=(\d+)-(\d+)", item, re.ASCII)
        one, last, other, its_last = map(int, run.groups()) if run else (0, -1, 0, 0)
        if 0 <= last - one == abs(its_last - other) < 10_000:
            way = 1 if other <= its_last else -1
            listed += [(one + n, other + way * n) for n in range(last - one + 1)]
        else:
            listed.append(item.split("=") if "=" in item else item)
    return listed


def mended(recording: Recording, mends: Mends) -> Recording:
    """Return a recording read with mends; the recording itself if there are none.

    Raises
    ------
    RecordingError
        If a mend names a view that there is not, or leaves none.
    """
    if not mends:
        return recording
    depth_of = dict(mends.depth_views)
    named = [*mends.leave_out, *(view for view, _ in mends.view_angles), *depth_of, *depth_of.values()]
    wrong = [view for view in named if view >= len(recording)]
    kept = [n for n in range(len(recording)) if n not in mends.leave_out]
    if wrong or not kept:
        cause = f"has no view {wrong[0]}" if wrong else "has no view left"
        raise RecordingError(
            f"{recording.location}: {cause}. Correct --leave-out, --view-angles or --depth-views."
        )
    own = dict(mends.view_angles)
    sign = -mends.angle_factor if mends.reverse else mends.angle_factor
    angles = [sign * own.get(n, recording.angles_deg[n]) for n in kept]

    def read(view: int) -> ViewImages:
        frame = recording[kept[view]]
        if kept[view] in depth_of:
            frame = dataclasses.replace(frame, depth_m=recording[depth_of[kept[view]]].depth_m)
        return _images(frame, mends)

    k, f = recording.intrinsics, mends.focal_factor
    for _ in range(mends.rotate // 90):
        k = Intrinsics(width=k.height, height=k.width, fx=k.fy, fy=k.fx, cx=k.height - 1 - k.cy, cy=k.cx)
    return altered(
        recording,
        notes=(*getattr(recording, "notes", ()), f"Mended: {mends.words()}."),
        intrinsics=dataclasses.replace(k, fx=k.fx * f, fy=k.fy * f),
        angles_deg=tuple(angle - angles[0] for angle in angles),
        read=read,
        rotation_axis=None if mends.estimate_axis else recording.rotation_axis,
        held_point_m=None if mends.estimate_axis else recording.held_point_m,
        has_masks=recording.has_masks and not mends.without_masks,
        mends=mends,
    )


def _images(frame: RgbdFrame, mends: Mends) -> ViewImages:
    depth_m = frame.depth_m
    masks = [None if mends.without_masks else mask for mask in (frame.mask, frame.other_mask)]
    if mends.invert_masks:
        masks = [None if mask is None else ~mask & (depth_m > 0) for mask in masks]
    if mends.depth_factor != 1.0:
        depth_m = depth_m * np.float32(mends.depth_factor)

    def turned(image: Any) -> Any:
        image = image[:, ::-1] if mends.mirror else image
        return np.ascontiguousarray(np.rot90(image, -(mends.rotate // 90)))  # numpy turns anticlockwise

    color, scale = frame.color, mends.color_scale
    if mends.color_shift != (0.0, 0.0) or scale != 1.0:  # about the middle; the border repeats
        import cv2

        rows, cols = color.shape[:2]
        middle = np.array([(cols - 1) / 2, (rows - 1) / 2])
        moved = np.column_stack([scale * np.eye(2), (1 - scale) * middle + mends.color_shift])
        made = cv2.warpAffine(color, moved, (cols, rows), borderMode=cv2.BORDER_REPLICATE)
        color = np.asarray(made, dtype=np.uint8)
    return ViewImages(
        turned(color), turned(depth_m), *(None if mask is None else turned(mask) for mask in masks)
    )
