"""What is asked of a synthesis: the options of the command ``synthesize``, which reads them without NumPy."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import Any, Literal

from flatcloth.recordings.options import option

_ITEM, _CAMERA, _ERRORS = "the item", "the camera", "noise and errors"
_STD = "standard deviation of "


@dataclass(kw_only=True)
class Request:
    """The item, the camera, and the errors of a synthetic recording; ``texture`` also as :mod:`.textures`."""

    mesh: Path = option("OBJ, PLY, glTF, GLB, STL or OFF file", "MESH", MISSING, positional=True)
    out: Path = option("recording folder to write", "DIR", MISSING)
    name: str | None = option("title of the recording (default: the folder's name)")
    up: Literal["x", "y", "z", "-x", "-y", "-z"] | None = option(
        "upward axis of the file (default: GLB and glTF y, others z); a downward one as --up=-z", group=_ITEM
    )
    scale: float = option("metres per unit of the file", default=1.0, group=_ITEM)
    held: tuple[float, float, float] | None = option(
        "held point, in the file's frame and unit (default: the highest vertex)", "X Y Z",
        group=_ITEM, either="held"
    )  # fmt: skip
    held_vertex: int | None = option("held vertex, counted from 0", "N", either="held")
    balance: bool = option("rotate the mesh rigidly so that it hangs below the held point", group=_ITEM)
    panel: str = option("side of interest: front, back, or 1 or 2", default="1", group=_ITEM)
    inside_out: bool = option("the faces of the file point inwards", group=_ITEM)
    texture: str | Callable[..., Any] | None = option(
        "checker, floral, stripes, plain, mesh (its own colors), or a kit.json, which is printed on it "
        "(default: its own if it has any, else checker)",
        group=_ITEM,
    )
    distance_m: float = option(
        "distance from the turning axis", "M", 0.85, names=("--distance",), group=_CAMERA
    )
    step_deg: float = option("angle between views", "DEG", 10.0, group=_CAMERA)
    size_px: tuple[int, int] = option(
        "image size in pixels", "W H", (480, 848), names=("--size",), group=_CAMERA
    )
    focal_px: float = option("focal length", "PX", 425.0, names=("--focal",), group=_CAMERA)
    center_px: tuple[float, float] | None = option(
        "principal point (default: the middle)", "CX CY", names=("--center",), group=_CAMERA
    )
    noise: Literal["none", "d435", "stereo"] = option(
        "none, the noise model of a D435, or depth matched between two rendered infrared images",
        default="none", names=("--sensor", "--noise"), group=_ERRORS
    )  # fmt: skip
    angle_error_deg: float = option(_STD + "the recorded angles", "DEG", 0.0, group=_ERRORS)
    axis_error_mm: float = option(
        _STD + "the recorded axis", "MM", 0.0, names=("--axis-error",), group=_ERRORS
    )
    sway_mm: float = option(
        _STD + "the lowest point from view to view", "MM", 0.0, names=("--sway", "--swing"), group=_ERRORS
    )
    twist_deg: float = option(
        _STD + "the angle by which the lowest point lags behind the turn", "DEG", 0.0, group=_ERRORS
    )
    exposure_percent: float = option(
        _STD + "the exposure from view to view; white balance a quarter of it", "PERCENT", 0.0,
        names=("--exposure",), group=_ERRORS
    )  # fmt: skip
    seed: int = option("seed of the pattern and of all errors", default=0, group=_ERRORS)

    @property
    def angles_deg(self) -> tuple[float, ...]:
        """The angles of a full turn, which are recorded with errors."""
        return tuple(n * self.step_deg for n in range(math.ceil((360.0 - 1e-6) / self.step_deg)))
