"""What is sent to the page: its state, the answers to questions, events.

A new tab receives the whole state, then after each change the fields that differ. Numbers that may be unknown
are ``float | None``; NaN is sent as ``null``, too.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, TypeVar

import msgspec
import numpy as np
from msgspec import Meta

from flatcloth.core.decoding import converted
from flatcloth.core.parcel import Parcel
from flatcloth.core.types import Rigid2
from flatcloth.engine.diagnostics import Reasons
from flatcloth.engine.result import Result
from flatcloth.rendering import layers
from flatcloth.session.journal import SheetSide
from flatcloth.session.machine import Request
from flatcloth.viewer.protocol import Sent
from flatcloth.viewer.protocol.actions import Action
from flatcloth.viewer.protocol.settings import Setting, Settings

UV = tuple[float, float]
"""A place (u, v) on the flattened plane, in metres."""
XYZ = tuple[float, float, float]
"""A point in the object frame, or in the camera's, in metres."""
Direction = tuple[float | None, float | None, float | None]
"""A unit vector; None where it is unknown."""
RC = tuple[int, int]
"""A pixel (row, col) of the shape."""

NoteLevel = Literal["info", "warning", "error"]

T = TypeVar("T")


class ServerMessage(Sent, tag_field="type", frozen=True):
    """The base of all messages that the server sends as text: each subclass is one, with its ``type``."""


class Note(ServerMessage, tag="note", frozen=True):
    """A notification for the operator; ``time_s`` counts from the epoch."""

    id: int
    level: NoteLevel
    text: str
    time_s: float


class Progress(Sent, frozen=True):
    """How much of a computation is done, of 1, and what it does."""

    share: float
    text: str


class Grid(Sent, frozen=True):
    """The size of a raster of the flattened plane, and where its first pixel lies."""

    rows: int
    cols: int
    pixel_size_m: float
    origin_uv_m: UV


class ColorClass(Sent, frozen=True):
    """A color of a legend, and what it stands for."""

    label: str
    color: str


class Legend(Sent, frozen=True):
    """The legend of a layer; ``map``, ``low``, ``high`` and ``colors`` belong to a ramp."""

    kind: Literal["none", "classes", "ramp"]
    title: str
    classes: tuple[ColorClass, ...] = ()
    map: str = ""
    low: float = 0.0
    high: float = 1.0
    colors: tuple[str, ...] = ()


class Motion(Sent, frozen=True):
    """A rigid motion of the plane for reading."""

    theta_deg: float
    u_mm: float
    v_mm: float


def typed(values: Any, kind: type[T]) -> T:
    """Return JSON values, which may contain numpy's, as a struct."""
    return converted(msgspec.to_builtins(values, enc_hook=_builtin), kind)


def encoded(message: Any) -> bytes:
    """Return a message, or other values, as JSON."""
    return _ENCODER.encode(message)


def parcel_of(values: Any, arrays: Mapping[str, Any]) -> Parcel:
    """Return values, which may be a struct, with arrays; NaN among the values is sent as ``null``.

    Numbers of 64 bits are sent as 32 bits; an array (H, W, 4) of bytes is a picture.
    """
    parcel = Parcel(msgspec.json.decode(encoded(values)))
    for name, array in arrays.items():
        if array.dtype == np.uint8 and array.shape[2:] == (4,):
            parcel.picture(name, layers.png(array), array.shape[:2])
        else:
            parcel.array(name, array, _SHORTER.get(array.dtype.name))
    return parcel


_SHORTER = {"float64": "float32", "int64": "int32"}


def _builtin(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"A message has a value that JSON does not know: {value!r:.80}.")


_ENCODER = msgspec.json.Encoder(enc_hook=_builtin)


class ActiveStatus(Sent, frozen=True):
    """The state of an active loop; ``angle_deg`` is the next one, None at the ``end`` or while it waits.

    ``steps`` are its last views: of each ``why`` it was asked for, and what was ``got``.
    """

    goal: str
    budget: str
    folder: str
    views: int
    knows: str
    angle_deg: float | None
    turn_deg: float | None
    why: str
    end: str | None
    waiting: str
    turning: bool
    is_simulated: bool
    steps: tuple[dict[str, Any], ...]


ViewState = Literal["unused", "start", "pending", "accepted", "fixed", "rejected", "skipped"]


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


class PendingInfo(Sent, frozen=True):
    """The proposal. What the method computes with it has a default while it is being drawn.

    ``joins`` is of a proposal that was moved by hand: whether its cloth belongs to the shape if it is
    accepted there; None: not known yet.
    """

    view_index: int
    side: str | None
    score: float | None
    why: str
    nudge: Motion
    pieces: tuple[PendingPart, ...] = ()
    also: tuple[PlacedPartInfo, ...] = ()
    extends: str | None = None
    brings: JoinedPieceInfo | None = None
    foreseen: Foreseen | None = None
    checks: tuple[Check, ...] = ()
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


class PickInfo(ListedPick, frozen=True):
    """All numbers of the current pick."""

    position_camera_m: XYZ
    normal_held: Direction
    normal_camera: Direction
    angle_deg: float
    source_rc: tuple[float | None, float | None]
    miss_m: float
    grip: GripInfo | None


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
    """Whether Auto decides; ``waits_for`` the operator, if it does; ``ended`` by choice, and why."""

    running: bool = False
    waits_for: str = ""
    ended: str = ""

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


class CaptureStatus(Sent, frozen=True):
    """The status of the camera and of a guided capture.

    ``playing``: its newest frame is shown; otherwise one frame is held.
    """

    camera: str
    camera_fps: float
    playing: bool
    ended: str | None
    warnings: tuple[str, ...]
    folder: str
    phase: str
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


class PageState(ServerMessage, tag="state", frozen=True):
    """The state of the page: what the mode does not have is None, or the default.

    ``doubts`` is the revision of the list of what is in doubt.
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
    lesson: Progress | None
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
    request: Request | None = None
    progress: Progress | None = None
    pending: PendingInfo | None = None
    drawing: bool = False
    trouble: str = ""
    review: ReviewInfo | None = None
    sides: SidesInfo | None = None
    garment: GarmentInfo | None = None
    other: OtherSideInfo | None = None
    doubts: int | None = None
    capture: CaptureStatus | None = None
    active: ActiveStatus | None = None


Rgb = tuple[
    Annotated[int, Meta(ge=0, le=255)], Annotated[int, Meta(ge=0, le=255)], Annotated[int, Meta(ge=0, le=255)]
]
Pixel = tuple[float | None, float | None]
"""A pixel (row, col) of a source image."""


class PixelValues(Sent, frozen=True):
    """All values of a pixel of the flattened view.

    ``z_angle_deg`` is the Z-angle at which its view saw it, ``z_angle_now_deg`` that at the shown rotation,
    which can be compared between views.
    """

    rc: RC
    uv_mm: tuple[float, float]
    rgb: Rgb
    xyz_mm: XYZ
    height_mm: float
    normal: Direction
    z_angle_deg: float | None
    z_angle_now_deg: float | None
    view_index: int
    source_rc: Pixel
    density_px_cm2: float | None
    incidence_deg: float | None
    stretch: float | None
    placement_std_mm: float | None
    error_mm: float | None


class SourcePlace(Sent, frozen=True):
    """A pixel of the source image of a view."""

    view_index: int
    rc: Pixel


class HoverAnswer(ServerMessage, tag="hover", frozen=True):
    """The values under the pointer, of the shape and of the proposal, and the place in a source image."""

    id: int
    shape: PixelValues | None
    proposal: PixelValues | None
    source: SourcePlace | None


class RayAnswer(ServerMessage, tag="hover_ray", frozen=True):
    """What a ray of the 3D scene hits first, and where that lies on the plane of a side; None: nothing."""

    id: int
    xyz_m: XYZ | None = None
    uv_m: UV | None = None
    sheet: SheetSide = "this"


class Picked(ServerMessage, tag="picked", frozen=True):
    """A new pick is stored, on a side of the item and its plane; its numbers follow with the state."""

    id: int
    position_held_m: XYZ
    side: SheetSide
    uv_m: UV


class Measured(ServerMessage, tag="measured", frozen=True):
    """A distance: on the plane, along the cloth and through the air. ``path_uv_m`` follows the cloth."""

    id: int
    flat_mm: float
    cloth_mm: float | None
    air_mm: float | None
    path_uv_m: list[UV]


class PreviewAnswer(ServerMessage, tag="preview", frozen=True):
    """The score of a moved proposal, and that after refinement; ``why`` says why there is none."""

    id: int
    why: str = ""
    score: float | None = None
    apart_mm: float | None = None
    refined_score: float | None = None
    refined_apart_mm: float | None = None


class PairsAnswer(ServerMessage, tag="pairs", frozen=True):
    """The residuals of pairs of points, before and after the motion that fits them."""

    residual_mm: list[float]
    fitted_mm: list[float]
    rms_mm: float


class GarmentPreview(ServerMessage, tag="garment_preview", frozen=True):
    """The outline and the named points of the garment while a point is dragged."""

    id: int
    outline_uv_m: list[UV]
    points: list[GarmentPointInfo]


class StrokeAdvice(ServerMessage, tag="where_to_stroke", frozen=True):
    """The view and the pixel where the next stroke settles most; None: nowhere, ``text`` says why."""

    view_index: int | None
    rc: tuple[float, float] | None
    text: str
    number: int = 0


class Switched(ServerMessage, tag="switched", frozen=True):
    """Another recording was opened; the tab connects again."""


class SeenView(Sent, frozen=True):
    """A view that saw a pick: the pixel, and the image around it as a data URL."""

    view_index: int
    angle_deg: float
    rc: tuple[float, float]
    thumb: str


class SeenViews(Sent, frozen=True):
    """The views that saw a pick, and how many of the others did not, by the reason."""

    seen: list[SeenView]
    n_views: int
    hidden: dict[str, int]


class HeldByView(Sent, frozen=True):
    """What a view sees of what holds cloth: places, median residual (None: unknown), their pixels."""

    view_index: int
    angle_deg: float
    places: int
    residual_mm: float | None
    rc: list[UV]


class Choice(Sent, frozen=True, kw_only=False):
    """How a hypothesis can be decided: what is true then, what deciding it does, and where its cloth lies.

    ``placement`` moves the cloth from where it is drawn; ``how`` "hand": it becomes the proposal there.
    """

    how: Literal["keep", "cut", "place", "hand"]
    title: str
    decide: str
    probability: float | None = None
    placement: Rigid2 = Rigid2()
    std_mm: float | None = None


class Doubt(Sent, frozen=True):
    """A hypothesis about the shape: a joint that holds a part, a floating piece, or a seam of both sides.

    ``weak``: much may be wrong, or has an open place; ``is_apart``: it joins nothing. ``outline_uv_m`` is
    that of its cloth on the plane of its ``side``; the cloth turns about ``pivot_uv_m``, and ``arm_uv_m``
    leads from there to its farthest place. ``ends_uv_m`` are ends of pairs across a joint, that of the part
    first, with their lengths along the cloth. The other places are where it holds, on both sides and in
    space. ``choices`` begin with what holds now; the probabilities of those that have one add up to 1.
    """

    kind: Literal["joint", "piece", "seam"]
    title: str
    said: str
    note: str
    views: list[HeldByView]
    choices: list[Choice]
    area_cm2: float = 0.0
    length_mm: float = 0.0
    probability: float = 1.0
    side: SheetSide = "this"
    weak: bool = False
    is_apart: bool = False
    outline_uv_m: list[list[UV]] = msgspec.field(default_factory=list)
    pivot_uv_m: UV = (0.0, 0.0)
    arm_uv_m: UV = (0.0, 0.0)
    ends_uv_m: list[tuple[UV, UV]] = msgspec.field(default_factory=list)
    length_m: list[float] = msgspec.field(default_factory=list)
    this_uv_m: list[UV] = msgspec.field(default_factory=list)
    other_uv_m: list[UV] = msgspec.field(default_factory=list)
    seam_xyz_m: list[XYZ] = msgspec.field(default_factory=list)
    part_xyz_m: list[XYZ] = msgspec.field(default_factory=list)


class DoubtsInfo(Sent, frozen=True):
    """The answer of ``/doubts/REVISION.json``: the joints first, the weakest before the others.

    ``trouble`` says why joints are not known; the outlines are those of both sides, each on its own plane.
    """

    revision: int
    trouble: str = ""
    doubts: list[Doubt] = msgspec.field(default_factory=list)
    this_outline_uv_m: list[list[UV]] = msgspec.field(default_factory=list)
    other_outline_uv_m: list[list[UV]] = msgspec.field(default_factory=list)


class ResultInfo(Sent, frozen=True):
    """The result of a session; ``revision`` 0: there is none yet, ``trouble`` says what failed."""

    revision: int
    trouble: str = ""
    result: Result | None = None


class ShownPairs(Sent, frozen=True):
    """Pairs of the same cloth, evenly chosen, and the statistics of all pairs."""

    total: int
    median_mm: float
    nine_tenths_mm: float
    beyond_share: float
    limit_mm: float
    apart_median_mm: float
    shape_uv_m: list[UV]
    placed_uv_m: list[UV]
    shape_xyz_m: list[XYZ]
    new_xyz_m: list[XYZ]
    residual_mm: list[float]
    apart_mm: list[float]


class DiagnosticsInfo(Sent, frozen=True):
    """What speaks for and against a proposal."""

    reasons: Reasons
    pairs: ShownPairs | None


class ItemBox(Sent, frozen=True):
    """The part of an image that shows the item, pixels, also where its side is not decided."""

    top: int
    left: int
    height: int
    width: int
