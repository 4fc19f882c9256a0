"""What the server sends to tabs besides the state: answers to questions, frames of live mode, events."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

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
    """What a ray of the 3D scene hits first, and where that lies on the plane; None: nothing."""

    id: int
    xyz_m: XYZ | None = None
    uv_m: UV | None = None


class Picked(Sent, tag_field="type", tag="picked", frozen=True):
    """A new pick is stored; its numbers follow with the state."""

    id: int
    position_held_m: XYZ


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


class Switched(Sent, tag_field="type", tag="switched", frozen=True):
    """Another recording was opened; the tab connects again."""


class FrameInfo(Sent, tag_field="type", tag="frame", frozen=True):
    """A frame of live mode; its picture follows in the same message, unless ``grid`` is None."""

    sequence: int
    view_index: int
    angle_deg: float
    reason: str
    flatten_ms: float | None
    server_fps: float
    playing: bool
    forward: bool
    layer: str
    grid: Grid | None = None
    area_cm2: float | None = None
    legend: Legend | None = None
    pick_uv_m: UV | None = None


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
