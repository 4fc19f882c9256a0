"""What the server sends to tabs besides the state: answers to questions, frames of a camera, events."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from flatcloth.engine.diagnostics import Reasons
from flatcloth.engine.joints import Place
from flatcloth.engine.result import Result
from flatcloth.session.journal import SheetSide
from flatcloth.viewer.protocol.sent import RC, UV, XYZ, Direction, Grid, Legend, Note, Progress, Sent
from flatcloth.viewer.protocol.state import CaptureStatus, GarmentPointInfo, PageState

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


class HoverAnswer(Sent, tag_field="type", tag="hover", frozen=True):
    """The values under the pointer, of the shape and of the proposal, and the place in a source image."""

    id: int
    shape: PixelValues | None
    proposal: PixelValues | None
    source: SourcePlace | None


class RayAnswer(Sent, tag_field="type", tag="hover_ray", frozen=True):
    """What a ray of the 3D scene hits first, and where that lies on the plane of a side; None: nothing."""

    id: int
    xyz_m: XYZ | None = None
    uv_m: UV | None = None
    sheet: SheetSide = "this"


class Picked(Sent, tag_field="type", tag="picked", frozen=True):
    """A new pick is stored, on a side of the item and its plane; its numbers follow with the state."""

    id: int
    position_held_m: XYZ
    side: SheetSide
    uv_m: UV


class Measured(Sent, tag_field="type", tag="measured", frozen=True):
    """A distance: on the plane, along the cloth and through the air. ``path_uv_m`` follows the cloth."""

    id: int
    flat_mm: float
    cloth_mm: float | None
    air_mm: float | None
    path_uv_m: list[UV]


class PreviewAnswer(Sent, tag_field="type", tag="preview", frozen=True):
    """The score of a moved proposal, and that after refinement; ``why`` says why there is none."""

    id: int
    why: str = ""
    score: float | None = None
    apart_mm: float | None = None
    refined_score: float | None = None
    refined_apart_mm: float | None = None


class PairsAnswer(Sent, tag_field="type", tag="pairs", frozen=True):
    """The residuals of pairs of points, before and after the motion that fits them."""

    residual_mm: list[float]
    fitted_mm: list[float]
    rms_mm: float


class GarmentPreview(Sent, tag_field="type", tag="garment_preview", frozen=True):
    """The outline and the named points of the garment while a point is dragged."""

    id: int
    outline_uv_m: list[UV]
    points: list[GarmentPointInfo]


class StrokeAdvice(Sent, tag_field="type", tag="where_to_stroke", frozen=True):
    """The view and the pixel where the next stroke settles most; None: nowhere, ``text`` says why."""

    view_index: int | None
    rc: tuple[float, float] | None
    text: str
    number: int = 0


class Switched(Sent, tag_field="type", tag="switched", frozen=True):
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
    """A view that joins a part to the rest: pairs, median and ninth decile of residuals, and their pixels."""

    view_index: int
    angle_deg: float
    pairs: int
    residual_mm: tuple[float, float]
    rc: list[UV]


class JointInfo(Sent, frozen=True):
    """Where a part of the shape is joined to the rest, and what holds it.

    ``evidence`` is that of the pairs across, ``probability`` that it is right; ``weak``: much may be wrong.
    ``ends_uv_m`` are the ends of pairs, that of the part first, with their lengths along the cloth.
    """

    area_cm2: float
    evidence: float
    weak: bool
    probability: float
    kept: bool
    outline_uv_m: list[list[UV]]
    ends_uv_m: list[tuple[UV, UV]]
    length_m: list[float]
    seam_xyz_m: list[XYZ]
    part_xyz_m: list[XYZ]
    views: list[HeldByView]
    places: tuple[Place, ...]


class JointsInfo(Sent, frozen=True):
    """The answer of ``/joints/REVISION.json``: the weakest joints first; ``trouble`` if there are none."""

    revision: int
    trouble: str = ""
    joints: list[JointInfo] = msgspec.field(default_factory=list)


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


class FrameInfo(Sent, frozen=True):
    """A frame of a camera; its picture follows in the same answer, unless ``grid`` is None."""

    sequence: int
    reason: str
    grid: Grid | None = None
    legend: Legend | None = None
    pick_uv_m: UV | None = None


class ItemBox(Sent, frozen=True):
    """The part of an image that shows the item, pixels, also where its side is not decided."""

    top: int
    left: int
    height: int
    width: int


ServerMessage = (
    PageState
    | Note
    | Progress
    | CaptureStatus
    | HoverAnswer
    | RayAnswer
    | Picked
    | Measured
    | PreviewAnswer
    | PairsAnswer
    | GarmentPreview
    | StrokeAdvice
    | Switched
)
