"""The picks: the one that is current, the list that is kept, and their places on the flattened view."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from flatcloth.geometry import camera_from_held
from flatcloth.grasping import pixel_of_point
from flatcloth.types import Float64, RotationAxis
from flatcloth.viewer.picture import Picture, finite

if TYPE_CHECKING:
    from flatcloth.journal import Pick

LOST_AT_M = 0.010
"""A pick further than this from the present shape is not drawn on it (its view was taken back)."""


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where a 3D point lies on the present shape: pixel, plane coordinates, distance in space."""

    rc: tuple[int, int]
    uv_m: tuple[float, float]
    distance_m: float

    @property
    def in_shape(self) -> bool:
        """Whether the present shape holds the point."""
        return self.distance_m <= LOST_AT_M


@dataclass(frozen=True, kw_only=True)
class CurrentPick:
    """The pick that both sides of the page show; ``miss_m`` is how far the click was off the cloth."""

    pick: Pick
    miss_m: float = 0.0


class PlaceBook:
    """Remembers where each pick lies on the shape, until the shape changes."""

    def __init__(self) -> None:
        self._revision = 0
        self._places: dict[bytes, Place] = {}

    def place(self, picture: Picture, position_held_m: Float64) -> Place:
        """Return the pixel of the present shape that is nearest to a point of the held frame."""
        if picture.revision != self._revision:
            self._revision, self._places = picture.revision, {}
        key = np.asarray(position_held_m, dtype=np.float64).tobytes()
        if key not in self._places:
            rc, distance_m = pixel_of_point(picture.view, position_held_m)
            u_m, v_m = picture.view.uv_from_rc(np.array(rc)).tolist()
            self._places[key] = Place(rc=rc, uv_m=(u_m, v_m), distance_m=distance_m)
        return self._places[key]


def numbers(current: CurrentPick, place: Place, picture: Picture, axis: RotationAxis) -> dict[str, Any]:
    """Return all numbers of the current pick, for the page and the clipboard."""
    pick = current.pick
    position = np.asarray(pick.position_held_m, dtype=np.float64)
    normal = np.asarray(pick.normal_held, dtype=np.float64)
    at_camera, normal_camera = camera_from_held(axis, picture.angle_deg).apply_with_normal(position, normal)
    z_angle = float(picture.view.z_angle_deg[place.rc]) if place.in_shape else None
    return {
        "id": pick.id,
        "name": pick.name,
        "rc": list(place.rc),
        "uv_m": list(place.uv_m),
        "in_shape": place.in_shape,
        "position_held_m": position.tolist(),
        "position_camera_m": at_camera.tolist(),
        "normal_held": [finite(x) for x in normal.tolist()],
        "normal_camera": [finite(x) for x in normal_camera.tolist()],
        "angle_deg": picture.angle_deg,
        "z_angle_deg": finite(z_angle),
        "view_index": pick.view_index,
        "source_rc": list(pick.source_rc),
        "miss_m": current.miss_m,
    }


def grasps_document(picks: tuple[Pick, ...], recording_name: str, axis: RotationAxis) -> dict[str, Any]:
    """Return the content of ``grasps.json``."""
    return {
        "format": "flatcloth-grasps/1",
        "recording": recording_name,
        "frame": "held: the camera frame of view 0 (x right, y down, z forward), metres",
        "rotation_axis": {"point_m": axis.point_m.tolist(), "direction": axis.direction.tolist()},
        "grasps": [
            {
                "id": p.id,
                "name": p.name,
                "position_held_m": np.asarray(p.position_held_m).tolist(),
                "normal_held": [finite(x) for x in np.asarray(p.normal_held).tolist()],
                "view_index": p.view_index,
                "source_rc": list(p.source_rc),
            }
            for p in picks
        ],
    }
