"""The interface of methods.

:class:`Method` is the protocol, :mod:`flatcloth.methods.answers` has the types of its answers, and
:mod:`flatcloth.methods.registry` lists the methods by name.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, ClassVar, Protocol

import numpy as np

from flatcloth.core.config import Config
from flatcloth.core.errors import FlatclothError
from flatcloth.core.geometry import Rigid3
from flatcloth.core.types import (
    Bool,
    FlattenedView,
    Float64,
    LaidPiece,
    Progress,
    RgbdFrame,
    Rigid2,
    RotationAxis,
    Uint8,
    no_progress,
)
from flatcloth.flattening.cloth import Cloth
from flatcloth.methods.answers import (
    AlignmentScore,
    Canonical,
    ClothPairs,
    JoinedPiece,
    JoinedSides,
    OneSide,
    Placement,
    Plan,
)
from flatcloth.session.document import Document, Side
from flatcloth.shape.joints import DecidedParts

if TYPE_CHECKING:
    from flatcloth.flattening.flatten import Flattening
    from flatcloth.flattening.surface import Surface
    from flatcloth.registration.registered import Registered


Focus = Callable[[Float64], Float64]
"""Weights (N,) of the cloth at places (N, 2) on the plane of a shape, m."""


class Views(Protocol):
    """The single views of a recording, the input of methods."""

    config: Config
    axis: RotationAxis
    held_point_m: Float64

    def flattening(self, view_index: int) -> Flattening:
        """Return the flattening of a view with its surface (cached)."""
        ...

    def surface(self, view_index: int) -> Surface:
        """Return the surface of a view without its flattening, which takes less time."""
        ...

    def part(self, view_index: int, component: int) -> FlattenedView:
        """Return one component of a flattened view; the largest is 0."""
        ...

    def observed_areas_m2(self, progress: Progress = no_progress) -> Float64:
        """Return the observed area of the side of interest in each view (n_views,), cached."""
        ...

    def unfolded_area_m2(self, view_index: int) -> float:
        """Return the area of the largest component, 0 if it is folded or cannot be flattened (cached)."""
        ...


class Method(Protocol):
    """A method of integrating views.

    A method computes everything from a session's document and caches it by the document's prefix, so
    that undo is exact. Subclasses implement the abstract methods; the others have defaults.

    Parameters
    ----------
    views : Views
        The single views.
    angles_deg : sequence of float
        The angles of all views of the recording.
    """

    name: ClassVar[str]
    """The registered name."""
    angles_deg: Sequence[float]
    joins_sides: ClassVar[bool] = False
    """Whether it joins the other side of an item to the shape: :meth:`with_other_side`."""
    has_sides: ClassVar[bool] = False
    """Whether a view extends the shape on one of two sides."""
    takes_all: ClassVar[bool] = False
    """Whether a shape is that of a set of views, so that a run takes all at once."""

    @abstractmethod
    def __init__(self, views: Views, angles_deg: Sequence[float]) -> None: ...

    @property
    @abstractmethod
    def accept_score(self) -> float:
        """Smallest score of a proposal that is accepted without an operator."""

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

    def release(self, *, surfaces: bool = False) -> None:
        """Free what only further views or earlier shapes need; it is made again if it is asked for.

        With ``surfaces``, those of the accepted views, too, from which its pictures are drawn.
        """
        return

    @abstractmethod
    def plan(self, document: Document, unusable: set[int]) -> Plan:
        """Choose the next view; ``unusable`` are views that cannot be flattened."""

    def look_ahead(self, document: Document, angles_deg: Sequence[float], focus: Focus | None = None) -> Plan:
        """Choose the next rotation among angles at which no view was taken yet.

        Parameters
        ----------
        document : Document
            The decisions; all recorded views have been looked at.
        angles_deg : sequence of float
            The angles of the recorded views, then those to choose from; the ``view_index`` of the plan, and
            of its candidates, is an index into them.
        focus : callable, optional
            Which cloth counts; by default all of it.
        """
        raise FlatclothError(f"the method {self.name} plans recorded views only; choose another method.")

    def least_m2(self, document: Document) -> float:
        """Return a lower bound of the area of the canonical view, found without drawing it if possible."""
        return self.canonical(document).view.area_m2

    def seams_ahead(
        self, document: Document, other: Method, its: Document, angles_deg: Sequence[float], *, related: bool
    ) -> Float64:
        """Return the floating cloth (K,), m2, of which views at angles are expected to show seams.

        Parameters
        ----------
        document, its : Document
            The decisions about this side, and about the other.
        other : Method
            The same method, made for the masks of the other side.
        angles_deg : sequence of float
            The angles.
        related : bool
            Seams join the sides already; otherwise the smaller of them counts as floating.
        """
        return np.zeros(len(angles_deg))

    @abstractmethod
    def propose(
        self, document: Document, view_index: int, side: Side | None, progress: Progress = no_progress
    ) -> Placement:
        """Find the placement of a view on the shape.

        Raises
        ------
        SurfaceError, FlatteningError
            If the view shows too little cloth.
        AlignmentError
            If no component of the view can be placed.
        """

    @abstractmethod
    def score(self, document: Document, view_index: int, component: int, motion: Rigid2) -> AlignmentScore:
        """Score a placement of any origin."""

    @abstractmethod
    def refined(self, document: Document, view_index: int, component: int, motion: Rigid2) -> Rigid2:
        """Refine a placement locally."""

    def cloth_of_pieces(self, document: Document) -> list[Cloth]:
        """Return how each piece is connected, the shape first; none if the edges have no evidence."""
        return []

    def as_decided(self, document: Document, parts: DecidedParts) -> tuple[Canonical, Cloth]:
        """Return the canonical view and its edges after decisions about parts."""
        raise AssertionError("a method without cloth has no parts to decide about")

    def why_unusable(self, view_index: int) -> str:
        """Return why a view shows too little cloth to be part of a shape; empty if it shows enough."""
        return ""

    def earlier(self, earlier: Document, document: Document) -> Canonical:
        """Return the canonical view of an ``earlier`` state of a document, for pictures of its growth.

        Cloth may lie where the whole ``document`` has it.
        """
        return self.canonical(earlier)

    def take_confirmed(self, cameras: Registered) -> None:
        """Take the recorded poses as confirmed by ``cameras``, registered by the other side of the item."""
        return

    def with_other_side(
        self,
        own: OneSide,
        laid: Sequence[LaidPiece],
        other: Method,
        its: OneSide,
        check: Callable[[], None],
    ) -> JoinedSides:
        """Join the other side of the item to the shape along the seams.

        Parameters
        ----------
        own : OneSide
            This side.
        laid : sequence of LaidPiece
            Its floating pieces that were placed by the garment.
        other, its
            The same method, made for the masks of the other side, and that side.
        check : callable
            Called between the steps; it raises ``CancelledError`` if the result is no longer wanted.
        """
        raise FlatclothError(f"the method {self.name} integrates one side.")

    def pixel_states(
        self, document: Document, frame: RgbdFrame, item: Bool, taken_off: Bool | None = None
    ) -> Uint8 | None:
        """Return what became of each pixel (H, W) of an accepted view; None if the method
        knows no more than its components.

        As :func:`flatcloth.flattening.pixel_states.states_of_view`, whose ``item`` (H, W) this is;
        samples ``taken_off`` (N,) of the shape's edges float.
        """
        return None

    def pairs(self, document: Document, view_index: int, component: int) -> ClothPairs | None:
        """Return the cloth that a component and the shape have in common; None if the method finds none."""
        return None

    def joined_piece(self, document: Document) -> JoinedPiece | None:
        """Return the floating piece that the pending view joins to the shape where it lies, None if none."""
        return None

    def cameras(self, document: Document) -> Registered | None:
        """Return the registered cameras of the accepted views; None if the method registers none."""
        return None

    def poses(self, document: Document) -> dict[int, Rigid3]:
        """Return ``object_from_camera`` of each accepted view; empty if the method registers none."""
        return {}
