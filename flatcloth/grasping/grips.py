"""The operator's choices for gripping the picks, saved in the session folder as ``grips.json``."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

import msgspec

from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import finite
from flatcloth.grasping.grasps import OPENING_RANGE_M, GraspPose, Grip
from flatcloth.session.kept import read_kept, write_kept

FILE = "grips.json"
FORMAT: Literal["flatcloth-grips/1"] = "flatcloth-grips/1"
_REMEDY = "Delete it: all grips then follow the outline."


class _File(msgspec.Struct, frozen=True):
    format: Literal["flatcloth-grips/1"]
    grips: dict[str, Grip]


def _checked(grip: Grip) -> Grip:
    check_opening_m(grip.opening_m)
    if grip.axis_held is None:
        return grip
    x, y, z = grip.axis_held
    length = math.hypot(x, y, z)
    if not (math.isfinite(length) and length > 0.5):
        raise ValueError("an axis has no direction")
    return replace(grip, axis_held=(x / length, y / length, z / length))


def read_grips(folder: Path) -> dict[int, Grip]:
    """Return the grips saved in a session folder, by the number of their pick.

    Raises
    ------
    FlatclothError
        If the file is damaged; the message names it.
    """
    kept = read_kept(folder / FILE, _File, _REMEDY)
    try:
        return {} if kept is None else {int(key): _checked(grip) for key, grip in kept.grips.items()}
    except (ValueError, FlatclothError) as error:
        raise FlatclothError(f"{folder / FILE}: damaged ({error}). {_REMEDY}") from error


class GripStore:
    """The grips of a session. Used by one thread.

    Raises
    ------
    FlatclothError
        If the existing file is damaged.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._grips = read_grips(folder)

    @property
    def grips(self) -> Mapping[int, Grip]:
        """The chosen grips by the number of the pick; other picks have the default."""
        return MappingProxyType(self._grips)

    def get(self, pick_id: int) -> Grip:
        """Return the grip of a pick."""
        return self._grips.get(pick_id, Grip())

    def set(self, pick_id: int, grip: Grip) -> None:
        """Set the grip of a pick and save it.

        Raises
        ------
        FlatclothError
            If the opening is out of range, or the file cannot be written.
        """
        check_opening_m(grip.opening_m)
        self._write({**self._grips, pick_id: grip})

    def forget(self, pick_id: int) -> None:
        """Remove the grip of a deleted pick.

        Raises
        ------
        FlatclothError
            If the file cannot be written.
        """
        if pick_id in self._grips:
            self._write({key: grip for key, grip in self._grips.items() if key != pick_id})

    def _write(self, grips: dict[int, Grip]) -> None:
        write_kept(self._folder / FILE, _File(FORMAT, {str(key): grips[key] for key in sorted(grips)}))
        self._grips = grips


def check_opening_m(opening_m: float) -> None:
    """Raise if an opening is out of range for a gripper for cloth.

    Raises
    ------
    FlatclothError
        The message gives the range in millimetres.
    """
    low, high = OPENING_RANGE_M
    if not low <= opening_m <= high:
        raise FlatclothError(
            f"A gripper opens {1000 * low:.0f} to {1000 * high:.0f} mm, not {1000 * opening_m:g} mm."
        )


def grip_numbers(pose: GraspPose | None) -> dict[str, Any] | None:
    """Return the grip of a pose for the page.

    ``axis_deg`` is the axis as a line on the plane, -90 to 90; lines ``gripper_m`` (S, 2, 3), object frame,
    draw the gripper.
    """
    if pose is None:
        return None
    uv, about = pose.direction_uv, pose.uncertainty
    angle_deg = None if uv is None else math.degrees(math.atan2(float(uv[1]), float(uv[0])))
    return {
        "axis_from": pose.axis_from,
        "axis_deg": None if angle_deg is None else 90.0 - (90.0 - angle_deg) % 180.0,
        "axis_uv": None if uv is None else uv.tolist(),
        "axis_held": pose.object_from_grasp.rotation[:, 0].tolist(),
        "approach_held": pose.object_from_grasp.rotation[:, 2].tolist(),
        "opening_m": pose.opening_m,
        "gripper_m": pose.gripper_m().tolist(),
        "outline_distance_m": finite(pose.outline_distance_m),
        "position_std_m": finite(about.position_m),
        "normal_std_deg": finite(about.normal_deg),
        "axis_std_deg": finite(about.axis_deg),
        "placement_std_m": finite(about.placement_m),
    }
