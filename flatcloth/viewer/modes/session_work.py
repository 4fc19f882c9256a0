"""What the messages of a session's page mean: nudges, the turning axis, floating pieces placed by hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import LaidPiece, Rigid2, RotationAxis, finite
from flatcloth.engine.garment.recognition import KnownGarment
from flatcloth.engine.integration import Integration
from flatcloth.engine.sheet import Sheet, is_on_shape, place_of_piece
from flatcloth.session.document import accept
from flatcloth.session.ghosts import Ghost, Ghosts
from flatcloth.session.machine import (
    Command,
    Document,
    Pending,
    Reopen,
    TakePart,
)
from flatcloth.viewer.protocol.messages import Move, PlacePiece, SetAxis
from flatcloth.viewer.protocol.picture import Overlay, Picture
from flatcloth.viewer.protocol.snapshot import center_uv_m
from flatcloth.viewer.protocol.state import AxisInfo


def turned_about(integration: Integration, axis: RotationAxis) -> str:
    """Take a turning axis that was set by hand; return how well the views agree about it."""
    integration.views.turn_about(axis)
    try:
        return f"The turning axis was set by hand. {integration.views.axis_agreement()}"
    except FlatclothError as error:
        return f"The turning axis was set by hand. {error}"


def axis_info(axis: RotationAxis) -> AxisInfo:
    """Return a turning axis as the camera of view 0 sees it."""
    lean_deg = np.degrees(np.arcsin(axis.direction))
    return AxisInfo(
        right_m=float(axis.point_m[0]),
        away_m=float(axis.point_m[2]),
        lean_right_deg=float(lean_deg[0]),
        lean_away_deg=float(lean_deg[2]),
        estimated=axis.estimated,
    )


def meant_axis(axis: RotationAxis, message: SetAxis) -> RotationAxis:
    """Return the axis that a message describes in the place of another."""
    right, away = np.sin(np.radians([message.lean_right_deg, message.lean_away_deg]))
    up = np.copysign(np.sqrt(max(0.0, 1.0 - right**2 - away**2)), axis.direction[1])
    return replace(
        axis,
        point_m=np.array([message.right_m, axis.point_m[1], message.away_m]),
        direction=np.array([right, up, away]),
        estimated=True,
    )


def joins(integration: Integration, document: Document) -> bool:
    """Return whether the cloth of the proposal belongs to the shape, if it is accepted where it lies.

    The shape with it is kept, so that accepting it takes no time.
    """
    pending = document.pending
    assert pending is not None
    made = integration.canonical(accept(document, None))
    return is_on_shape(integration.views, made, pending.view_index, pending.component)


def placed(document: Document, overlay: Overlay | None) -> tuple[Pending, Overlay] | None:
    """Return the proposal with its picture, None while there is none."""
    pending = document.pending
    if overlay is None or pending is None or overlay.proposal.view_index != pending.view_index:
        return None
    return pending, overlay


def score_shown(picture: Picture | None, document: Document) -> float | None:
    """Return the score of the present placement of the proposal, if that is shown."""
    if picture is None or picture.overlay is None or picture.document is not document:
        return None
    return finite(picture.overlay.score.total)


def meant(shown: tuple[Pending, Overlay] | None, asked: Move) -> Rigid2:
    """Return the nudge that the page means, whose turn is about the centre of the shown proposal."""
    by = Rigid2(asked.theta_rad, asked.u_m, asked.v_m)
    if shown is None:
        return by
    pending, overlay = shown
    return overlay.meant(pending, by.about(np.array(center_uv_m(pending, overlay))))


def placing_piece(
    integration: Integration,
    document: Document,
    sheet: Sheet | None,
    asked: PlacePiece,
    known: KnownGarment | None = None,
    laid: Sequence[LaidPiece] = (),
) -> tuple[tuple[Command, ...], Ghosts]:
    """Return the decisions that make a floating piece the proposal, and where else it may belong.

    ``known`` is the garment, if it was recognised; ``laid`` are the pieces that seams lay.

    Raises
    ------
    FlatclothError
        If there is no such piece, or only the start view shows it.
    """
    piece = next((p for p in (() if sheet is None else sheet.pieces) if p.label == asked.label), None)
    if sheet is None or piece is None:
        raise FlatclothError(f"There is no floating piece {asked.label!r:.20}; look again.")
    accepted = [a.view_index for a in document.accepted]
    found = place_of_piece(integration.views, piece, accepted)
    plane_from_own = piece.sheet_from_plane.inverse() @ found.placement

    def ghost(source: Literal["garment", "seams"], shape_from_piece: Rigid2, std_m: float) -> Ghost:
        motion = shape_from_piece @ plane_from_own
        return Ghost(source=source, theta_rad=motion.theta_rad, u_m=motion.u_m, v_m=motion.v_m, std_m=std_m)

    is_known = known is not None and known.is_of(sheet.canonical)
    own = known.found.pieces if known is not None and is_known else ()
    places = [
        *(ghost("garment", p.shape_from_piece, p.std_m) for p in own if p.index == piece.number - 1),
        *(ghost("seams", p.shape_from_piece, p.std_m) for p in laid if p.index == piece.number - 1),
    ]
    own_placement = Rigid2(0.0, asked.u_m, asked.v_m) @ found.placement
    commands = Reopen(found.view_index), TakePart(found.view_index, found.component, own_placement)
    ghosts = Ghosts(view_index=found.view_index, component=found.component, places=tuple(places))
    return commands, ghosts
