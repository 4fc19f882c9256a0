"""What methods answer: plans, placements with their scores, and canonical views."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from flatcloth.core.types import (
    FlattenedView,
    Float64,
    Int16,
    Int32,
    LaidPiece,
    Rigid2,
)
from flatcloth.flattening.borders import SPACING_M
from flatcloth.session.document import Document, PlacedPart, Side
from flatcloth.shape.joints import DecidedParts
from flatcloth.shape.shape import Change


@dataclass(frozen=True, kw_only=True)
class ColumnCurves:
    """The curves over the columns of a flattened view (paper, Fig. 4a).

    ``u_m`` (C,) centres of the columns; ``column_count`` (C,) h(u), pixels within the measurement
    limit; ``column_mean_z_angle_deg`` (C,) A_z(u), NaN in empty columns.
    """

    u_m: Float64
    column_count: Int32
    column_mean_z_angle_deg: Float64
    pixel_size_m: float


@dataclass(frozen=True, kw_only=True)
class SidePlan:
    """The plan for one side of the shape.

    At the rotation of the outermost view accepted there, ``occluding_edge_m`` is the length of the occluding
    edge, ``u_b_m`` and ``a_0_deg`` are the column at which the overlap is reached and its Z-angle;
    ``rotation_deg`` is A, unsigned, before rounding to an existing view; ``view_index`` is the chosen view,
    None if the side is complete; ``reason`` explains it.
    """

    side: Side
    curves: ColumnCurves
    occluding_edge_m: float
    u_b_m: float
    a_0_deg: float
    rotation_deg: float
    view_index: int | None
    reason: str


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A candidate for the next view, with its expected areas (m2).

    ``overlap_m2`` is cloth in common with the shape, ``improved_m2`` cloth seen only at large incidence
    angles so far, ``beyond_m2`` cloth beyond the outline of the shape, ``joining_m2`` cloth of floating
    pieces that the view may connect, and behind joints that it may show to be false, ``unseen_m2`` an
    allowance for cloth without any evidence; ``gap_deg`` is the rotation to the nearest visited view.
    ``floating_m2`` is cloth of floating pieces that it shows with enough of the shape, wherever they hang.
    """

    view_index: int
    overlap_m2: float
    improved_m2: float
    beyond_m2: float
    joining_m2: float
    unseen_m2: float
    gap_deg: float
    floating_m2: float = 0.0

    @property
    def new_m2(self) -> float:
        """Expected new area."""
        return self.improved_m2 + self.beyond_m2 + self.joining_m2 + self.unseen_m2


@dataclass(frozen=True, kw_only=True)
class Plan:
    """The next view, or None with the reason.

    ``sides`` holds the plan of each side (``paper``); ``candidates`` the best-rated views (``robust``).
    """

    view_index: int | None
    reason: str
    side: Side | None = None
    rotation_deg: float = 0.0
    sides: tuple[SidePlan, ...] = ()
    candidates: tuple[Candidate, ...] = ()


@dataclass(frozen=True)
class AlignmentScore:
    """How well two views agree: ``total`` in 0..1 and its named parts, with units in their names.

    ``apart_mm`` is the distance between the cloth of both, as the method measures it; None if unknown.
    """

    total: float
    parts: dict[str, float]
    apart_mm: float | None = None


@dataclass(frozen=True, kw_only=True)
class ZAngleLine:
    """Pixels of one Z-angle in a flattened view and their principal axis.

    ``pixels_uv_m`` (K, 2); ``center_uv_m`` and unit ``direction`` (pointing down the item) of the
    axis; ``point_uv_m`` the point on it at the common height.
    """

    z_angle_deg: float
    pixels_uv_m: Float64
    center_uv_m: Float64
    direction: Float64
    point_uv_m: Float64


@dataclass(frozen=True, kw_only=True)
class Correspondence:
    """The initial estimate and its derivation (paper, Fig. 4d, e).

    ``new_curves`` are h^1(u), A_z^1(u) at the new view's rotation; ``common_range_deg`` the
    Z-angles, before the rotation, that both views contain; ``a_m_deg`` its middle; the two lines; and
    the height (m, along the axis) of the pair of points.
    """

    rotation_deg: float
    current_curves: ColumnCurves
    new_curves: ColumnCurves
    common_range_deg: tuple[float, float]
    a_m_deg: float
    current: ZAngleLine
    new: ZAngleLine
    height_m: float


@dataclass(frozen=True, kw_only=True)
class Alignment:
    """Alignment of a new view to the current one, from the initial estimate (score None: unknown) on."""

    current_from_new: Rigid2
    initial: Rigid2
    score: AlignmentScore
    initial_score: AlignmentScore | None = None
    correspondence: Correspondence | None = None


@dataclass(frozen=True, kw_only=True)
class ComponentPlacement:
    """The alignment of one component of a view; None if the component cannot be placed yet."""

    component: int
    area_m2: float
    alignment: Alignment | None


@dataclass(frozen=True, kw_only=True)
class Placement:
    """A method's placement of a view: the ``alignment`` of its ``component``.

    ``parts`` has one entry per component of the view. Only ``component`` and ``alignment`` are required of a
    method. ``also`` are further components, of this view or of accepted ones, each with its own motion, that
    are placed with it. ``change`` is what the view changes about the shape.
    """

    component: int
    alignment: Alignment
    parts: tuple[ComponentPlacement, ...] = ()
    also: tuple[PlacedPart, ...] = ()
    change: Change | None = None


@dataclass(frozen=True, kw_only=True)
class Canonical:
    """The canonical view.

    ``view`` is its raster; ``current_from_view`` maps each accepted view's index to the motion from
    that view's own plane to this plane (in the paper's method, the plane of the view added last).
    ``floating`` are pieces of cloth that no view connects to it, each in a plane of its own; those of the
    indices ``taken_off`` were parts of it, and the operator took them off.
    """

    view: FlattenedView
    current_from_view: Mapping[int, Rigid2]
    floating: tuple[FlattenedView, ...] = ()
    taken_off: frozenset[int] = frozenset()


@dataclass(frozen=True, kw_only=True)
class Seam:
    """Places where the rims of a piece of each side meet and agree on one motion.

    ``this_piece`` and ``other_piece`` are numbers of pieces: 0 for the shape, then the floating ones in
    order. ``this_uv_m``, ``other_uv_m`` (K, 2) on the planes of both sides, ``xyz_m`` (K, 3) object frame,
    ``views`` (K, 2) those that show either rim; ``residual_m`` (K,) how far apart their motion leaves them.
    ``why`` says why the seam joins nothing; it is empty if it does. ``probability`` that it is a seam
    (``docs/robust.md``, "Both sides"); ``decided`` is the decision of the operator.
    """

    this_piece: int
    other_piece: int
    this_uv_m: Float64
    other_uv_m: Float64
    xyz_m: Float64
    views: Int16
    residual_m: Float64
    why: str
    probability: float = 1.0
    decided: Literal["cut", "keep"] | None = None

    @property
    def length_m(self) -> float:
        """Length of the seam: the distance of its places times their number."""
        return len(self.xyz_m) * SPACING_M


class Ends(Protocol):
    """Where the cloth of one piece truly ends: places (E, 2) on its plane, metres.

    ``edge_trust`` (E,) is e / (e + 1) for an edge that e views saw, each by how surely the cloth ends.
    """

    @property
    def edge_uv_m(self) -> Float64:
        """Places (E, 2) of true edges."""
        ...

    @property
    def edge_trust(self) -> Float64:
        """How well each edge (E,) was seen."""
        ...

    def depth_at(self, uv_m: Float64) -> Float64:
        """Return how far inside of the border places (N, 2) of the plane are, 0 off the cloth."""
        ...


@dataclass(frozen=True, kw_only=True)
class OneSide:
    """One side of an item by itself: the decisions about it and its ``parts``, its canonical view, and what
    tells where its cloth ``ends``: that of the canonical view and of each floating piece.
    """

    document: Document
    parts: DecidedParts
    canonical: Canonical
    ends: Callable[[], Sequence[Ends]]


@dataclass(frozen=True, kw_only=True)
class OtherJoint:
    """Where cloth of the other side hangs on the rest of both by little evidence.

    ``share`` of the other side's main piece that is behind it; ``probability`` that it is joined rightly;
    ``evidence`` of what joins it.
    """

    share: float
    probability: float
    evidence: float


@dataclass(frozen=True, kw_only=True)
class JoinedSides:
    """The other side of an item, joined to this one along the seams.

    ``other`` is its canonical view with its floating pieces, as seen from its own outside; its standard
    deviations are relative to this side's shape, and None if it is not related to that. Where
    ``is_related``, a place (u, v) of its plane times ``MIRROR`` lies on the plane of this side.
    ``laid`` are floating pieces of this side that seams join to the shape, over cloth of the other side; the
    place of the pieces ``unsure`` is not sure. ``weak`` are where cloth of the other side may be joined
    falsely, the most doubtful first.
    """

    other: Canonical
    seams: tuple[Seam, ...]
    is_related: bool
    laid: tuple[LaidPiece, ...] = ()
    unsure: frozenset[int] = frozenset()
    weak: tuple[OtherJoint, ...] = ()


@dataclass(frozen=True, kw_only=True)
class ClothPairs:
    """The same cloth in a component of a view and in the shape: what fixes the component's place.

    ``shape_uv_m`` (K, 2) on the plane of the shape, ``new_uv_m`` (K, 2) on the component's own plane;
    ``shape_xyz_m``, ``new_xyz_m`` (K, 3) in the object frame.
    """

    shape_uv_m: Float64
    new_uv_m: Float64
    shape_xyz_m: Float64
    new_xyz_m: Float64

    def residual_m(self, current_from_new: Rigid2) -> Float64:
        """Return how far apart (K,) on the plane a placement leaves the pairs."""
        apart: Float64 = np.linalg.norm(current_from_new.apply(self.new_uv_m) - self.shape_uv_m, axis=1)
        return apart

    @property
    def apart_m(self) -> Float64:
        """Distance (K,) of the pairs in space; no placement on the plane changes it."""
        apart: Float64 = np.linalg.norm(self.new_xyz_m - self.shape_xyz_m, axis=1)
        return apart


@dataclass(frozen=True, kw_only=True)
class JoinedPiece:
    """A floating piece that a component placed by the operator joins to the shape.

    ``piece`` is its number; ``center_uv_m`` (2,) is where it lies on the plane now, ``target_from_piece``
    leads from there to where it goes.
    """

    piece: int
    center_uv_m: Float64
    target_from_piece: Rigid2
