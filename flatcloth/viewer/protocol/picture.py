"""The picture of a document, computed by the worker; immutable. And what the page is told of it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from flatcloth.core.cache import Cache
from flatcloth.core.errors import FlatclothError
from flatcloth.core.geometry import height_m, z_angle_deg
from flatcloth.core.types import (
    Bool,
    FlattenedView,
    Float64,
    Floats,
    Int16,
    LaidPiece,
    Rigid2,
    RotationAxis,
    finite,
)
from flatcloth.engine.integration import Integration
from flatcloth.engine.sheet import (
    Sheet,
    beyond,
    center_uv_m,
    floating_file,
    label_of,
    other_floating_file,
    outline_loops,
    overlay_on,
    sheet_of,
)
from flatcloth.engine.views import ViewCloud
from flatcloth.engine.warmup import is_compiling
from flatcloth.export.page import pieces_of
from flatcloth.grasping.visibility import Projection, Visibility, project
from flatcloth.methods.answers import AlignmentScore, JoinedPiece, JoinedSides, Placement
from flatcloth.methods.paper.merging import shows
from flatcloth.recordings.base import Recording, fingerprint
from flatcloth.rendering.layers import CONFLICT_M, difference, difference_legends, legends
from flatcloth.rendering.pictures import grid_of
from flatcloth.session.document import Document, Pending
from flatcloth.session.journal import SheetSide
from flatcloth.session.machine import Propose, Reopen, SessionState, Start, why_illegal
from flatcloth.shape.shape import Change
from flatcloth.validation.kit import kit_of
from flatcloth.viewer.protocol import sent
from flatcloth.viewer.protocol.actions import action_table
from flatcloth.viewer.protocol.messages import Hover
from flatcloth.viewer.protocol.sent import UV, typed

APART_LIMIT_MM = 1000.0 * CONFLICT_M  # as in the 3D scene
SHARE_LIMIT = 0.1
"""As without an operator: of a larger share that contradicts, no view is accepted."""
_JOINS_M2 = 2e-4
"""A piece is joined if the proposal covers so much of it."""


@dataclass(frozen=True, kw_only=True)
class Overlay:
    """The pending view on the plane of the shape, at its effective placement.

    ``own_center_uv_m`` is the centre of its part on its own plane: what nudges turn it about. ``view``
    lies on the sheet, where placements are shown; ``new_points`` are those beyond all cloth of the sheet.
    """

    revision: int
    view: FlattenedView
    own_center_uv_m: tuple[float, float]
    new_points: Bool
    score: AlignmentScore
    view_index: int
    proposal: Placement
    sheet: Sheet
    foreseen: sent.Foreseen | None = None
    checks: tuple[sent.Check, ...] = ()
    joined_piece: JoinedPiece | None = None
    also: tuple[sent.PlacedPartInfo, ...] = ()

    def shown(self, pending: Pending) -> Rigid2:
        """Return the placement in force as it is on the sheet."""
        return self.sheet.shown(pending.current_from_new, np.array(self.own_center_uv_m))

    def piece(self, pending: Pending) -> int:
        """Return the piece of the sheet that the placement in force lies on, 0 the shape."""
        center = np.array(self.own_center_uv_m)
        return self.sheet.piece_on_plane(pending.current_from_new.apply(center))

    def meant(self, pending: Pending, by: Rigid2) -> Rigid2:
        """Return the nudge on the method's plane that is meant by a motion on the sheet."""
        center, shown = np.array(self.own_center_uv_m), self.shown(pending)
        target = by @ shown
        if self.piece(pending) == self.sheet.piece_at(target.apply(center)) == 0:
            if shown == pending.current_from_new:
                return by  # exactly, as on a plane without pieces
        return self.sheet.meant(target, center) @ pending.current_from_new.inverse()


@dataclass(frozen=True, kw_only=True, eq=False)
class OtherSheet:
    """The other side of the item, as seen from its own outside, on a sheet with its floating pieces.

    ``revision`` grows with each result; ``key`` is what both sides depend on.
    """

    revision: int
    key: Hashable
    sides: JoinedSides
    sheet: Sheet
    legends: dict[str, sent.Legend]

    @property
    def view(self) -> FlattenedView:
        """All of its cloth."""
        return self.sheet.view


@dataclass(frozen=True, kw_only=True)
class Frame:
    """What a page shows: a flattened frame of a camera, or the :class:`Picture` of a document.

    ``revision`` changes whenever the flattened ``view`` does. A frame of a camera has no proposal
    (``overlay``), and no other side.
    """

    revision: int
    view: FlattenedView
    legends: dict[str, sent.Legend]
    present_view: int = 0
    angle_deg: float = 0.0
    overlay: Overlay | None = None
    other: OtherSheet | None = None

    def side(self, side: SheetSide) -> FlattenedView:
        """Return the cloth of a side of the item.

        Raises
        ------
        FlatclothError
            If the other side is not known.
        """
        if side == "this":
            return self.view
        if self.other is None:
            raise FlatclothError("The other side is not known; turn the garment over to compute it.")
        return self.other.view

    def pieces(self, side: SheetSide) -> tuple[FlattenedView, ...]:
        """Return the shape of a side and its floating pieces, as they are exported; empty: not known."""
        return (self.view,) if side == "this" else ()


@dataclass(frozen=True, kw_only=True)
class Picture(Frame):
    """The picture of a document; ``cloud`` is that of the present view; ``other`` None: it is not known.

    ``view`` holds the shape and its floating pieces, as the ``sheet`` has laid them out.
    """

    document: Document
    sheet: Sheet
    cloud: ViewCloud

    def pieces(self, side: SheetSide) -> tuple[FlattenedView, ...]:
        """Return the shape of a side and its floating pieces, as they are exported; empty: not known."""
        if side == "this":
            return (self.sheet.canonical.view, *self.sheet.canonical.floating)
        its = None if self.other is None else self.other.sides.other
        return () if its is None else (its.view, *its.floating)


def make_picture(
    integration: Integration,
    document: Document,
    previous: Picture | None,
    laid: Sequence[LaidPiece] = (),
    edge_m: float = -math.inf,
) -> Picture:
    """Compute the picture of a document with a start view.

    The shape is laid out on a sheet with its floating pieces; the proposal is laid on the sheet; the cloud
    is that of the present view; ``laid`` are pieces that seams join to the shape; floating ones keep clear of
    what ends at u ``edge_m``. What has not changed since ``previous`` is taken from it.
    """
    present = document.present_view
    assert present is not None
    angles_deg = integration.recording.angles_deg
    drawn = None if previous is None else previous.sheet
    sheet = sheet_of(integration.canonical(document), document, laid, drawn, edge_m)
    if sheet is not drawn:
        sheet = replace(sheet, view=with_errors(sheet.view, integration.recording, sheet.piece))
    same = previous if previous is not None and previous.sheet is sheet else None
    overlay = None
    if document.pending is not None:
        before = None if previous is None else previous.overlay
        overlay = _overlay(integration, document, document.pending, sheet, before)
    return Picture(
        revision=next(_revisions) if same is None else same.revision,
        document=document,
        view=sheet.view,
        present_view=present,
        angle_deg=angles_deg[present],
        cloud=integration.views.cloud(present),
        legends=same.legends if same else legends_of(sheet.view, integration),
        overlay=overlay,
        sheet=sheet,
    )


_SEEN: Cache[dict[int, Float64]] = Cache(200)
"""The markers of views. Chosen: those of a few recordings."""


def with_errors(view: FlattenedView, recording: Recording, piece: Int16 | int = 0) -> FlattenedView:
    """Return a view with the error of each pixel, if the recording has a kit: its markers are found once."""
    try:
        kit, this = kit_of(recording), (recording.location, fingerprint(recording))
    except FlatclothError:
        return view
    from flatcloth.validation.markers import KitTruth, found_markers

    truth = KitTruth(kit, lambda n: _SEEN.get((*this, n), lambda: found_markers(recording[n].color, kit)))
    return truth.with_errors(view, piece)


def legends_of(view: FlattenedView, integration: Integration) -> dict[str, sent.Legend]:
    """Return the legend of each layer of a view."""
    angles_deg = integration.recording.angles_deg
    return typed(legends(view, integration.axis, angles_deg), dict[str, sent.Legend])


_revisions, _overlay_revisions = itertools.count(1), itertools.count(1)


def _overlay(
    integration: Integration, document: Document, pending: Pending, sheet: Sheet, before: Overlay | None
) -> Overlay:
    """Return the proposal on the sheet, with what accepting it would do, and the checks of it."""
    view = overlay_on(integration, document, sheet)
    if before is not None and before.view is view and before.sheet is sheet:
        return before
    center = center_uv_m(integration.views.part(pending.view_index, pending.component))
    own_piece = sheet.piece_on_plane(pending.current_from_new.apply(np.array(center)))
    new_points = beyond(view, sheet.view)
    proposal, score = integration.proposal(document), integration.score(document)
    others = _other_components(integration, document, pending, sheet, proposal)
    return Overlay(
        revision=next(_overlay_revisions),
        view=view,
        own_center_uv_m=center,
        new_points=new_points,
        sheet=sheet,
        score=score,
        view_index=pending.view_index,
        proposal=proposal,
        joined_piece=integration.algorithm.joined_piece(document),
        also=_placed_with_it(integration, pending, sheet),
        foreseen=_foreseen(sheet, own_piece, [(view, new_points), *others], proposal.change),
        checks=_checks(sheet, view, score, integration.axis),
    )


def _placed_with_it(
    integration: Integration, pending: Pending, sheet: Sheet
) -> tuple[sent.PlacedPartInfo, ...]:
    own = integration.views.part(pending.view_index, pending.component)
    own_from_plane = pending.current_from_new.inverse()
    found = []
    for placed in pending.also_placed:
        part = integration.views.part(placed.view_index, placed.component)
        uv = placed.current_from_new.apply(part.uv_from_rc(np.argwhere(part.valid)))
        alone = uv[~shows(sheet.view, uv) & ~shows(own, own_from_plane.apply(uv))]
        points = alone if len(alone) else uv
        u_m, v_m = points[np.argmin(np.linalg.norm(points - np.median(points, axis=0), axis=1))]
        found.append(
            sent.PlacedPartInfo(
                view_index=placed.view_index,
                component=placed.component,
                area_cm2=1e4 * part.area_m2,
                place_uv_m=(float(u_m), float(v_m)),
            )
        )
    return tuple(found)


def _other_components(
    integration: Integration, document: Document, pending: Pending, sheet: Sheet, proposal: Placement
) -> list[tuple[FlattenedView, Bool]]:
    """Return the other components of the proposed view, and where each has cloth that the sheet has not.

    They join the shape together with the chosen one; one without a place floats, and is new altogether.
    """
    found = []
    for other in proposal.parts:
        if other.component == pending.component:
            continue
        view = integration.views.part(pending.view_index, other.component)
        new = view.valid
        if other.alignment is not None:
            shown = sheet.shown(other.alignment.current_from_new, np.array(center_uv_m(view)))
            placed = replace(pending, component=other.component, proposed=shown, nudge=Rigid2())
            view = integration.overlay(replace(document, pending=placed))
            new = beyond(view, sheet.view)
        found.append((view, new))
    return found


def _foreseen(
    sheet: Sheet,
    own_piece: int,
    components: Sequence[tuple[FlattenedView, Bool]],
    change: Change | None,
) -> sent.Foreseen:
    """Return what accepting a proposal on a piece would add (cm2), and join.

    ``components`` are those of the view, the chosen one first, each with where it is new.
    """
    view = components[0][0]
    pixel_cm2 = 1e4 * view.pixel_size_m**2
    added = sum(int(new.sum()) for _, new in components)
    rc = np.rint(sheet.view.rc_from_uv(view.uv_from_rc(np.argwhere(view.valid)))).astype(int)
    inside = ((rc >= 0) & (rc < sheet.view.shape)).all(axis=1)
    on = sheet.piece[rc[inside, 0], rc[inside, 1]]
    covered = np.bincount(on[on >= 0], minlength=len(sheet.pieces) + 1) * view.pixel_size_m**2
    joins = [label_of(n) for n, area_m2 in enumerate(covered) if n != own_piece and area_m2 >= _JOINS_M2]
    return sent.Foreseen(
        added_cm2=pixel_cm2 * added,
        joins=tuple(joins),
        moved_mm=None if change is None else 1e3 * change.moved_m,
        contradicted=None if change is None else change.contradicted,
    )


def _checks(
    sheet: Sheet, view: FlattenedView, score: AlignmentScore, axis: RotationAxis
) -> tuple[sent.Check, ...]:
    """Return the checks: title, value and limit with their unit, whether it is passed, where it is worst."""
    apart_m = difference(sheet.view, view, axis)["position"]
    common = np.isfinite(apart_m)
    median_mm = 1000 * float(np.median(apart_m[common])) if common.any() else float("nan")
    with np.errstate(invalid="ignore"):
        far = common & (apart_m * 1000 > APART_LIMIT_MM)
    twice, other = (score.parts.get(name, float("nan")) for name in ("twice_share", "other_cloth_share"))
    shared, limit = _middle(view, common), 100 * SHARE_LIMIT
    worst = _middle(view, far) or shared
    return tuple(
        sent.Check(
            name=name,
            title=title,
            value=finite(value),
            limit=limit,
            unit=unit,
            passed=value <= limit if math.isfinite(value) else None,
            place_uv_m=place,
        )
        for name, title, value, limit, unit, place in (
            ("apart", "Apart in space", median_mm, APART_LIMIT_MM, "mm", worst),
            ("twice", "Covered twice", 100 * twice, limit, "%", shared),
            ("other", "On other cloth", 100 * other, limit, "%", shared),
        )
    )


def _middle(view: FlattenedView, where: Bool) -> UV | None:
    """Return a place (u, v) among pixels, near their middle."""
    rc = np.argwhere(where)
    if not len(rc):
        return None
    nearest = rc[np.argmin(np.square(rc - np.median(rc, axis=0)).sum(axis=1))]
    u_m, v_m = view.uv_from_rc(nearest).tolist()
    return u_m, v_m


def values_at(
    view: FlattenedView, u_m: float, v_m: float, axis: RotationAxis, angle_deg: float = 0.0
) -> sent.PixelValues | None:
    """Return all values of the pixel at a position of the plane, None off the cloth.

    ``angle_deg`` is the rotation that ``z_angle_now_deg`` refers to.
    """
    row, col = (int(x) for x in np.floor(view.rc_from_uv(np.array([u_m, v_m])) + 0.5))
    rows, cols = view.shape
    if not (0 <= row < rows and 0 <= col < cols) or not view.valid[row, col]:
        return None
    xyz = view.xyz_m[row, col].astype(np.float64)
    quality = [None] * 3 if view.quality is None else [finite(x) for x in view.quality[row, col].tolist()]
    std_m, error_m = (None if v is None else float(v[row, col]) for v in (view.placement_std_m, view.error_m))
    values = {
        "rc": [row, col],
        "uv_mm": [1000 * u_m, 1000 * v_m],
        "rgb": view.rgb[row, col],
        "xyz_mm": 1000 * xyz,
        "height_mm": 1000 * float(height_m(xyz, axis)),
        "normal": [finite(x) for x in view.normal[row, col].tolist()],
        "z_angle_deg": finite(float(view.z_angle_deg[row, col])),
        "z_angle_now_deg": finite(float(z_angle_deg(view.normal[row, col], axis, angle_deg))),
        "view_index": int(view.view_index[row, col]),
        "source_rc": [finite(x) for x in view.source_rc[row, col].tolist()],
        **dict(zip(("density_px_cm2", "incidence_deg", "stretch"), quality, strict=True)),
        "placement_std_mm": None if std_m is None else finite(1000 * std_m),
        "error_mm": None if error_m is None else finite(1000 * error_m),
    }
    return typed(values, sent.PixelValues)


def described(picture: Frame | None, integration: Integration, hover: Hover) -> sent.HoverAnswer:
    """Describe the point under the pointer, of the shape or of the other side."""
    shape = proposal = None
    if picture is not None and (hover.sheet == "this" or picture.other is not None):
        at = hover.u_m, hover.v_m, integration.axis, picture.angle_deg
        shape = values_at(picture.side(hover.sheet), *at)
        if picture.overlay is not None and hover.sheet == "this":
            proposal = values_at(picture.overlay.view, *at)
    source = None if hover.view is None else place_under(integration, hover.view, proposal or shape)
    return sent.HoverAnswer(id=hover.id, shape=shape, proposal=proposal, source=source)


def place_in_view(
    integration: Integration, view_index: int, position_held_m: Floats, normal_held: Floats
) -> Projection:
    """Return the position of a point (object frame) in the image of a view; see ``visibility.project``."""
    recording = integration.recording
    angle_deg = recording.angles_deg[view_index]
    return project(position_held_m, normal_held, integration.axis, angle_deg, recording.intrinsics)


def place_under(
    integration: Integration, view_index: int, found: sent.PixelValues | None
) -> sent.SourcePlace | None:
    """Return where a pixel of the flattened view is in the image of a view; None if it is not seen there."""
    if found is None or not 0 <= view_index < len(integration.recording):
        return None
    if found.view_index == view_index:
        return sent.SourcePlace(view_index=view_index, rc=found.source_rc)
    position = np.array(found.xyz_mm) / 1000.0
    normal = np.array(found.normal, dtype=np.float64)  # None becomes NaN
    place = place_in_view(integration, view_index, position, normal)
    if place.visibility is not Visibility.SEEN:
        return None
    return sent.SourcePlace(view_index=view_index, rc=(float(place.row), float(place.col)))


def outline_of(view: FlattenedView) -> list[list[UV]]:
    """Return the borders of a view on its plane, to tenths of a millimetre."""
    return [np.round(loop, 4).tolist() for loop in outline_loops(view)]


def of_session(
    state: SessionState,
    picture: Picture | None,
    angles_deg: tuple[float, ...],
    reviewed: Mapping[int, dict[str, Any]],
    progress: sent.Progress | None,
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
        "request": request,
        "views": tuple(_views(state, angles_deg, reviewed)),
        "progress": progress or (sent.Progress(share=0.0, text=text) if compiling else None),
        "pending": _pending(document, picture),
        "drawing": drawing,
        "trouble": trouble if behind else "",
    }


def _views(
    state: SessionState, angles_deg: tuple[float, ...], reviewed: Mapping[int, dict[str, Any]]
) -> Iterator[sent.ViewRow]:
    document = state.document
    # The state of a view in a word, its reason, and the score that it was accepted with; the last one counts.
    verdicts: dict[int | None, tuple[sent.ViewState, str, float | None]] = {
        **{skipped.view_index: ("skipped", "", None) for skipped in document.skipped},
        **{rejected.view_index: ("rejected", rejected.reason, None) for rejected in document.rejected},
        **{a.view_index: ("fixed" if a.fixed else "accepted", "", a.score) for a in document.accepted},
    }
    if document.pending is not None:
        verdicts[document.pending.view_index] = "pending", document.pending.why, None
    verdicts[document.start_view] = "start", "", None
    for index, angle_deg in enumerate(angles_deg):
        word, detail, score = verdicts.get(index, ("unused", "", None))
        command = Start(index) if document.start_view is None else Propose(index)
        yield sent.ViewRow(
            index=index,
            angle_deg=angle_deg,
            state=word,
            detail=detail,
            score=score,
            why_not=why_illegal(state, command) if word != "pending" else "This view is the proposal.",
            why_not_reopen=why_illegal(state, Reopen(index)),
            **reviewed.get(index, {}),
        )


def _pending(document: Document, picture: Picture | None) -> sent.PendingInfo | None:
    pending, overlay = document.pending, None if picture is None else picture.overlay
    if pending is None:
        return None
    if overlay is not None and overlay.view_index != pending.view_index:
        overlay = None  # of the proposal before; this one's is on its way
    shift = np.array([pending.nudge.u_m, pending.nudge.v_m])
    if overlay is not None:  # a nudge is a turn about the proposal's own centre, and the shift of that
        own = np.array(overlay.own_center_uv_m)
        shift = overlay.shown(pending).apply(own) - overlay.sheet.shown(pending.proposed, own).apply(own)
    return sent.PendingInfo(
        view_index=pending.view_index,
        side=None if pending.side is None else pending.side.value,
        score=pending.score if overlay is None else overlay.score.total,
        nudge=sent.Motion(
            theta_deg=math.degrees(pending.nudge.theta_rad),
            u_mm=1000 * float(shift[0]),
            v_mm=1000 * float(shift[1]),
        ),
        why=pending.why,
        **({} if overlay is None else _computed(pending, overlay)),
    )


def _computed(pending: Pending, overlay: Overlay) -> dict[str, Any]:
    """Return what the method has computed for a proposal, as fields of it."""
    joined, brings = overlay.joined_piece, None
    if joined is not None and (piece := overlay.sheet.piece_on_plane(joined.center_uv_m)):
        motion = joined.target_from_piece @ overlay.sheet.shift(piece).inverse()
        brings = sent.JoinedPieceInfo(label=label_of(piece), placement=motion)
    return {
        "pieces": tuple(
            sent.PendingPart(
                component=part.component,
                area_cm2=1e4 * part.area_m2,
                waits=part.alignment is None,
                chosen=part.component == pending.component,
            )
            for part in overlay.proposal.parts
        ),
        "also": overlay.also,
        "extends": label_of(overlay.piece(pending)),
        "brings": brings,
        "foreseen": overlay.foreseen,
        "checks": overlay.checks,
    }


def layers_of(shown: Frame | OtherSheet) -> sent.Layers:
    """Return the layers of the shape, of a frame, or of the other side; a proposal lies on the shape only."""
    sheet = shown.sheet if isinstance(shown, Picture | OtherSheet) else None
    file_of = other_floating_file if isinstance(shown, OtherSheet) else floating_file
    pieces = () if sheet is None else zip(sheet.pieces, pieces_of(sheet), strict=True)
    return sent.Layers(
        revision=shown.revision,
        area_cm2=1e4 * (shown.view.area_m2 if sheet is None else sheet.shape_m2),
        pieces=typed(
            [{"file": file_of(piece.number), **about} for piece, about in pieces],
            tuple[sent.FloatingPiece, ...],
        ),
        legends=shown.legends,
        overlay=_overlay_info(shown) if isinstance(shown, Picture) else None,
        **grid_of(shown.view),
    )


def _overlay_info(picture: Picture) -> sent.OverlayInfo | None:
    overlay, pending = picture.overlay, picture.document.pending
    if overlay is None or pending is None:
        return None
    return sent.OverlayInfo(
        revision=overlay.revision,
        view_index=overlay.view_index,
        center_uv_m=shown_center_uv_m(pending, overlay),
        differences={kind: typed(each, sent.Legend) for kind, each in difference_legends().items()},
        placement=overlay.shown(pending),
        **grid_of(overlay.view),
    )


def shown_center_uv_m(pending: Pending, overlay: Overlay) -> tuple[float, float]:
    """Return the centre of the proposal on the plane, about which nudges rotate."""
    u_m, v_m = overlay.shown(pending).apply(np.array(overlay.own_center_uv_m)).tolist()
    return float(u_m), float(v_m)
