"""An active loop for programs: what is asked, expected and known, as documents ready for JSON."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from flatcloth.active.choosing import End, Next, Waiting, seconds_of
from flatcloth.active.incoming import SeenView, Taken, ViewError
from flatcloth.active.loop import ActiveLoop
from flatcloth.core.geometry import Rigid3
from flatcloth.core.types import finite
from flatcloth.export.data import GraspFrames, grasps_document
from flatcloth.export.garment import named_points
from flatcloth.methods.answers import JoinedSides
from flatcloth.session.journal import Pick

Eye = Callable[[float, int], SeenView]
"""Looks at the item, which stands at an angle (degrees), for the question of a number."""


class ActiveService:
    """A loop, the camera that looks for it, if it has one, and the robot's frame. Safe for several threads.

    Parameters
    ----------
    loop : ActiveLoop
        The loop.
    eye : callable, optional
        Looks when an angle is announced; without it views are sent with their images.
    base_from_camera : callable
        Returns the hand-eye transform, if there is one: poses are then given in the robot's frame, too.
    taking : callable, optional
        Takes a view in place of the loop.
    """

    def __init__(
        self,
        loop: ActiveLoop,
        eye: Eye | None = None,
        base_from_camera: Callable[[], Rigid3 | None] = lambda: None,
        taking: Callable[[SeenView, int | None], Taken] | None = None,
    ) -> None:
        self.loop, self._eye, self._base_from_camera = loop, eye, base_from_camera
        self._taking = taking or loop.take

    def next(self, rotation_deg: float | None = None) -> dict[str, Any]:
        """Return the next angle, or the end, and what is known; the keys are those of docs/robots.md.

        Poses are those at a rotation, by default that at which the item stands.
        """
        loop = self.loop
        with loop.lock:
            return {**_asked(loop.asked, loop.views), **self._known(rotation_deg)}

    def take(self, view: SeenView, number: int | None, rotation_deg: float | None = None) -> dict[str, Any]:
        """Take a view that a program sends, and return what became of it and what comes next.

        Raises
        ------
        FlatclothError
            As :meth:`flatcloth.active.loop.ActiveLoop.take`.
        """
        taken = self._taking(view, number)
        about = {"number": taken.number, "told": list(taken.told)}
        return {"taken": about, **self.next(rotation_deg)}

    def look(self, angle_deg: float, number: int | None, rotation_deg: float | None = None) -> dict[str, Any]:
        """Look at the item, which stands at an angle now, with the camera of the loop; as :meth:`take`.

        Raises
        ------
        FlatclothError
            If the loop has no camera, or it cannot look.
        """
        if self._eye is None:
            raise ViewError("flatcloth has no camera here: send color, depth and K with the angle.")
        return self.take(self._eye(angle_deg, self.loop.views), number, rotation_deg)

    def write(self) -> list[Path]:
        """Write the result; see :meth:`flatcloth.active.loop.ActiveLoop.write`."""
        return self.loop.write(self._base_from_camera())

    def document(self, rotation_deg: float | None = None) -> dict[str, Any] | None:
        """Return the document of ``grasps.json`` with the named points that were seen.

        Poses are those at a rotation, by default that at which the item stands. None while the last view is
        learnt from, and before a shape.
        """
        loop = self.loop
        with loop.lock:
            if not loop.has_learnt or loop.document.start_view is None:
                return None
            return self._document(self._named, self._rotation(rotation_deg))

    def _known(self, rotation_deg: float | None) -> dict[str, Any]:
        loop, knowledge = self.loop, self.loop.knowledge
        rotation_deg = self._rotation(rotation_deg)
        wanted = [point for point in self._named if point.name in loop.goal.points]
        regrasp = loop.asked.regrasp if isinstance(loop.asked, End) else None
        return {
            "goal": str(loop.goal),
            "views": loop.views,
            "stands_deg": loop.stands_deg,
            "rotation_deg": rotation_deg,
            "got": next((step["got"] for step in reversed(loop.steps())), ""),
            "knows": knowledge.about(loop.goal),
            "kind": knowledge.kind,
            "probability": knowledge.probability,
            "area_cm2": round(1e4 * knowledge.area_m2, 1),
            "points": self._grasps(wanted, rotation_deg),
            "regrasp": next(iter(self._grasps([regrasp] if regrasp else [], rotation_deg)), None),
        }

    def _rotation(self, rotation_deg: float | None) -> float:
        return self.loop.stands_deg if rotation_deg is None else rotation_deg

    @property
    def _named(self) -> list[Pick]:
        return named_points(self.loop.known, self._sides)

    @property
    def _sides(self) -> JoinedSides | None:
        return None if isinstance(self.loop.known, str) else self.loop.known.sides

    def _grasps(self, picks: list[Pick], rotation_deg: float) -> list[dict[str, Any]]:
        """Return picks as in ``grasps.json``, each named point with its standard deviation on the cloth."""
        document = self._document(picks, rotation_deg) if picks else None
        grasps: list[dict[str, Any]] = [] if document is None else document["garment_points"]
        knowledge = self.loop.knowledge
        return [{**grasp, "std_m": finite(knowledge.point(grasp["name"]).std_m)} for grasp in grasps]

    def _document(self, picks: list[Pick], rotation_deg: float) -> dict[str, Any] | None:
        loop, integration = self.loop, self.loop.integration
        if integration is None:
            return None
        frames = GraspFrames(
            axis=integration.axis, rotation_deg=rotation_deg, base_from_camera=self._base_from_camera()
        )
        known = loop.known
        canonical = integration.canonical(loop.document) if isinstance(known, str) else known.canonical
        sides = self._sides
        other = () if sides is None else (sides.other.view, *sides.other.floating)
        return grasps_document(canonical.view, (), frames, picks, canonical.floating, other)


def _asked(asked: Next | Waiting | End, number: int) -> dict[str, Any]:
    if isinstance(asked, Waiting):
        return {"done": False, "waiting": asked.reason}
    if isinstance(asked, End):
        return {
            "done": True,
            "reached": asked.reached,
            "reason": asked.reason,
            "hidden": list(asked.hidden),
        }
    return {
        "done": False,
        "waiting": None,
        "number": number,
        "angle_deg": asked.angle_deg,
        "turn_deg": asked.turn_deg,
        "seconds": round(seconds_of(asked.turn_deg), 1),
        "why": asked.why,
        "expected": asked.expected,
        "hidden": list(asked.hidden),
    }
