"""The picks: the current one, the list, and their positions on the flattened view."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from flatcloth.core.cache import Cache
from flatcloth.core.errors import FlatclothError
from flatcloth.core.geometry import camera_from_object, object_from_camera
from flatcloth.core.types import FlattenedView, Floats, RotationAxis
from flatcloth.engine.integration import Integration
from flatcloth.export.garment import pick_at
from flatcloth.grasping.grasps import (
    LOST_AT_M,
    GraspPose,
    Grip,
    axis_by_hand,
    grasp_pose,
    nearest_cloth,
    pixel_of_point,
    point_on_ray,
)
from flatcloth.grasping.grips import GripStore, grip_numbers
from flatcloth.session.journal import Pick, PickDeleted, PickRenamed, SheetSide
from flatcloth.session.store import SessionFolder
from flatcloth.viewer.protocol.messages import HoverRay, SetGrip
from flatcloth.viewer.protocol.picture import Frame
from flatcloth.viewer.protocol.sent import UV, ListedPick, PickInfo, RayAnswer, typed

TOO_FAR_M = 0.030
"""A click in 3D farther than this from the shape picks nothing; a nearer one picks its nearest point."""
PLACES_KEPT = 200
"""Places of picks on shapes that are kept. Chosen: more than a list has; it bounds memory."""


@dataclass(frozen=True, kw_only=True)
class Place:
    """The position of a 3D point on a side of the item: plane coordinates, distance in space."""

    uv_m: tuple[float, float]
    distance_m: float
    side: SheetSide = "this"


class PickStore:
    """Adds, shows, renames and deletes picks; used by the application thread only.

    ``added(pick, uv_m)`` is called as soon as a new pick is found, before its grasp pose is computed.
    The pick of a click is loose: the next click replaces it, unless it is stored: kept, named or gripped.
    """

    def __init__(
        self, folder: SessionFolder, integration: Integration, added: Callable[[Pick, UV], None]
    ) -> None:
        self._folder = folder
        self._integration = integration
        self._added = added
        self._pose: tuple[Frame, Pick, Grip, GraspPose | None] | None = None
        self._places: Cache[Place] = Cache(PLACES_KEPT)
        self.book = GripStore(folder.folder)
        self._loose: Pick | None = None
        self._current: tuple[int | None, float] = None, 0.0  # its number, and how far the click missed

    @property
    def picks(self) -> tuple[Pick, ...]:
        """The stored picks, and the loose one."""
        return self._folder.picks if self._loose is None else (*self._folder.picks, self._loose)

    @property
    def current(self) -> Pick | None:
        """The pick shown in both panes."""
        return next((p for p in self.picks if p.id == self._current[0]), None)

    def _pose_of(self, pick: Pick, picture: Frame) -> GraspPose | None:
        """Return the current pick's grasp pose on a shape; None if its normal or its side is unknown."""
        if pick.side == "other" and picture.other is None:
            return None
        grip, kept = self.book.get(pick.id), self._pose
        if kept is None or kept[0] is not picture or kept[1] is not pick or kept[2] != grip:
            place = pick.position_held_m, pick.normal_held
            pose = grasp_pose(picture.side(pick.side), *place, self._integration.axis, grip)
            kept = self._pose = picture, pick, grip, pose
        return kept[3]

    def add(
        self,
        picture: Frame | None,
        u_m: float,
        v_m: float,
        miss_m: float | None = None,
        name: str = "",
        side: SheetSide = "this",
    ) -> None:
        """Pick the cloth of a side nearest to a position of its plane, and show the pick."""
        view = _shown(picture).side(side)
        pixel, off_m = nearest_cloth(view, (u_m, v_m))
        number = max((p.id for p in self._folder.picks), default=0) + 1
        self._loose = pick = pick_at(view, pixel, number, name or f"Pick {number}", side)
        u_m, v_m = view.uv_from_rc(np.array(pixel)).tolist()
        self._added(pick, (u_m, v_m))
        self._current = number, off_m if miss_m is None else miss_m

    def add_on_ray(
        self, picture: Frame | None, points_m: Floats, origin_m: Floats, direction: Floats
    ) -> bool:
        """Pick the first point that a click's ray hits; return False if it hits nothing."""
        picture = _shown(picture)
        hit = point_on_ray(points_m, origin_m, direction) if len(points_m) else None
        if hit is None:
            return False
        place = place_on(picture, points_m[hit])
        if place.distance_m > TOO_FAR_M:
            raise FlatclothError(
                f"That point is not part of the flattened shape yet: its nearest point is"
                f" {1000 * place.distance_m:.0f} mm away. Click another point, or step."
            )
        self.add(picture, *place.uv_m, miss_m=place.distance_m, side=place.side)
        return True

    def add_near(
        self, picture: Frame | None, place: tuple[float, ...], name: str, revision: int | None
    ) -> Pick:
        """Pick the cloth at (u, v) on the plane or (x, y, z) in the object frame, metres, for a program."""
        picture = _shown(picture)
        if revision not in (None, picture.revision):
            raise FlatclothError(
                f"Another shape is shown than that of revision {revision}; ask for the shape again."
            )
        side: SheetSide = "this"
        if len(place) == 3:
            on = place_on(picture, np.array(place))
            (u_m, v_m), distance_m, side = on.uv_m, on.distance_m, on.side
        else:
            u_m, v_m = place
            _, distance_m = nearest_cloth(picture.view, (u_m, v_m))
        if distance_m > TOO_FAR_M:
            raise FlatclothError(f"The nearest cloth is {1000 * distance_m:.0f} mm away; give another point.")
        self.add(picture, u_m, v_m, miss_m=distance_m, name=name.strip(), side=side)
        return self._kept(self.picks[-1].id)

    def show(self, pick_id: int | None, *, keep: bool = False) -> None:
        """Make a pick of the list the current one, or none; ``keep`` it in the list."""
        listed = self._kept if keep else self._listed
        self._current = None if pick_id is None else listed(pick_id).id, 0.0

    def listed(self, picture: Frame | None) -> tuple[ListedPick, ...]:
        """Return the list for the page, with the place of each pick on the shape."""
        rows = [self._row(pick, picture) for pick in self.picks]
        return typed(rows, tuple[ListedPick, ...])

    def _row(self, pick: Pick, picture: Frame | None) -> dict[str, Any]:
        place = None if picture is None else self._place_of(pick, picture)
        return {
            "id": pick.id,
            "name": pick.name,
            "side": pick.side,
            "view_index": pick.view_index,
            "position_held_m": pick.position_held_m,
            "uv_m": None if place is None or place.distance_m > LOST_AT_M else place.uv_m,
            "kept": pick is not self._loose,
        }

    def current_info(self, picture: Frame | None) -> PickInfo | None:
        """Return the numbers of the current pick; None without one, or before the first picture."""
        pick = self.current
        if pick is None or picture is None:
            return None
        from_object = camera_from_object(self._integration.axis, picture.angle_deg)
        position, normal = from_object.apply_with_normal(pick.position_held_m, pick.normal_held)
        values = {
            **self._row(pick, picture),
            "position_camera_m": position,
            "normal_held": pick.normal_held,
            "normal_camera": normal,
            "angle_deg": picture.angle_deg,
            "source_rc": pick.source_rc,
            "miss_m": self._current[1],
            "grip": grip_numbers(self._pose_of(pick, picture)),
        }
        return typed(values, PickInfo)

    def _place_of(self, pick: Pick, picture: Frame) -> Place | None:
        """Return the pixel nearest to a pick, of the cloth of its side; None if that side is not known."""
        if pick.side == "other" and picture.other is None:
            return None
        shown = picture.revision, 0 if picture.other is None else picture.other.revision
        key = *shown, pick.side, pick.position_held_m.tobytes()
        view = picture.side(pick.side)
        return self._places.get(key, lambda: _place(view, pick.position_held_m, pick.side))

    def grip(self, picture: Frame | None, asked: SetGrip) -> None:
        """Change a pick's grip: its axis, as an angle on the plane or along the outline; its opening."""
        pick, grip = self._kept(asked.id), self.book.get(asked.id)
        if asked.outline:
            grip = replace(grip, axis_held=None)
        elif asked.axis_deg is not None:
            by_hand = axis_by_hand(_shown(picture).side(pick.side), pick.position_held_m, asked.axis_deg)
            grip = replace(grip, axis_held=by_hand)
        if asked.opening_m is not None:
            grip = replace(grip, opening_m=asked.opening_m)
        self.book.set(pick.id, grip)

    def rename(self, pick_id: int, name: str) -> None:
        """Rename a pick."""
        self._folder.record(PickRenamed(self._kept(pick_id).id, name))

    def delete(self, pick_id: int) -> None:
        """Remove a pick from the list."""
        if self._listed(pick_id) is self._loose:
            self._loose = None
        else:
            self._folder.record(PickDeleted(pick_id))
            self.book.forget(pick_id)

    def _kept(self, pick_id: int) -> Pick:
        """Return a pick of the list, the loose one stored."""
        pick = self._listed(pick_id)
        if pick is not self._loose:
            return pick
        place = pick.position_held_m, pick.normal_held, pick.view_index, pick.source_rc
        stored = self._folder.add_pick(pick.name, *place, pick.side)
        self._loose = None
        if self._current[0] == pick_id:
            self._current = stored.id, self._current[1]
        return stored

    def _listed(self, pick_id: int) -> Pick:
        for pick in self.picks:
            if pick.id == pick_id:
                return pick
        raise FlatclothError(f"Pick {pick_id} is no longer in the list.")


def faces_away(pick: Pick, axis: RotationAxis, angle_deg: float) -> bool:
    """Say whether a pick's cloth faces away from where the camera stands at an angle; unknown: no."""
    eye_m = object_from_camera(axis, angle_deg).translation_m
    towards = (eye_m - np.asarray(pick.position_held_m)) @ np.asarray(pick.normal_held)
    return bool(np.isfinite(towards) and towards < 0)


def hit_by(picture: Frame | None, points_m: Floats, hover: HoverRay) -> RayAnswer:
    """Return what a ray hits first among the points of the scene."""
    nothing = RayAnswer(id=hover.id)
    if picture is None or not len(points_m) or not np.linalg.norm(hover.direction) > 0:
        return nothing
    hit = point_on_ray(points_m, np.array(hover.origin_m), np.array(hover.direction))
    if hit is None:
        return nothing
    x, y, z = map(float, points_m[hit])
    place = place_on(picture, points_m[hit])
    is_near = place.distance_m <= TOO_FAR_M
    return RayAnswer(id=hover.id, xyz_m=(x, y, z), uv_m=place.uv_m if is_near else None, sheet=place.side)


def place_on(picture: Frame, xyz_m: Floats) -> Place:
    """Return where a point (3,), object frame, is nearest to the cloth, on whichever side that is."""
    this = _place(picture.view, xyz_m, "this")
    if picture.other is None:
        return this
    other = _place(picture.other.view, xyz_m, "other")
    return other if other.distance_m < this.distance_m else this


def _place(view: FlattenedView, xyz_m: Floats, side: SheetSide) -> Place:
    rc, distance_m = pixel_of_point(view, xyz_m)
    u_m, v_m = view.uv_from_rc(np.array(rc)).tolist()
    return Place(uv_m=(u_m, v_m), distance_m=distance_m, side=side)


def _shown(picture: Frame | None) -> Frame:
    if picture is None:
        raise FlatclothError("Nothing is flattened yet; wait for the start view, then click again.")
    return picture
