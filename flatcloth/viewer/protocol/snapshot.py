"""Makes the parts of the page's state: what a session adds to it, layers, the proposal."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from msgspec import structs

from flatcloth.core.types import Rigid2
from flatcloth.engine.sheet import Sheet, floating_file, label_of, other_floating_file
from flatcloth.engine.warmup import is_compiling
from flatcloth.rendering.colormaps import piece_color
from flatcloth.rendering.layers import DIFFERENCES, difference_legend, hex_of
from flatcloth.rendering.pictures import grid_of
from flatcloth.session.document import Document, Pending
from flatcloth.session.kept import Ghosts
from flatcloth.session.machine import Propose, Reopen, SessionState, Start, why_illegal
from flatcloth.viewer.protocol.actions import action_table
from flatcloth.viewer.protocol.picture import OtherSheet, Overlay, Picture
from flatcloth.viewer.protocol.sent import Grid, Legend, Motion, Progress, typed
from flatcloth.viewer.protocol.state import (
    FloatingPiece,
    GhostInfo,
    JoinedPieceInfo,
    Layers,
    OverlayInfo,
    PendingInfo,
    PendingPart,
    ViewRow,
    ViewState,
)


def of_session(
    state: SessionState,
    picture: Picture | None,
    angles_deg: tuple[float, ...],
    reviewed: Mapping[int, dict[str, Any]],
    progress: Progress | None,
    trouble: str,
) -> dict[str, Any]:
    """Return the fields of the state of a session.

    ``reviewed`` are fields of the rows of decided views; ``trouble`` is why the shape cannot be drawn.
    """
    document, request = state.document, state.request
    # The session is ahead of what is shown until its picture is computed.
    behind = document.start_view is not None and (picture is None or picture.document is not document)
    drawing = behind and not trouble
    compiling = drawing and is_compiling()
    text = "compiling, first start only; then the shape is drawn"
    return {
        "mode": "session",
        "phase": state.phase.value,
        "actions": action_table(state),
        "present_view": document.present_view,
        "angle_deg": None if document.present_view is None else angles_deg[document.present_view],
        "step": len(document.used_views),
        "start_view": document.start_view,
        "finished": document.finished,
        "undo": state.undo[-1].name if state.undo else None,
        "redo": state.redo[-1].name if state.redo else None,
        "n_later": len(document.later),
        "request": request,
        "views": tuple(_view(state, i, a, reviewed.get(i, {})) for i, a in enumerate(angles_deg)),
        "progress": progress or (Progress(share=0.0, text=text) if compiling else None),
        "pending": _pending(document, picture),
        "drawing": drawing,
        "trouble": trouble if behind else "",
    }


def _view(state: SessionState, index: int, angle_deg: float, reviewed: dict[str, Any]) -> ViewRow:
    document = state.document
    word, detail, score = _verdict(document, index)
    command = Start(index) if document.start_view is None else Propose(index)
    return ViewRow(
        index=index,
        angle_deg=angle_deg,
        state=word,
        detail=detail,
        score=score,
        follows=_follows(document, index),
        why_not=why_illegal(state, command) if word != "pending" else "This view is the proposal.",
        why_not_reopen=why_illegal(state, Reopen(index)),
        **reviewed,
    )


def _verdict(document: Document, index: int) -> tuple[ViewState, str, float | None]:
    """Return the state of a view in a word, its reason, and the score that it was accepted with."""
    if index == document.start_view:
        return "start", "", None
    if document.pending is not None and index == document.pending.view_index:
        return "pending", document.pending.why, None
    for accepted in document.accepted:
        if accepted.view_index == index:
            return "fixed" if accepted.fixed else "accepted", "", accepted.score
    for later in document.later:
        if later.decision.view_index == index:
            return "later", "", later.decision.score
    for rejected in document.rejected:
        if rejected.view_index == index:
            return "rejected", rejected.reason, None
    return "skipped" if any(s.view_index == index for s in document.skipped) else "unused", "", None


def _follows(document: Document, index: int) -> int:
    """Return the number of later views that follow an accepted one if it is decided again."""
    order = [*document.accepted, *(later.decision for later in document.later)]
    at = next((n for n, a in enumerate(order) if a.view_index == index), None)
    return 0 if at is None else len(order) - 1 - at


def _pending(document: Document, picture: Picture | None) -> PendingInfo | None:
    pending, overlay = document.pending, None if picture is None else picture.overlay
    if pending is None:
        return None
    if overlay is not None and overlay.proposal.view_index != pending.view_index:
        overlay = None  # of the proposal before; this one's is on its way
    return PendingInfo(
        view_index=pending.view_index,
        side=None if pending.side is None else pending.side.value,
        score=pending.score if overlay is None else overlay.score.total,
        nudge=_motion(_about_center(pending, overlay)),
        why=pending.why,
        again=pending.again is not None,
        **({} if overlay is None else _computed(pending, overlay)),
    )


def _computed(pending: Pending, overlay: Overlay) -> dict[str, Any]:
    """Return what the method has computed for a proposal, as fields of it."""
    placement = overlay.proposal.placement
    return {
        "pieces": tuple(
            PendingPart(
                component=part.component,
                area_cm2=1e4 * part.area_m2,
                waits=part.alignment is None,
                chosen=part.component == pending.component,
            )
            for part in placement.parts
        ),
        "also": overlay.also,
        "extends": label_of(overlay.piece(pending)),
        "brings": _joined(overlay),
        "foreseen": overlay.foreseen,
        "checks": overlay.checks,
    }


def with_ghosts(pending: PendingInfo | None, overlay: Overlay | None, ghosts: Ghosts) -> PendingInfo | None:
    """Return the proposal with the places where it may belong, if it is that of the piece placed by hand."""
    if pending is None or overlay is None or pending.view_index != ghosts.view_index:
        return pending
    if not any(part.chosen and part.component == ghosts.component for part in pending.pieces):
        return pending
    center = np.array(overlay.own_center_uv_m)
    places = (
        GhostInfo(
            source=ghost.source,
            placement=overlay.sheet.shown(ghost.motion, center),
            std_mm=1e3 * ghost.std_m,
        )
        for ghost in ghosts.places
    )
    return structs.replace(pending, ghosts=tuple(places))


def _joined(overlay: Overlay) -> JoinedPieceInfo | None:
    """Return the letter of the piece that the proposal joins to the shape, and its motion on the sheet."""
    if overlay.joined_piece is None:
        return None
    piece = overlay.sheet.piece_on_plane(overlay.joined_piece.center_uv_m)
    motion = overlay.joined_piece.target_from_piece @ overlay.sheet.shift(piece).inverse()
    return None if piece == 0 else JoinedPieceInfo(label=label_of(piece), placement=motion)


def _about_center(pending: Pending, overlay: Overlay | None) -> Rigid2:
    """Return a nudge as a turn about the proposal's own centre and the shift of that, as one sees it."""
    if overlay is None:
        return pending.nudge
    own = np.array(overlay.own_center_uv_m)
    shift = overlay.shown(pending).apply(own) - overlay.sheet.shown(pending.proposed, own).apply(own)
    return Rigid2(pending.nudge.theta_rad, float(shift[0]), float(shift[1]))


def _motion(motion: Rigid2) -> Motion:
    return Motion(theta_deg=math.degrees(motion.theta_rad), u_mm=1000 * motion.u_m, v_mm=1000 * motion.v_m)


def layers_of_shape(picture: Picture) -> Layers:
    """Return the layers of the shape, or of a frame, with the proposal on it."""
    return Layers(
        revision=picture.revision,
        area_cm2=(picture.view.area_m2 if picture.sheet is None else picture.sheet.shape_m2) * 1e4,
        pieces=() if picture.sheet is None else _floating(picture.sheet),
        legends=picture.legends,
        overlay=_overlay(picture),
        **grid_of(picture.view),
    )


def layers_of_other(other: OtherSheet) -> Layers:
    """Return the layers of the other side; no proposal lies on it."""
    return Layers(
        revision=other.revision,
        area_cm2=1e4 * other.sheet.shape_m2,
        pieces=_floating(other.sheet, other_floating_file),
        legends=other.legends,
        overlay=None,
        **grid_of(other.view),
    )


def _floating(sheet: Sheet, file_of: Callable[[int], str] = floating_file) -> tuple[FloatingPiece, ...]:
    return tuple(
        FloatingPiece(
            label=piece.label,
            file=file_of(piece.number),
            area_cm2=1e4 * piece.view.area_m2,
            reason=piece.reason,
            views=tuple(piece.views),
            color=hex_of(piece_color(n)),
            placed=piece.placed is not None,
            grid=Grid(**grid_of(piece.view)),
        )
        for n, piece in enumerate(sheet.pieces, start=1)
    )


def _overlay(picture: Picture) -> OverlayInfo | None:
    overlay, pending = picture.overlay, None if picture.document is None else picture.document.pending
    if overlay is None or pending is None:
        return None
    return OverlayInfo(
        revision=overlay.revision,
        view_index=overlay.proposal.view_index,
        center_uv_m=center_uv_m(pending, overlay),
        differences={kind: typed(difference_legend(kind), Legend) for kind in DIFFERENCES},
        placement=overlay.shown(pending),
        **grid_of(overlay.view),
    )


def center_uv_m(pending: Pending, overlay: Overlay) -> tuple[float, float]:
    """Return the centre of the proposal on the plane, about which nudges rotate."""
    u_m, v_m = overlay.shown(pending).apply(np.array(overlay.own_center_uv_m)).tolist()
    return float(u_m), float(v_m)
