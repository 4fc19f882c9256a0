"""Messages between the page and the server about the garment and its seams."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from flatcloth.viewer.protocol.fields import Count, Metres, Radians, Said
from flatcloth.viewer.protocol.sent import UV, XYZ, Direction, Sent


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


GarmentName = Annotated[str, Meta(min_length=1, max_length=40)]
"""Of a kind of garment, or of a named point."""


class SetKind(Said, tag="garment_kind", frozen=True, kw_only=True):
    """Set the kind of the garment; None: the evidence decides."""

    kind: GarmentName | None = None


class HoldPoint(Said, tag="hold_point", frozen=True, kw_only=True):
    """Hold a named point of the garment at a place of the plane; the rest refits."""

    name: GarmentName
    u_m: Metres
    v_m: Metres


class PreviewPoint(HoldPoint, tag="preview_point", frozen=True, kw_only=True):
    """Ask how the outline would lie if a point were held so; ``id`` comes back with the answer."""

    id: Count


class ReleasePoints(Said, tag="release_points", frozen=True, kw_only=True):
    """Let a held point go, or all of them."""

    name: GarmentName | None = None


class DecidePiece(Said, tag="decide_piece", frozen=True, kw_only=True):
    """Lay a floating piece where the garment has a place for it, or refuse that place."""

    label: GarmentName
    accepted: bool


class DecideJoint(Said, tag="decide_joint", frozen=True, kw_only=True):
    """Cut a part off the shape, or keep it: ``index`` in the joints of the picture of this ``revision``.

    What is cut off lies elsewhere if there is a ``place``: a turn and a shift of the plane.
    """

    revision: Count
    index: Annotated[int, Meta(ge=0)]
    cut: bool
    place: tuple[Radians, Metres, Metres] | None = None


class PickPoint(Said, tag="pick_point", frozen=True, kw_only=True):
    """Pick a named point of the garment as a grasp."""

    name: GarmentName


class ShowOther(Said, tag="other_side", frozen=True, kw_only=True):
    """Compute the other side of the item, if it is not known yet."""


class DecideSeam(Said, tag="decide_seam", frozen=True, kw_only=True):
    """Cut a seam, or keep it: ``index`` in the list of seams at this ``revision`` of the other side."""

    revision: Count
    index: Annotated[int, Meta(ge=0)]
    keep: bool
