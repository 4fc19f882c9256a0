"""The picks: the one that is current, the list that is kept, and their places on the flattened view."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from flatcloth.errors import FlatclothError
from flatcloth.geometry import camera_from_held
from flatcloth.grasping import grasp_at, pixel_of_point, point_on_ray
from flatcloth.types import Float64, Floats, RotationAxis
from flatcloth.viewer.picture import Picture, finite

if TYPE_CHECKING:
    from flatcloth.journal import Pick, SessionFolder

LOST_AT_M = 0.010
"""A pick further than this from the present shape is not drawn on it (its view was taken back)."""

TOO_FAR_M = 0.030
"""A click in 3D further than this from the shape picks nothing; nearer, it picks the nearest of it."""


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


class PickDesk:
    """Adds, shows, renames and deletes picks; used by the application thread only.

    ``show(position, normal)`` puts the ball and the arrow into the scene, or hides them.
    """

    def __init__(
        self,
        folder: SessionFolder,
        axis: RotationAxis,
        show: Callable[[Float64 | None, Float64 | None], None],
    ) -> None:
        self._folder = folder
        self._axis = axis
        self._show = show
        self.picks: tuple[Pick, ...] = folder.picks
        self.current: CurrentPick | None = None

    def add(self, picture: Picture | None, u_m: float, v_m: float, miss_m: float | None = None) -> None:
        """Pick the cloth nearest to a place of the plane, keep the pick and show it."""
        picture = _shown(picture)
        grasp = grasp_at(picture.view, (u_m, v_m), self._axis, picture.angle_deg)
        number = max((p.id for p in self.picks), default=0) + 1
        pick = self._folder.add_pick(
            f"Pick {number}", grasp.position_held_m, grasp.normal_held, grasp.view_index, grasp.source_rc
        )
        self.picks = (*self.picks, pick)
        self._set(CurrentPick(pick=pick, miss_m=grasp.miss_m if miss_m is None else miss_m))

    def add_on_ray(
        self, picture: Picture | None, points_m: Floats, origin_m: Floats, direction: Floats
    ) -> bool:
        """Pick what a ray of the eye hits first; False if it hits nothing."""
        picture = _shown(picture)
        hit = point_on_ray(points_m, origin_m, direction) if len(points_m) else None
        if hit is None:
            return False
        rc, distance_m = pixel_of_point(picture.view, points_m[hit])
        if distance_m > TOO_FAR_M:
            raise FlatclothError(
                f"That point is not part of the flattened shape yet: the nearest of it is"
                f" {1000 * distance_m:.0f} mm away. Click another, or step on."
            )
        u_m, v_m = picture.view.uv_from_rc(np.array(rc)).tolist()
        self.add(picture, u_m, v_m, miss_m=distance_m)
        return True

    def show(self, pick_id: int | None) -> None:
        """Make a pick of the list the current one, or none."""
        self._set(None if pick_id is None else CurrentPick(pick=self._listed(pick_id)))

    def rename(self, pick_id: int, name: str) -> None:
        """Give a pick another name."""
        self._listed(pick_id)
        self._folder.rename_pick(pick_id, name)
        self._reload()

    def delete(self, pick_id: int) -> None:
        """Take a pick off the list."""
        self._listed(pick_id)
        self._folder.delete_pick(pick_id)
        self._reload()

    def _set(self, current: CurrentPick | None) -> None:
        self.current = current
        if current is None:
            self._show(None, None)
        else:
            self._show(current.pick.position_held_m, current.pick.normal_held)

    def _reload(self) -> None:
        self.picks = self._folder.picks
        if self.current is not None:
            found = [p for p in self.picks if p.id == self.current.pick.id]
            self._set(replace(self.current, pick=found[0]) if found else None)

    def _listed(self, pick_id: int) -> Pick:
        for pick in self.picks:
            if pick.id == pick_id:
                return pick
        raise FlatclothError(f"Pick {pick_id} is no longer in the list.")


def _shown(picture: Picture | None) -> Picture:
    if picture is None:
        raise FlatclothError("Nothing is flattened yet; wait for the start view, then click.")
    return picture


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
