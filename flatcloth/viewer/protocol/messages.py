"""The messages of the page to the server, parsed strictly; a bad message becomes a notification.

Every message is a ``msgspec.Struct`` whose tag is its ``type``; numbers have the bounds of a garment's plane.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import reduce
from operator import or_
from typing import Annotated, Literal

import msgspec
from msgspec import Meta, inspect

from flatcloth.core.decoding import UNKNOWN, Finite, MisfitError, fitted, parse_json
from flatcloth.core.errors import FlatclothError
from flatcloth.rendering.layers import LayerName
from flatcloth.session.journal import SheetSide
from flatcloth.viewer.protocol.actions import REJECT_REASONS
from flatcloth.viewer.protocol.fields import (
    MAX_MESSAGE_CHARS,
    MAX_NAME_CHARS,
    BrushRadius,
    Count,
    Degrees,
    Lean,
    Metres,
    Pointed,
    Points,
    Radians,
    Said,
    StrokePixels,
    StrokePlaces,
    StrokeSide,
    Weights,
)
from flatcloth.viewer.protocol.garment import (
    DecideJoint,
    DecidePiece,
    HoldPoint,
    ReleasePoints,
    SetKind,
)

SessionAction = Literal[
    "step", "view", "accept", "reject", "skip", "reopen", "undo", "redo", "cancel", "restart"
]
CaptureAction = Literal["begin", "keep", "repeat", "turned", "aim", "finish"]


class MessageError(FlatclothError):
    """A message of the page is not valid; the text names the field and what was expected."""


class Do(Said, tag="do", frozen=True, kw_only=True):
    """Perform a session action; ``view_index`` is the view the user means, if the action has one."""

    action: SessionAction
    view_index: Count | None = None
    reason: str | None = None


class Move(Said, tag="move", frozen=True, kw_only=True):
    """Move the pending view: turn about its own centre, then shift on the plane."""

    view_index: Count
    theta_rad: Radians = 0.0
    u_m: Metres = 0.0
    v_m: Metres = 0.0


class BackToBest(Said, tag="back_to_best", frozen=True, kw_only=True):
    """Lay the pending view back at the best place that the method has found."""

    view_index: Count


class Preview(Move, tag="preview", frozen=True, kw_only=True):
    """Ask how the pending view would fit if it were moved so; ``id`` comes back with the answer."""

    id: Count


class TakePart(Said, tag="take_part", frozen=True, kw_only=True):
    """Place another connected part of the pending view, the largest being 0."""

    view_index: Count
    component: Count


class LeaveOut(Said, tag="leave_out", frozen=True, kw_only=True):
    """Leave out a part that would be placed with the pending view: a component of ``part_view``."""

    view_index: Count
    part_view: Count
    component: Count


class PlacePiece(Said, tag="place_piece", frozen=True, kw_only=True):
    """Place a floating piece by hand, shifted: a view that shows much of it becomes the proposal there."""

    label: str
    u_m: Metres = 0.0
    v_m: Metres = 0.0


class Refine(Said, tag="refine", frozen=True, kw_only=True):
    """Refine the pending view from where it lies."""

    view_index: Count


class Pairs(Said, tag="pairs", frozen=True, kw_only=True):
    """Pairs of points: of the pending view, in its own plane, and of the shape; ``fit`` moves it so.

    ``weights`` one a pair. Without ``fit`` only the residuals are asked for.
    """

    view_index: Count
    new_uv_m: Points
    shape_uv_m: Points
    weights: Weights
    fit: bool = False


class Hover(Said, tag="hover", frozen=True, kw_only=True):
    """Ask for all attributes at a place of the plane; ``id`` comes back with the answer.

    ``view`` asks where it falls in the source image of a view, too. ``sheet`` is the side of the item.
    """

    id: Count
    u_m: Pointed
    v_m: Pointed
    sheet: SheetSide = "this"
    view: Count | None = None


class HoverRay(Said, tag="hover_ray", frozen=True, kw_only=True):
    """Ask what a ray of the eye (object frame) hits first in 3D, and where that lies on the plane."""

    id: Count
    origin_m: tuple[Pointed, Pointed, Pointed]
    direction: tuple[Pointed, Pointed, Pointed]


class TurnTo(Said, tag="turn_to", frozen=True, kw_only=True):
    """Let the 3D camera look from where the real camera stood at a view."""

    view_index: Count


class Measure(Said, tag="measure", frozen=True, kw_only=True):
    """Ask for the distance between two places of the plane; ``id`` comes back with the answer."""

    id: Count
    from_u_m: Pointed
    from_v_m: Pointed
    to_u_m: Pointed
    to_v_m: Pointed
    sheet: SheetSide = "this"


class PickAt(Said, tag="pick", frozen=True, kw_only=True):
    """Pick the cloth at (or nearest to) a place of the plane.

    ``revision`` is that of the picture the user saw; it matters for the frames of a camera only, which
    change fast.
    """

    u_m: Pointed
    v_m: Pointed
    revision: Count | None = None
    sheet: SheetSide = "this"


class ShowPick(Said, tag="show_pick", frozen=True, kw_only=True):
    """Make a pick of the list the current one, and ``keep`` it there; None: none is current."""

    id: Count | None = None
    keep: bool = False


class RenamePick(Said, tag="rename_pick", frozen=True, kw_only=True):
    """Give a pick of the list another name."""

    id: Count
    name: Annotated[str, Meta(min_length=1, max_length=MAX_NAME_CHARS)]


class DeletePick(Said, tag="delete_pick", frozen=True, kw_only=True):
    """Delete a pick from the list."""

    id: Count


class SetGrip(Said, tag="grip", frozen=True, kw_only=True):
    """Change how a pick is gripped: ``axis_deg`` on the plane (u towards v) or along the outline; opening."""

    id: Count
    axis_deg: Degrees | None = None
    outline: bool | None = None
    opening_m: Metres | None = None


class GoTo(Said, tag="go_to", frozen=True, kw_only=True):
    """Undo or redo until ``done`` of the decisions are done; ``of`` are those that were listed, in number."""

    done: Count
    of: Count


class SetAuto(Said, tag="auto", frozen=True, kw_only=True):
    """Switch Auto on or off."""

    running: bool


class Set(Said, tag="set", frozen=True, kw_only=True):
    """Change settings of the page, see ``settings.Settings``; ``reset`` first restores all defaults."""

    reset: bool = False
    values: dict[str, bool | Finite | str] = msgspec.field(default_factory=dict)


class SetAxis(Said, tag="axis", frozen=True, kw_only=True):
    """Set the turning axis by hand, as the camera of view 0 sees it; without ``apply`` it is only drawn."""

    right_m: Metres
    away_m: Metres
    lean_right_deg: Lean
    lean_away_deg: Lean
    apply: bool


class Look(Said, tag="look", frozen=True, kw_only=True):
    """Colour the 3D scene by a layer of the flattened view, with its colour map and window."""

    layer: LayerName
    map: Annotated[str, Meta(max_length=40)] | None = None
    low: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0
    high: Annotated[float, Meta(ge=0.0, le=1.0)] = 1.0


class Play(Said, tag="play", frozen=True, kw_only=True):
    """Show the newest frame of the camera, or hold the present one."""

    playing: bool


class Capture(Said, tag="capture", frozen=True, kw_only=True):
    """Guided capture: begin, keep, repeat, turned, aim (at ``angle_deg``) or finish."""

    action: CaptureAction
    angle_deg: Degrees | None = None


class Aim(Said, tag="aim", frozen=True, kw_only=True):
    """Give an active loop another goal: shape, kind, or points:NAME,NAME."""

    goal: str


class StrokeImage(Said, tag="stroke_image", frozen=True, kw_only=True):
    """Say which side the cloth under a stroke on the image of a view is; ``radius_m`` on the cloth."""

    side: StrokeSide
    view_index: Count
    points_rc: StrokePixels
    radius_m: BrushRadius


class StrokeShape(Said, tag="stroke_shape", frozen=True, kw_only=True):
    """Say which side the cloth under a stroke on the flattened shape is."""

    side: StrokeSide
    points_uv_m: StrokePlaces
    radius_m: BrushRadius
    sheet: SheetSide = "this"


class CutShape(Said, tag="cut_shape", frozen=True, kw_only=True):
    """Say that the cloth beyond a line on the flattened shape is not of interest."""

    points_uv_m: StrokePlaces
    beyond_uv_m: tuple[Metres, Metres]
    sheet: SheetSide = "this"


class Brush(Said, tag="brush", frozen=True, kw_only=True):
    """Paint by clicks in the 3D scene as well, or (``side`` None) pick there again."""

    side: StrokeSide | None = None
    radius_m: BrushRadius = 0.01


class WhereToStroke(Said, tag="where_to_stroke", frozen=True, kw_only=True):
    """Ask where strokes would settle most: the best place (0), the next ones, or (negative) those before."""

    number: Annotated[int, Meta(ge=-1000, le=1000)] = 0


GarmentDecision = SetKind | HoldPoint | ReleasePoints | DecidePiece | DecideJoint
Message = Said
"""Any message of the page: each subclass is one."""


def _subclasses(kind: type[Said]) -> Iterator[type[Said]]:
    for each in kind.__subclasses__():
        yield from (each, *_subclasses(each))


KINDS = {str(kind.__struct_config__.tag): kind for kind in _subclasses(Said)}


def parse(text: str) -> Message:
    """Read one message of the page.

    Raises
    ------
    MessageError
        If it is not JSON, of an unknown type, or has missing, unknown or wrong fields.
    """
    if len(text) > MAX_MESSAGE_CHARS:
        raise MessageError(f"A message of over {MAX_MESSAGE_CHARS} characters is too long; reload the page.")
    try:
        message = _DECODER.decode(text)
    except msgspec.ValidationError as error:
        raise _not_understood(text) from error
    except (msgspec.DecodeError, UnicodeEncodeError, RecursionError) as error:
        raise MessageError(f"A message was not JSON ({error}); reload the page.") from error
    _check(message)
    return message


_DECODER: msgspec.json.Decoder[Message] = msgspec.json.Decoder(reduce(or_, KINDS.values()))


def _not_understood(text: str) -> MessageError:
    """Say what is wrong with a message that is JSON."""
    try:
        raw = parse_json(text)
    except ValueError as error:
        return MessageError(f"A message was not JSON ({error}); reload the page.")
    if not isinstance(raw, dict):
        return MessageError("A message was not a JSON object; reload the page.")
    kind = raw.get("type")
    if not isinstance(kind, str) or kind not in KINDS:
        return MessageError(f"Unknown message type {kind!r:.60}; known are {', '.join(KINDS)}.")
    try:
        fitted(raw, KINDS[kind])
    except MisfitError as error:
        if error.found == UNKNOWN:
            known = ", ".join(KINDS[kind].__struct_fields__)
            return MessageError(f"Message {kind!r}: no field {error.where!r:.60}; known are {known}.")
        return MessageError(f"Message {kind!r}: {error}{_known(KINDS[kind], error)}.")
    return MessageError(f"Message {kind!r} was not understood; reload the page.")


def _known(kind: type[Said], error: MisfitError) -> str:
    """List the values of a field that has a few."""
    about = inspect.type_info(kind)
    assert isinstance(about, inspect.StructType)
    kinds = [field.type for field in about.fields if field.name == error.where]
    return "".join(f": {', '.join(map(str, k.values))}" for k in kinds if isinstance(k, inspect.LiteralType))


def _check(message: Message) -> None:
    match message:
        case Do(action="view" | "reopen" as action, view_index=None):
            raise MessageError(f"Action {action!r} needs a view_index.")
        case Do(reason=str(reason)) if reason not in REJECT_REASONS:
            raise MessageError(f"Unknown reason {reason!r:.60}; known are {', '.join(REJECT_REASONS)}.")
        case Capture(action=action, angle_deg=angle) if (action == "aim") != (angle is not None):
            raise MessageError(f"A capture cannot {action!r} so; only aiming has an angle.")
        case RenamePick(name=name) if not name.strip():
            raise MessageError(f"A pick's name has 1 to {MAX_NAME_CHARS} characters.")
