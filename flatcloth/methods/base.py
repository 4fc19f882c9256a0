"""What every method of integrating views answers: plans, placements with what led to them, shapes."""

from __future__ import annotations

import math
from dataclasses import dataclass

from flatcloth.core.types import FlattenedView, Float64, Int32, Rigid2
from flatcloth.session.document import Side


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
class Prospect:
    """What a view promises, m2: cloth in common, cloth seen well for the first time, cloth beyond the rim.

    ``joining_m2`` is the floating cloth that it may join to the shape, ``unseen_m2`` what may appear
    that nothing hints at, ``gap_deg`` the turn to the nearest view that was looked at.
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
        """New reliable area."""
        return self.improved_m2 + self.beyond_m2 + self.joining_m2 + self.unseen_m2


@dataclass(frozen=True, kw_only=True)
class Plan:
    """The next view, or None with the reason.

    ``sides`` holds the plan of each side (paper); ``prospects`` the best views and what they promise
    (robust).
    """

    view_index: int | None
    side: Side | None
    rotation_deg: float
    reason: str
    sides: tuple[SidePlan, ...]
    prospects: tuple[Prospect, ...] = ()


@dataclass(frozen=True)
class AlignmentScore:
    """How well two views agree: ``total`` in 0..1 and its named parts, units in the names."""

    total: float
    parts: dict[str, float]


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
    """A place for a part of a view.

    ``source`` is where the idea came from; ``component`` the part; ``initial`` the idea and
    ``current_from_new`` what refinement made of it; ``score`` as :func:`flatcloth.methods.robust.scoring.lay`
    gives it, its total the confidence; ``std`` (3,) of turn (rad), u and v (m).
    """

    source: str
    component: int
    initial: Rigid2
    current_from_new: Rigid2
    score: AlignmentScore
    std: Float64

    @property
    def undetermined(self) -> tuple[str, ...]:
        """The directions that the cloth in common leaves open."""
        names = []
        if self.std[0] > math.radians(5.0):
            names.append("turn")
        names += [n for n, s in zip(("across", "along"), self.std[1:], strict=True) if s > 0.008]
        return tuple(names)


@dataclass(frozen=True, kw_only=True)
class PartPlace:
    """What became of one part of a view: its best hypothesis, None if nothing connects it yet."""

    component: int
    area_m2: float
    hypothesis: Hypothesis | None


@dataclass(frozen=True, kw_only=True)
class Placing:
    """Where a method lays a view: the ``alignment`` of its part ``component``, and what else it considered.

    ``hypotheses`` are those for that part, the best first; ``margin`` is how much more sure the best
    is than the second (its confidence, if there is no second); ``cameras`` says in words what the
    registration found; ``parts`` tells what becomes of all parts of the view. The paper's method has
    none of these.
    """

    component: int
    alignment: Alignment
    hypotheses: tuple[Hypothesis, ...] = ()
    margin: float = math.nan
    cameras: str = ""
    parts: tuple[PartPlace, ...] = ()


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
