"""From a session's document to the garment that its shape is, and that compared with the truth."""

from __future__ import annotations

from flatcloth.core.errors import GarmentError
from flatcloth.core.geometry import held_from_camera
from flatcloth.engine.integration import Integration
from flatcloth.garments.evidence import SeenFrom, evidence_of
from flatcloth.garments.recognition import Recognition, recognise
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


def recognised(integration: Integration, document: Document) -> Recognition:
    """Return what garment a document's shape is (flatcloth.garments.recognition).

    Raises
    ------
    GarmentError
        If the shape shows too little, or was seen in one view only.
    """
    views = seen_from(integration, document)
    if len(views) < 2:
        raise GarmentError("The shape was made of one view; a garment is not recognised by one. Add views.")
    canonical = integration.canonical(document)
    evidence = [evidence_of(piece, views) for piece in (canonical.view, *canonical.floating)]
    return recognise(canonical.view, evidence)


def garment_of(integration: Integration, document: Document) -> Recognition | str:
    """Return what garment a document's shape is, or why nothing can be said of it."""
    try:
        return recognised(integration, document)
    except GarmentError as error:
        return str(error)
