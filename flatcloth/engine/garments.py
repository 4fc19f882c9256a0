"""From a session's document to what its shape says of the garment."""

from __future__ import annotations

from flatcloth.core.geometry import held_from_camera
from flatcloth.engine.integration import Integration
from flatcloth.garments.evidence import SeenFrom
from flatcloth.session.document import Document


def seen_from(integration: Integration, document: Document) -> list[SeenFrom]:
    """Return the views that a document's shape is made of, with their cameras as registered."""
    registered = integration.algorithm.cameras(document)
    held = {}
    if registered is not None:
        poses = registered.held_from_camera if registered.is_loose else registered.known
        held = {view.view_index: pose for view, pose in zip(registered.views, poses, strict=False)}
    views = []
    for index in sorted(document.used_views):
        frame = integration.frame(index)
        pose = held.get(index) or held_from_camera(integration.axis, frame.angle_deg)
        views.append(
            SeenFrom(
                view_index=index,
                depth_m=frame.depth_m,
                of_interest=frame.mask,
                intrinsics=frame.intrinsics,
                camera_from_held=pose.inverse(),
            )
        )
    return views
