"""The decisions about the garment: its kind, held points, placed pieces, seams; pure functions.

The plane of the shape may change when views are added. Places are therefore stored with points of the cloth:
in the object frame, and on the plane at the time of the decision.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import msgspec
from msgspec import Meta

from flatcloth.core.decoding import MisfitError, fitted
from flatcloth.core.errors import OutOfBoundsError

MAX_EXTENT_M = 10.0
"""Largest coordinate on a garment's plane: curtains and bed linen are smaller than 6 m."""
MOST_HELD = 64
"""Points that can be held: a kind has at most 20."""
MOST_PIECES = 256
"""Limits of what a decision may contain, as those in its types. Chosen: far above what the page sends."""
Number = Annotated[float, Meta(ge=-MAX_EXTENT_M, le=MAX_EXTENT_M)]
Name = Annotated[str, Meta(min_length=1, max_length=40)]
Point2 = tuple[Number, Number]
Points3 = Annotated[tuple[tuple[Number, Number, Number], ...], Meta(min_length=3, max_length=64)]


@dataclass(frozen=True)
class ClothPlaces:
    """Points of the cloth in the object frame, and their places on the plane of the shape."""

    points_m: Points3
    uv_m: tuple[Point2, ...]

    def __post_init__(self) -> None:
        """Refuse points without a place."""
        if len(self.points_m) != len(self.uv_m):
            raise ValueError("each point needs a place")


@dataclass(frozen=True)
class HeldPoint:
    """A named point that lies at a place of the plane because an operator put it there."""

    name: Name
    uv_m: Point2
    cloth: ClothPlaces


@dataclass(frozen=True)
class PlacedPiece:
    """A piece that lies on the plane of the shape by the garment or ``by_hand``, or is refused there.

    ``piece`` are points of its cloth with their places on the shape's plane; ``shape`` are points of the
    shape, which fix that plane. ``probability`` is that of the proposal, ``std_m`` the standard deviation of
    the place, 0 if it was not kept.
    """

    accepted: bool
    piece: ClothPlaces
    shape: ClothPlaces
    probability: Number
    std_m: Number = 0.0
    by_hand: bool = False


@dataclass(frozen=True)
class DecidedPart:
    """A part of a piece that the operator takes off, or keeps.

    ``part`` are points of its cloth and ``rest`` of the other cloth of the shape, with their places.
    ``probability`` is that of its joint when it was decided. With ``place``, a part that is taken off lies
    elsewhere by the same decision.
    """

    taken_off: bool
    part: ClothPlaces
    rest: ClothPlaces
    probability: Number
    place: PlacedPiece | None = None


@dataclass(frozen=True)
class DecidedSeam:
    """A seam between both sides that is cut, or joins them in any case (``kept``).

    ``points_m`` are some of its places in the object frame.
    """

    kept: bool
    points_m: Points3


@dataclass(frozen=True)
class GarmentDecisions:
    """All decisions about the garment; ``kind`` None: by the evidence.

    Of several decisions about a piece, a part or a seam, the last one counts.
    """

    kind: str | None = None
    held: tuple[HeldPoint, ...] = ()
    pieces: tuple[PlacedPiece, ...] = ()
    parts: tuple[DecidedPart, ...] = ()
    seams: tuple[DecidedSeam, ...] = ()


@dataclass(frozen=True)
class SetKind:
    """Set the kind of the garment; None: use the evidence."""

    garment: Name | None = None


@dataclass(frozen=True)
class ReleasePoints:
    """Release a named point, or all of them (None)."""

    name: str | None = None


GarmentCommand = SetKind | HeldPoint | ReleasePoints | PlacedPiece | DecidedPart | DecidedSeam


def why_not(decisions: GarmentDecisions, command: GarmentCommand) -> str | None:
    """Return why a decision is not allowed now, or None if it is."""
    match command:
        case SetKind(garment=kind) if kind == decisions.kind:
            return f"The kind is {kind} already." if kind else "The kind is that of the evidence already."
        case HeldPoint() if len(decisions.held) >= MOST_HELD:
            return f"{MOST_HELD} points are held, which is the most there can be. Release some."
        case ReleasePoints(name=None) if not decisions.held:
            return "No point is held."
        case ReleasePoints(name=str(name)) if name not in {held.name for held in decisions.held}:
            return f"The point {name!r:.60} is not held."
        case PlacedPiece() | DecidedPart() | DecidedSeam():
            name = {PlacedPiece: "pieces", DecidedPart: "parts", DecidedSeam: "seams"}[type(command)]
            if len(getattr(decisions, name)) >= MOST_PIECES:
                return f"{MOST_PIECES} {name} are decided about, which is the most there can be. Undo some."
    return None


def check_bounds(command: GarmentCommand) -> None:
    """Refuse names and places that no garment has; the types of a decision have their bounds.

    Raises
    ------
    OutOfBoundsError
        If a number is not finite or too large, or a text or list is too long; the message names it.
    """
    try:
        fitted(msgspec.to_builtins(command, enc_hook=float), type(command))
    except MisfitError as error:
        raise OutOfBoundsError(f"No garment has this: {error}.") from error


def decide(decisions: GarmentDecisions, command: GarmentCommand) -> tuple[str, GarmentDecisions]:
    """Return the name of a decision and all decisions with it."""
    match command:
        case SetKind(garment=kind):
            # Points of another kind do not exist on this one.
            return f"garment: {kind or 'by the evidence'}", replace(decisions, kind=kind, held=())
        case HeldPoint():
            held = tuple(each for each in decisions.held if each.name != command.name)
            return f"hold {command.name}", replace(decisions, held=(*held, command))
        case ReleasePoints(name=name):
            held = tuple(each for each in decisions.held if name is not None and each.name != name)
            return f"release {name or 'all points'}", replace(decisions, held=held)
        case PlacedPiece():
            verb = "place a piece by the garment" if command.accepted else "refuse a place by the garment"
            return verb, replace(decisions, pieces=(*decisions.pieces, command))
        case DecidedPart(place=place):
            verb = "cut a part off" if command.taken_off else "keep a part on the shape"
            verb = "place a part by hand" if place else verb
            parts = (*decisions.parts, replace(command, place=None))
            pieces = decisions.pieces if place is None else (*decisions.pieces, place)
            return verb, replace(decisions, parts=parts, pieces=pieces)
        case DecidedSeam():
            verb = "keep a seam" if command.kept else "cut a seam"
            return verb, replace(decisions, seams=(*decisions.seams, command))
