"""What every method of integrating views answers, and the types of its answers.

:class:`Method` is the protocol; :mod:`flatcloth.methods.registry` knows the methods by name.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Protocol

import numpy as np

from flatcloth.core.config import Config
from flatcloth.core.types import (
    FlattenedView,
    Float64,
    Int32,
    Progress,
    Rigid2,
    RotationAxis,
    no_progress,
)
from flatcloth.session.document import Document, Later, PlacedPart, Side

if TYPE_CHECKING:
    from flatcloth.flattening.flatten import Flattening
    from flatcloth.registration.cameras import Registered


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
    """What one side of the shape promises.

    ``from_view`` is the outermost view accepted on that side, at whose rotation the Z-angles are
    taken; ``edge_z_angle_deg`` the mean Z-angle of the outermost columns, ``occluding_edge``
    whether the cloth goes on out of sight there; ``u_b_m`` and ``a_0_deg`` the column where the
    overlap is reached and its Z-angle; ``rotation_deg`` A, unsigned, before it is held to the views
    that exist; ``view_index`` the chosen view, None if the side is done; ``reason`` says why.
    """

    side: Side
    from_view: int
    curves: ColumnCurves
    occluding_edge_m: float
    u_b_m: float
    a_0_deg: float
    rotation_deg: float
    view_index: int | None
    reason: str


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A view that may come next, with the areas (m2) it is expected to show.

    ``overlap_m2`` is cloth in common with the shape, ``improved_m2`` cloth that was seen only at steep
    angles so far, ``beyond_m2`` cloth beyond the rim of the shape, ``joining_m2`` cloth of floating
    pieces that the view may connect, ``unseen_m2`` an allowance for cloth that nothing hints at;
    ``gap_deg`` is the turn to the nearest view that was looked at.
    """

    view_index: int
    overlap_m2: float
    improved_m2: float
    beyond_m2: float
    joining_m2: float
    unseen_m2: float
    gap_deg: float

    @property
    def new_m2(self) -> float:
        """Expected new area."""
        return self.improved_m2 + self.beyond_m2 + self.joining_m2 + self.unseen_m2


@dataclass(frozen=True, kw_only=True)
class Plan:
    """The next view, or None with the reason.

    ``sides`` holds the plan of each side (``paper``); ``candidates`` the views rated best (``robust``).
    """

    view_index: int | None
    side: Side | None
    rotation_deg: float
    reason: str
    sides: tuple[SidePlan, ...]
    candidates: tuple[Candidate, ...] = ()


@dataclass(frozen=True)
class AlignmentScore:
    """How well two views agree: ``total`` in 0..1 and its named parts, units in the names.

    ``apart_part`` names the part that says how far apart (mm) the placement leaves the cloth.
    """

    total: float
    parts: dict[str, float]
    apart_part: str = ""

    @property
    def apart_mm(self) -> float | None:
        """How far apart the placement leaves the cloth, in the method's own measure; None if unknown."""
        value = self.parts.get(self.apart_part, math.nan)
        return float(value) if math.isfinite(value) else None


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
    """The initial estimate and what it came from (paper, Fig. 4d, e).

    ``new_curves`` are h^1(u), A_z^1(u) at the new view's rotation; ``common_range_deg`` the
    Z-angles, before the rotation, seen in both views; ``a_m_deg`` its middle; the two lines and
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
    """A new view laid on the current one, with the way there."""

    current_from_new: Rigid2
    initial: Rigid2
    score: AlignmentScore
    initial_score: AlignmentScore
    correspondence: Correspondence | None


@dataclass(frozen=True, kw_only=True)
class Hypothesis:
    """A possible placement of a component of a view.

    ``source`` names the estimator of ``initial``, ``current_from_new`` is the placement after
    refinement; ``score`` is that of :func:`flatcloth.methods.robust.scoring.score_placement`;
    ``std`` (3,) are standard deviations of turn (rad), u and v (m).
    """

    source: str
    component: int
    initial: Rigid2
    current_from_new: Rigid2
    score: AlignmentScore
    std: Float64

    @property
    def undetermined(self) -> tuple[str, ...]:
        """The directions that the cloth in common does not determine."""
        names = []
        if self.std[0] > math.radians(5.0):
            names.append("turn")
        names += [n for n, s in zip(("across", "along"), self.std[1:], strict=True) if s > 0.008]
        return tuple(names)


@dataclass(frozen=True, kw_only=True)
class ComponentPlacement:
    """The best hypothesis for one component of a view; None if nothing connects it to the shape yet."""

    component: int
    area_m2: float
    hypothesis: Hypothesis | None


@dataclass(frozen=True, kw_only=True)
class Placement:
    """Where a method places a view: the ``alignment`` of its ``component``, and what else it considered.

    ``hypotheses`` are those for that component, the best first; ``margin`` is the difference of the best
    score to the second (the score itself, if there is no second); ``cameras`` is the result of the
    registration in a sentence; ``parts`` has one entry for each component of the view. Only
    ``component`` and ``alignment`` are required of a method. ``also`` are further components, of this view or
    of accepted ones, each with a motion of its own, that are placed with it.
    """

    component: int
    alignment: Alignment
    hypotheses: tuple[Hypothesis, ...] = ()
    margin: float = math.nan
    cameras: str = ""
    parts: tuple[ComponentPlacement, ...] = ()
    also: tuple[PlacedPart, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Canonical:
    """The canonical view so far.

    ``view`` is its raster; ``current_from_view`` maps each accepted view's index to the motion from
    that view's own plane to this plane (by the paper's method the plane of the view added last).
    ``floating`` are pieces of cloth that nothing seen connects to it, each in a plane of its own.
    """

    view: FlattenedView
    current_from_view: dict[int, Rigid2]
    floating: tuple[FlattenedView, ...] = ()


@dataclass(frozen=True, kw_only=True)
class SurfaceEdges:
    """The edges of Eq. (2) behind a shape, as they lie on its plane now.

    ``uv_m`` (N, 2) and ``xyz_m`` (N, 3, held frame) of the samples, NaN where one has no place;
    ``edges`` (M, 2) int32; ``length_m`` (M,) along the cloth.
    """

    uv_m: Float64
    xyz_m: Float64
    edges: Int32
    length_m: Float64


class Views(Protocol):
    """The single views of a recording, from which methods build shapes."""

    config: Config
    axis: RotationAxis
    held_point_m: Float64

    def flattening(self, view_index: int) -> Flattening:
        """Return the flattened view of a view with its surface (cached)."""
        ...

    def part(self, view_index: int, component: int) -> FlattenedView:
        """Return one connected component of a flattened view, the largest being 0."""
        ...

    def observed_areas_m2(self, progress: Progress = no_progress) -> Float64:
        """Return the observed area of the side of interest in each view (n_views,), cached."""
        ...


class Method(Protocol):
    """A method of integrating views.

    A method derives everything from a session's document and caches it by the document's prefix, so
    that undo is exact. Subclasses implement the abstract methods; the others have defaults.

    Parameters
    ----------
    views : Views
        The single views.
    angles_deg : sequence of float
        The angles of all views of the recording.
    """

    name: ClassVar[str]
    """As registered."""
    angles_deg: Sequence[float]

    @abstractmethod
    def __init__(self, views: Views, angles_deg: Sequence[float]) -> None: ...

    @classmethod
    def default_config(cls) -> Config:
        """Return the configuration that the method uses unless told otherwise."""
        return Config()

    @property
    @abstractmethod
    def accept_score(self) -> float:
        """Without an operator, a proposal with a lower score is refused."""

    @abstractmethod
    def start_view(self, progress: Progress = no_progress) -> int | None:
        """Choose the start view; None if no view can be flattened without folds."""

    @abstractmethod
    def canonical(self, document: Document) -> Canonical:
        """Return the canonical view of a document's accepted views.

        Raises
        ------
        FlatclothError
            If the session has no start view.
        """

    @abstractmethod
    def plan(self, document: Document, unusable: set[int]) -> Plan:
        """Choose the next view; ``unusable`` are views that cannot be flattened."""

    @abstractmethod
    def propose(
        self, document: Document, view_index: int, side: Side | None, progress: Progress = no_progress
    ) -> Placement:
        """Find where a view lies on the shape.

        Raises
        ------
        SurfaceError, FlatteningError
            If the view shows too little.
        AlignmentError
            If nothing of the view can be placed.
        """

    @abstractmethod
    def score(self, document: Document, view_index: int, component: int, motion: Rigid2) -> AlignmentScore:
        """Score a placement, however it was found."""

    @abstractmethod
    def refined(self, document: Document, view_index: int, component: int, motion: Rigid2) -> Rigid2:
        """Refine a placement locally."""

    @abstractmethod
    def carried(self, document: Document, later: Later) -> Rigid2:
        """Return where a later decision lies on the present plane if it moves along with the shape."""

    @abstractmethod
    def surface_edges(self, document: Document) -> SurfaceEdges:
        """Return the edges of Eq. (2) behind the shape."""

    def is_contradicted(self, document: Document) -> bool:
        """Tell whether the other views contradict the view accepted last; False if that is not checked."""
        return False

    def cameras(self, document: Document) -> Registered | None:
        """Return the registered cameras of the accepted views; None if the method registers none."""
        return None

    def side_of(self, document: Document, view_index: int) -> Side | None:
        """Return the side that a view chosen by the operator extends; None if sides do not matter."""
        return None

    def continued(self, document: Document, view_index: int, side: Side | None) -> tuple[Side, int]:
        """Return the side that a view extends, and the accepted view that it continues there.

        By default the accepted view that is turned least from it.
        """
        used = [v for v in (document.start_view, *(a.view_index for a in document.accepted)) if v is not None]
        angles = np.asarray(self.angles_deg)
        turns = (angles[view_index] - angles[used] + 180.0) % 360.0 - 180.0
        nearest = int(np.argmin(np.abs(turns)))
        return (Side.LEFT if turns[nearest] >= 0 else Side.RIGHT), used[nearest]
