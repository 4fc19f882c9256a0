"""The views of a session in the order in which they joined the shape, for files that can be played."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from flatcloth.core.geometry import Rigid3, camera_from_object
from flatcloth.core.types import Bool, Float32, RgbdFrame, Uint8
from flatcloth.export.garment import garment_points
from flatcloth.export.session import OpenedSession
from flatcloth.session.journal import Pick

_EVERY = 2
"""Before the last view the cloud has every second row and column of the shape. Chosen for size."""


@dataclass(frozen=True, kw_only=True)
class Moment:
    """A view as it joined the shape, and the shape with it.

    ``order`` counts from 0; ``camera_from_object`` is the pose of the item before the fixed camera;
    ``points_m`` (N, 3) float32, object frame, and ``colors`` (N, 3) uint8 are the cloth of the shape so far,
    ``shown`` (H, W) its pixels on the plane.
    """

    order: int
    frame: RgbdFrame
    camera_from_object: Rigid3
    points_m: Float32
    colors: Uint8
    shown: Bool


def moments(session: OpenedSession) -> Iterator[Moment]:
    """Yield the views of a session's shape in the order of acceptance.

    Raises
    ------
    FlatclothError
        If the session has no start view.
    """
    growth, integration = session.growth, session.integration
    view = growth.view
    for step in growth.steps:
        shown = growth.shown_after(step.order)
        listed = shown.copy()
        if step.order + 1 < len(growth.steps):
            listed[:] = False
            listed[::_EVERY, ::_EVERY] = shown[::_EVERY, ::_EVERY]
        frame = integration.recording[step.view_index]
        yield Moment(
            order=step.order,
            frame=frame,
            camera_from_object=camera_from_object(integration.axis, frame.angle_deg),
            points_m=view.xyz_m[listed],
            colors=view.rgb[listed],
            shown=shown,
        )
        session.progress((step.order + 1) / len(growth.steps), "writing views")


def points_of(session: OpenedSession) -> list[Pick]:
    """Return the picks of a session, and the named points that were seen."""
    return [*session.history.picks, *garment_points(session.garment)]
