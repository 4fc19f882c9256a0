"""The state of the page: a new tab receives all of it, then after each change the fields that differ."""

from __future__ import annotations

from typing import Literal

from flatcloth.core.types import Rigid2
from flatcloth.session.journal import SheetSide
from flatcloth.session.machine import Request
from flatcloth.viewer.protocol.actions import Action
from flatcloth.viewer.protocol.sent import (
    RC,
    UV,
    XYZ,
    ActiveStatus,
    Direction,
    Grid,
    Legend,
    Motion,
    Note,
    Progress,
    Sent,
)
from flatcloth.viewer.protocol.settings import Setting, Settings

ViewState = Literal["unused", "start", "pending", "accepted", "fixed", "later", "rejected", "skipped"]


class RecordingInfo(Sent, frozen=True):
    """The recording that is open."""

    name: str
    description: str
    n_views: int


class ViewRow(Sent, frozen=True):
    """A view on the timeline: what was decided about it, and what it added to the shape."""

    index: int
    angle_deg: float
    state: ViewState
    detail: str = ""
    score: float | None = None
    follows: int = 0
    why_not: str | None = None
    why_not_reopen: str | None = None
    flagged: bool = False
    order: int | None = None
    added_cm2: float | None = None
    flags: tuple[str, ...] = ()


class ReviewInfo(Sent, frozen=True):
    """``token`` changes when the pictures of the views do; ``flags`` are the texts of the views' flags."""

    token: str
    flags: dict[str, str]


class OverlayInfo(Grid, frozen=True):
    """Where the proposal lies; ``placement`` maps its own plane to the shape's."""

    revision: int
    view_index: int
    center_uv_m: UV
    differences: dict[str, Legend]
    placement: Rigid2


class FloatingPiece(Sent, frozen=True):
    """A piece that is not joined to the shape yet; ``grid`` is its place on the sheet."""

    label: str
    file: str
    area_cm2: float
    reason: str
    views: tuple[int, ...]
    color: str
    placed: bool
    grid: Grid


class Layers(Grid, frozen=True):
    """The pictures of the shape; ``revision`` is part of their addresses."""

    revision: int
    area_cm2: float
    pieces: tuple[FloatingPiece, ...]
    legends: dict[str, Legend]
    overlay: OverlayInfo | None


class GarmentPointInfo(Sent, frozen=True):
    """A named point of the garment; ``xyz_m`` is None if no view saw its cloth."""

    name: str
    uv_m: UV
    std_mm: float
    seen: bool
    held: bool
    xyz_m: Direction | None


class Dimension(Sent, frozen=True):
    """A dimension of the garment and its standard deviation."""

    name: str
    mm: float
    std_mm: float


class GarmentPiece(Sent, frozen=True):
    """A floating piece that the garment has a place for, and its outline there."""

    label: str
    probability: float
    std_mm: float
    sure: bool
    state: Literal["placed", "refused", "proposed"]
    outline_uv_m: list[list[UV]]


class FoundGarment(Sent, frozen=True):
    """The garment: its kind (None: of no known kind), dimensions, outline and named points.

    ``doubted``: nothing of the shape is reliable until the kind is set.
    """

    kind: str | None
    likeliest: str
    by_hand: bool
    doubted: bool
    probabilities: list[tuple[str, float]]
    dimensions: list[Dimension]
    outline_uv_m: list[UV]
    points: list[GarmentPointInfo]
    upright_rad: float
    pieces: list[GarmentPiece]


class SeamInfo(Sent, frozen=True):
    """A seam between a piece of this side and one of the other; ``why`` says why it does not join them.

    Pieces by their letters; ``residual_mm`` are the median and the 90 % quantile of the places' residuals.
    """

    this_piece: str
    other_piece: str
    length_mm: float
    places: int
    residual_mm: tuple[float, float]
    this_views: tuple[int, ...]
    other_views: tuple[int, ...]
    why: str
    decided: Literal["cut", "keep"] | None


class SeamPlaces(Sent, frozen=True):
    """Where a seam lies on the sheets of both sides, in space, and how far apart its motion leaves it."""

    this_uv_m: list[UV]
    other_uv_m: list[UV]
    xyz_m: list[XYZ]
    residual_mm: list[float]


class SidePlaces(Sent, frozen=True):
    """The outlines of both sides, each on its own plane, and the places of all seams."""

    this_outline_uv_m: list[list[UV]]
    other_outline_uv_m: list[list[UV]]
    seams: list[SeamPlaces]


class GarmentInfo(Sent, frozen=True):
    """What is known of the garment; ``revision`` grows with each answer, ``text`` says why there is none."""

    revision: int
    working: bool
    text: str
    kinds: tuple[str, ...]
    found: FoundGarment | None


class OtherSideInfo(Sent, frozen=True):
    """The other side of the item; ``layers`` None: it is not computed, ``text`` says why.

    ``revision`` grows with each result; ``is_related``: a place (u, v) of its plane is (-u, v) on that of
    this side. While ``working``, what is shown may belong to the shape before.
    """

    revision: int
    working: bool
    progress: Progress | None
    text: str
    layers: Layers | None = None
    is_related: bool = False
    seams: tuple[SeamInfo, ...] = ()
    reliable_share: float | None = None


class PendingPart(Sent, frozen=True):
    """A connected part of the proposed view; ``waits``: the method found no place for it."""

    component: int
    area_cm2: float
    waits: bool
    chosen: bool


class PlacedPartInfo(Sent, frozen=True):
    """A further component that is placed with the proposal: its area, and a place on the sheet.

    The place is in the middle of the cloth that it alone adds, if there is any.
    """

    view_index: int
    component: int
    area_cm2: float
    place_uv_m: UV


class JoinedPieceInfo(Sent, frozen=True):
    """The floating piece that the proposal joins to the shape, and its motion on the sheet."""

    label: str
    placement: Rigid2


class Foreseen(Sent, frozen=True):
    """What accepting the proposal would add, and join.

    By the shape with the view beside that without it: how far cloth moves (nine tenths of it less), and the
    share of the view's pairs that the others contradict; None if the method does not know.
    """

    added_cm2: float
    joins: tuple[str, ...]
    moved_mm: float | None = None
    contradicted: float | None = None


class Check(Sent, frozen=True):
    """A check of the proposal; ``passed`` is None if the common cloth does not decide it."""

    name: str
    title: str
    value: float | None
    limit: float
    unit: str
    passed: bool | None
    place_uv_m: UV | None


class GhostInfo(Sent, frozen=True):
    """Where a piece placed by hand would lie by the garment, or by seams, with its deviation there."""

    source: Literal["garment", "seams"]
    placement: Rigid2
    std_mm: float


class PendingInfo(Sent, frozen=True):
    """The proposal. What the method computes with it has a default while it is being drawn.

    ``joins`` is of a proposal that was moved by hand: whether its cloth belongs to the shape if it is
    accepted there; None: not known yet.
    """

    view_index: int
    side: str | None
    score: float | None
    why: str
    again: bool
    nudge: Motion
    pieces: tuple[PendingPart, ...] = ()
    also: tuple[PlacedPartInfo, ...] = ()
    extends: str | None = None
    brings: JoinedPieceInfo | None = None
    foreseen: Foreseen | None = None
    checks: tuple[Check, ...] = ()
    ghosts: tuple[GhostInfo, ...] = ()
    joins: bool | None = None


class GripInfo(Sent, frozen=True):
    """How a pick is gripped; ``axis_deg`` is its axis on the plane, ``gripper_m`` lines that draw it."""

    axis_from: str
    axis_deg: float | None
    axis_uv: tuple[float, float] | None
    axis_held: XYZ
    approach_held: XYZ
    opening_m: float
    gripper_m: tuple[tuple[XYZ, XYZ], ...]
    outline_distance_m: float | None
    position_std_m: float | None
    normal_std_deg: float | None
    axis_std_deg: float | None
    placement_std_m: float | None


class PickInfo(Sent, frozen=True):
    """All numbers of the current pick; its pixel and its place are those of its ``side`` of the item."""

    id: int
    name: str
    side: SheetSide
    rc: RC
    uv_m: UV
    in_shape: bool
    position_held_m: XYZ
    position_camera_m: XYZ
    normal_held: Direction
    normal_camera: Direction
    angle_deg: float
    z_angle_deg: float | None
    view_index: int
    source_rc: tuple[float | None, float | None]
    miss_m: float
    grip: GripInfo | None


class ListedPick(Sent, frozen=True):
    """A pick of the list; ``uv_m`` on the plane of its ``side``, None if that does not contain it.

    One that is not ``kept`` goes with the next click.
    """

    id: int
    name: str
    side: SheetSide
    view_index: int
    position_held_m: XYZ
    uv_m: UV | None
    kept: bool


class AxisInfo(Sent, frozen=True):
    """The turning axis as the camera of view 0 sees it; ``estimated``: it is not the recorded one."""

    right_m: float
    away_m: float
    lean_right_deg: float
    lean_away_deg: float
    estimated: bool


class SidesInfo(Sent, frozen=True):
    """What is known of the side of interest; ``revision`` grows with every change of the labels."""

    revision: int
    token: str
    text: str
    n_strokes: int = 0
    certainty: float | None = None
    undecided_cm2: float | None = None
    conflicts: tuple[str, ...] = ()
    pixels_per_m: float = 0.0


class AutoInfo(Sent, frozen=True):
    """Whether Auto decides; ``waits_for`` the operator, if it does; ``ended`` by choice, and why.

    ``until`` says when it ends.
    """

    running: bool = False
    waits_for: str = ""
    ended: str = ""
    until: str = ""

    @property
    def is_busy(self) -> bool:
        """Whether it changes the shape by itself."""
        return self.running and not self.waits_for


class CapturedView(Sent, frozen=True):
    """The view that was captured last."""

    number: int
    angle_deg: float
    frames: int
    noise_mm: float
    warnings: tuple[str, ...]


class CaptureStatus(Sent, tag_field="type", tag="capture", frozen=True):
    """The status of the camera and of a guided capture; ``why_not`` is by action, None: allowed.

    ``playing``: its newest frame is shown; otherwise one frame is held.
    """

    camera: str
    camera_fps: float
    playing: bool
    ended: str | None
    warnings: tuple[str, ...]
    folder: str
    phase: str
    why_not: dict[str, str | None]
    step_deg: float
    hold_s: float
    frames: int
    target_deg: float
    turn_by_deg: float
    taken: int
    still_s: float
    speed_px_s: float | None
    announced: bool
    kept_deg: tuple[float, ...]
    view: CapturedView | None


class PageState(Sent, tag_field="type", tag="state", frozen=True):
    """The state of the page: what the mode does not have is None, or the default.

    A tab is sent the fields that differ from those that it was sent before.
    """

    revision: int
    mode: Literal["session", "camera"]
    phase: str
    method: str
    recording: RecordingInfo
    notes: tuple[str, ...]
    auto: AutoInfo
    layers: Layers | None
    pick: PickInfo | None
    picks: tuple[ListedPick, ...]
    log: tuple[Note, ...]
    settings: Settings
    settings_rows: tuple[Setting, ...]
    present_view: int | None
    angle_deg: float | None
    views: tuple[ViewRow, ...]
    actions: tuple[Action, ...]
    reject_reasons: tuple[str, ...]
    step: int = 0
    start_view: int | None = None
    finished: str | None = None
    undo: str | None = None
    redo: str | None = None
    n_later: int = 0
    request: Request | None = None
    progress: Progress | None = None
    pending: PendingInfo | None = None
    drawing: bool = False
    trouble: str = ""
    review: ReviewInfo | None = None
    sides: SidesInfo | None = None
    garment: GarmentInfo | None = None
    axis: AxisInfo | None = None
    other: OtherSideInfo | None = None
    capture: CaptureStatus | None = None
    active: ActiveStatus | None = None
