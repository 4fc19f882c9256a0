"""The state that every tab receives in full, as plain JSON values."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from flatcloth.core.types import Rigid2, RotationAxis, finite
from flatcloth.engine.sheet import Sheet, label_of
from flatcloth.engine.warmup import is_compiling
from flatcloth.rendering.colormaps import piece_color
from flatcloth.rendering.layers import DIFFERENCES, LAYERS, difference_legend, hex_of
from flatcloth.rendering.pictures import grid_of
from flatcloth.session.machine import Document, Pending, Propose, Reopen, SessionState, Start, why_illegal
from flatcloth.viewer.protocol.actions import REJECT_REASONS
from flatcloth.viewer.protocol.allowed import action_table
from flatcloth.viewer.protocol.picks import PickStore, PlaceStore, numbers
from flatcloth.viewer.protocol.picture import Overlay, Picture

if TYPE_CHECKING:
    from flatcloth.engine.integration import Integration
    from flatcloth.session.journal import Pick
    from flatcloth.viewer.modes.player import Shown
    from flatcloth.viewer.modes.playhead import Playhead


@dataclass(frozen=True, kw_only=True)
class Note:
    """A notification for the operator; ``level`` is ``info``, ``warning`` or ``error``."""

    id: int
    level: str
    text: str
    time_s: float

    def plain(self) -> dict[str, Any]:
        """Return JSON values."""
        return {"id": self.id, "level": self.level, "text": self.text, "time_s": self.time_s}


@dataclass(frozen=True, kw_only=True)
class PageStatus:
    """The state of the page outside the session: Auto, progress, messages."""

    auto: bool = False
    edges: bool = False
    progress: tuple[float, str] | None = None
    log: tuple[Note, ...] = field(default=())


def snapshot(
    revision: int,
    state: SessionState,
    status: PageStatus,
    picks: PickStore,
    picture: Picture | None,
    integration: Integration,
    places: PlaceStore,
) -> dict[str, Any]:
    """Return the whole state of the page."""
    recording = integration.recording
    document = state.document
    present = document.present_view
    # The session is ahead of what is shown until the shape is drawn anew.
    drawing = document.start_view is not None and (picture is None or picture.document is not document)
    return {
        **_common(revision, status, picks, picture, integration, places),
        "mode": "session",
        "phase": state.phase.value,
        "step": len(document.used_views),
        "start_view": document.start_view,
        "finished": document.finished,
        "undo": state.undo[-1].name if state.undo else None,
        "redo": state.redo[-1].name if state.redo else None,
        "n_later": len(document.later),
        "request": None
        if state.request is None
        else {"kind": state.request.kind, "view_index": state.request.view_index},
        "present_view": present,
        "angle_deg": None if present is None else recording.angles_deg[present],
        "views": [_view(state, i, recording.angles_deg[i]) for i in range(len(recording))],
        "actions": action_table(state),
        "reject_reasons": list(REJECT_REASONS),
        "progress": _progress(status, drawing),
        "pending": _pending(document, picture),
        "drawing": drawing,
    }


def _progress(status: PageStatus, drawing: bool) -> dict[str, Any] | None:
    if status.progress is not None:
        share, text = status.progress
        return {"share": share, "text": text}
    if drawing and is_compiling():
        return {"share": 0.0, "text": "compiling, first start only; then the shape is drawn"}
    return None


def live_snapshot(
    revision: int,
    head: Playhead,
    shown: Shown | None,
    status: PageStatus,
    picks: PickStore,
    integration: Integration,
    places: PlaceStore,
) -> dict[str, Any]:
    """Return the whole state of the page in live mode, without the data sent with each frame."""
    angles_deg = integration.recording.angles_deg
    present = None if shown is None else shown.frame
    return {
        **_common(revision, status, picks, None if shown is None else shown.picture, integration, places),
        "mode": "live",
        "phase": "live",
        "step": 0,
        "start_view": None,
        "finished": None,
        "undo": None,
        "redo": None,
        "n_later": 0,
        "request": None,
        "present_view": present,
        "angle_deg": None if present is None else angles_deg[present],
        "views": [
            {"index": i, "angle_deg": angle_deg, "state": "unused", "detail": "", "why_not": None}
            for i, angle_deg in enumerate(angles_deg)
        ],
        "actions": action_table(None),
        "reject_reasons": list(REJECT_REASONS),
        "progress": None,
        "pending": None,
        "live": {"playing": head.playing, "forward": head.forward, "fps": head.fps},
    }


def _common(
    revision: int,
    status: PageStatus,
    picks: PickStore,
    picture: Picture | None,
    integration: Integration,
    places: PlaceStore,
) -> dict[str, Any]:
    recording = integration.recording
    return {
        "type": "state",
        "revision": revision,
        "method": integration.method,
        "recording": {
            "name": recording.name,
            "description": recording.description,
            "n_views": len(recording),
        },
        "notes": list(integration.notes),
        "auto": {"running": status.auto},
        "edges": status.edges,
        "layers": None if picture is None else _layers(picture),
        "pick": _pick(picks, picture, places, integration.axis),
        "picks": [_listed(p, picture, places) for p in picks.picks],
        "log": [n.plain() for n in status.log],
    }


def _view(state: SessionState, index: int, angle_deg: float) -> dict[str, Any]:
    document = state.document
    word, detail, score = _verdict(document, index)
    command = Start(index) if document.start_view is None else Propose(index)
    return {
        "index": index,
        "angle_deg": angle_deg,
        "state": word,
        "detail": detail,
        "score": score,
        "follows": _follows(document, index),
        "why_not": why_illegal(state, command) if word != "pending" else "This view is the proposal.",
        "why_not_reopen": why_illegal(state, Reopen(index)),
    }


def _verdict(document: Document, index: int) -> tuple[str, str, float | None]:
    """Return the state of a view in a word, its reason, and the score that it was accepted with."""
    if index == document.start_view:
        return "start", "", None
    if document.pending is not None and index == document.pending.view_index:
        return "pending", document.pending.why, None
    for accepted in document.accepted:
        if accepted.view_index == index:
            return "fixed" if accepted.fixed else "accepted", "", finite(accepted.score)
    for later in document.later:
        if later.decision.view_index == index:
            return "later", "", finite(later.decision.score)
    for rejected in document.rejected:
        if rejected.view_index == index:
            return "rejected", rejected.reason, None
    return "skipped" if any(s.view_index == index for s in document.skipped) else "unused", "", None


def _follows(document: Document, index: int) -> int:
    """Return the number of later views that follow an accepted one if it is decided again."""
    order = [*document.accepted, *(later.decision for later in document.later)]
    at = next((n for n, a in enumerate(order) if a.view_index == index), None)
    return 0 if at is None else len(order) - 1 - at


def _pending(document: Document, picture: Picture | None) -> dict[str, Any] | None:
    pending, overlay = document.pending, None if picture is None else picture.overlay
    if pending is None:
        return None
    if overlay is not None and overlay.proposal.view_index != pending.view_index:
        overlay = None  # of the proposal before; this one's is on its way
    plan = None if overlay is None else overlay.proposal.plan
    return {
        "view_index": pending.view_index,
        "side": None if pending.side is None else pending.side.value,
        "proposed_score": finite(pending.score),
        "score": finite(pending.score if overlay is None else overlay.score.total),
        "parts": {} if overlay is None else {k: finite(float(v)) for k, v in overlay.score.parts.items()},
        "nudge": _motion(_about_center(pending, overlay)),
        "why": pending.why,
        "again": pending.again is not None,
        "reason": "" if plan is None else plan.reason,
        "rotation_deg": None if plan is None else finite(float(plan.rotation_deg)),
        "pieces": _pieces(pending, overlay),
        "also": [] if overlay is None else [asdict(part) for part in overlay.also],
        "extends": None if overlay is None else label_of(overlay.piece(pending)),
        "brings": _brings(overlay),
        "foreseen": None if overlay is None else overlay.foreseen,
        "checks": [] if overlay is None else list(overlay.checks),
        **_placing(overlay),
    }


def _brings(overlay: Overlay | None) -> dict[str, Any] | None:
    """Return the letter of the piece that the proposal joins to the shape, and its motion on the sheet."""
    if overlay is None or overlay.joined_piece is None:
        return None
    piece = overlay.sheet.piece_on_plane(overlay.joined_piece.center_uv_m)
    motion = overlay.joined_piece.target_from_piece @ overlay.sheet.shift(piece).inverse()
    placement = {"theta_rad": motion.theta_rad, "u_m": motion.u_m, "v_m": motion.v_m}
    return None if piece == 0 else {"label": label_of(piece), "placement": placement}


def _pieces(pending: Pending, overlay: Overlay | None) -> list[dict[str, Any]]:
    """Return the parts of the proposal that can be placed; ``waits``: the method finds no place for it."""
    placement = None if overlay is None else overlay.proposal.placement
    return [
        {
            "component": part.component,
            "area_cm2": 1e4 * part.area_m2,
            "waits": part.hypothesis is None,
            "chosen": part.component == pending.component,
        }
        for part in (() if placement is None else placement.parts)
    ]


def _about_center(pending: Pending, overlay: Overlay | None) -> Rigid2:
    """Return a nudge as a turn about the proposal's own centre and the shift of that, as one sees it."""
    if overlay is None:
        return pending.nudge
    own = np.array(overlay.own_center_uv_m)
    shift = overlay.shown(pending).apply(own) - overlay.sheet.shown(pending.proposed, own).apply(own)
    return Rigid2(pending.nudge.theta_rad, float(shift[0]), float(shift[1]))


def _placing(overlay: Overlay | None) -> dict[str, Any]:
    """Return additional results of the method ``robust``: margin, undetermined directions, hypotheses."""
    placement = None if overlay is None else overlay.proposal.placement
    if overlay is None or placement is None or not placement.hypotheses:
        return {"margin": None, "cameras": "", "undetermined": [], "hypotheses": []}
    return {
        "cameras": placement.cameras,
        "margin": finite(float(placement.margin)),
        "undetermined": list(placement.hypotheses[0].undetermined),
        "hypotheses": [
            {
                "source": h.source,
                "score": finite(h.score.total),
                **_motion(_shown(overlay, h.current_from_new)),
            }
            for h in placement.hypotheses
        ],
    }


def _motion(motion: Rigid2) -> dict[str, float]:
    return {"theta_deg": math.degrees(motion.theta_rad), "u_mm": 1000 * motion.u_m, "v_mm": 1000 * motion.v_m}


def _layers(picture: Picture) -> dict[str, Any]:
    return {
        "revision": picture.revision,
        "names": list(LAYERS),
        "area_cm2": (picture.view.area_m2 if picture.sheet is None else picture.sheet.shape_m2) * 1e4,
        "pieces": [] if picture.sheet is None else _floating(picture.sheet),
        "legends": picture.legends,
        "overlay": _overlay(picture),
        **grid_of(picture.view),
    }


def _floating(sheet: Sheet) -> list[dict[str, Any]]:
    """Return the floating pieces: letter, area, reason, views, color, and their rectangles on the sheet."""
    return [
        {
            "label": piece.label,
            "file": piece.file,
            "area_cm2": 1e4 * piece.view.area_m2,
            "reason": piece.reason,
            "views": list(piece.views),
            "color": hex_of(piece_color(n)),
            "placed": piece.placed is not None,
            "grid": grid_of(piece.view),
        }
        for n, piece in enumerate(sheet.pieces, start=1)
    ]


def _shown(overlay: Overlay, motion: Rigid2) -> Rigid2:
    return overlay.sheet.shown(motion, np.array(overlay.own_center_uv_m))


def _overlay(picture: Picture) -> dict[str, Any] | None:
    """Return the position of the proposal; ``placement`` maps its own plane to it."""
    overlay, pending = picture.overlay, None if picture.document is None else picture.document.pending
    if overlay is None or pending is None:
        return None
    at = overlay.shown(pending)
    return {
        "revision": overlay.revision,
        "view_index": overlay.proposal.view_index,
        "center_uv_m": list(center_uv_m(pending, overlay)),
        "differences": {kind: difference_legend(kind) for kind in DIFFERENCES},
        "placement": {"theta_rad": at.theta_rad, "u_m": at.u_m, "v_m": at.v_m},
        **grid_of(overlay.view),
    }


def center_uv_m(pending: Pending, overlay: Overlay) -> tuple[float, float]:
    """Return the centre of the proposal on the plane, about which nudges rotate."""
    u_m, v_m = overlay.shown(pending).apply(np.array(overlay.own_center_uv_m)).tolist()
    return float(u_m), float(v_m)


def _pick(
    picks: PickStore, picture: Picture | None, places: PlaceStore, axis: RotationAxis
) -> dict[str, Any] | None:
    current = picks.current
    if current is None or picture is None:
        return None
    place = places.place(picture, current.pick.position_held_m)
    return numbers(current, place, picture, axis, picks.pose(picture))


def _listed(pick: Pick, picture: Picture | None, places: PlaceStore) -> dict[str, Any]:
    listed: dict[str, Any] = {
        "id": pick.id,
        "name": pick.name,
        "view_index": pick.view_index,
        "position_held_m": [float(x) for x in pick.position_held_m],
        "uv_m": None,
    }
    if picture is not None:
        place = places.place(picture, pick.position_held_m)
        if place.in_shape:
            listed["uv_m"] = list(place.uv_m)
    return listed
