"""The messages of the page to the server, parsed strictly; a bad message becomes a notification.

Every message is a ``msgspec.Struct`` whose tag is its ``type``; numbers have the bounds of a garment's plane.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import reduce
from operator import or_
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from flatcloth.core.decoding import Finite
from flatcloth.core.errors import FlatclothError
from flatcloth.rendering.layers import LayerName
from flatcloth.session.garment import MAX_EXTENT_M
from flatcloth.session.journal import SheetSide
from flatcloth.viewer.protocol.actions import REJECT_REASONS

# Limits of what a page may send. Chosen: far above what the page's own controls send.
MAX_MESSAGE_CHARS = 100_000  # of a whole message
MAX_NAME_CHARS = 80  # of a pick
MAX_PAIRS = 50  # of points of cloth, of which two fix a place
MAX_ANGLE_DEG = 3600.0  # of any angle: ten turns
MAX_STROKE_POINTS = 1000  # of one stroke
MAX_BRUSH_M = 0.2  # radius

Metres = Annotated[float, Meta(ge=-MAX_EXTENT_M, le=MAX_EXTENT_M)]
"""A place on a garment's plane, or a shift there."""
Pointed = Annotated[float, Meta(ge=-1000.0, le=1000.0)]
"""Where the pointer is, in metres of the plane: also far off the garment, where the page is zoomed out."""
Radians = Annotated[float, Meta(ge=-100.0, le=100.0)]
Degrees = Annotated[float, Meta(ge=-MAX_ANGLE_DEG, le=MAX_ANGLE_DEG)]
Count = Annotated[int, Meta(ge=-(2**53), le=2**53)]
"""A number of a view, a frame, a pick or a question: what JavaScript counts exactly."""
Points = Annotated[tuple[tuple[Metres, Metres], ...], Meta(max_length=MAX_PAIRS)]
StrokePixels = Annotated[
    tuple[tuple[Annotated[float, Meta(ge=-1.0, le=1e5)], Annotated[float, Meta(ge=-1.0, le=1e5)]], ...],
    Meta(min_length=1, max_length=MAX_STROKE_POINTS),
]
"""A line of pixels (row, col) of a recorded image."""
StrokePlaces = Annotated[tuple[tuple[Metres, Metres], ...], Meta(min_length=1, max_length=MAX_STROKE_POINTS)]
"""A line of places (u, v) of the flattened plane."""
BrushRadius = Annotated[float, Meta(gt=0.0, le=MAX_BRUSH_M)]
SessionAction = Literal[
    "step", "view", "accept", "reject", "skip", "reopen", "undo", "redo", "cancel", "restart"
]
CaptureAction = Literal["begin", "keep", "repeat", "turned", "aim", "finish"]


class MessageError(FlatclothError):
    """A message of the page is not valid; the text names the field and what was expected."""


class Said(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="type"):
    """The common part of all messages: their ``type``."""


class Do(Said, tag="do", frozen=True, kw_only=True):
    """Perform a session action; ``view_index`` is the view the user means, if the action has one."""

    action: SessionAction
    view_index: Count | None = None
    reason: Annotated[str, Meta(pattern=f"^({'|'.join(REJECT_REASONS)})$")] | None = None


class Move(Said, tag="move", frozen=True, kw_only=True):
    """Move the pending view: turn about its own centre, then shift on the plane."""

    view_index: Count
    theta_rad: Radians = 0.0
    u_m: Metres = 0.0
    v_m: Metres = 0.0


class Preview(Move, tag="preview", frozen=True, kw_only=True):
    """Ask how the pending view would fit if it were moved so; ``id`` comes back with the answer."""

    id: Count


class TakePart(Said, tag="take_part", frozen=True, kw_only=True):
    """Place another connected part of the pending view, the largest being 0."""

    view_index: Count
    component: Count


class Refine(Said, tag="refine", frozen=True, kw_only=True):
    """Refine the pending view from where it lies."""

    view_index: Count


class Pairs(Said, tag="pairs", frozen=True, kw_only=True):
    """Pairs of points: of the pending view, in its own plane, and of the shape; ``fit`` moves it so.

    Without ``fit`` only the residuals are asked for.
    """

    view_index: Count
    new_uv_m: Points
    shape_uv_m: Points
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
    name: Annotated[str, Meta(pattern=r"\S", max_length=MAX_NAME_CHARS)]


class DeletePick(Said, tag="delete_pick", frozen=True, kw_only=True):
    """Delete a pick from the list."""

    id: Count


class SetGrip(Said, tag="grip", frozen=True, kw_only=True):
    """Change how a pick is gripped: ``axis_deg`` on the plane (u towards v) or along the outline; opening."""

    id: Count
    axis_deg: Degrees | None = None
    outline: bool | None = None
    opening_m: Metres | None = None


class SetAuto(Said, tag="auto", frozen=True, kw_only=True):
    """Switch Auto on or off."""

    running: bool


class Set(Said, tag="set", frozen=True, kw_only=True):
    """Change settings of the page, see ``settings.Settings``; ``reset`` first restores all defaults."""

    reset: bool = False
    values: dict[str, bool | Finite | str] = msgspec.field(default_factory=dict)


class Look(Said, tag="look", frozen=True, kw_only=True):
    """Colour the 3D scene by a layer of the flattened view."""

    layer: LayerName


class Play(Said, tag="play", frozen=True, kw_only=True):
    """Show the newest frame of the camera, or hold the present one."""

    playing: bool


class Drawn(Said, tag="drawn", frozen=True, kw_only=True):
    """The frame of a camera is drawn: the next one may come."""

    revision: Count


class Capture(Said, tag="capture", frozen=True, kw_only=True):
    """Guided capture: begin, keep, repeat, turned, aim (at ``angle_deg``) or finish."""

    action: CaptureAction
    angle_deg: Degrees | None = None


class Aim(Said, tag="aim", frozen=True, kw_only=True):
    """Give an active loop another goal: shape, kind, or points:NAME,NAME."""

    goal: str


class StrokeImage(Said, tag="stroke_image", frozen=True, kw_only=True):
    """Say which side the cloth under a stroke on the image of a view is; ``radius_m`` on the cloth."""

    side: SheetSide
    view_index: Count
    points_rc: StrokePixels
    radius_m: BrushRadius


class StrokeShape(Said, tag="stroke_shape", frozen=True, kw_only=True):
    """Say which side the cloth under a stroke on the flattened shape is."""

    side: SheetSide
    points_uv_m: StrokePlaces
    radius_m: BrushRadius
    sheet: SheetSide = "this"


class Brush(Said, tag="brush", frozen=True, kw_only=True):
    """Paint by clicks in the 3D scene as well, or (``side`` None) pick there again."""

    side: SheetSide | None = None
    radius_m: BrushRadius = 0.01


class WhereToStroke(Said, tag="where_to_stroke", frozen=True, kw_only=True):
    """Ask where strokes would settle most: the best place (0), the next ones, or (negative) those before."""

    number: Annotated[int, Meta(ge=-1000, le=1000)] = 0


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


class PickPoint(Said, tag="pick_point", frozen=True, kw_only=True):
    """Pick a named point of the garment as a grasp."""

    name: GarmentName


class ShowOther(Said, tag="other_side", frozen=True, kw_only=True):
    """Compute the other side of the item, if it is not known yet."""


class Decide(Said, tag="decide", frozen=True, kw_only=True):
    """Decide about a hypothesis: ``index`` in the list of what is in doubt at this ``revision``.

    It holds (keep), or does not (cut); or its cloth lies where ``place``, a turn and a shift of the plane,
    leads it, or (hand) becomes the proposal there.
    """

    revision: Count
    index: Annotated[int, Meta(ge=0)]
    how: Literal["keep", "cut", "place", "hand"]
    place: tuple[Radians, Metres, Metres] = (0.0, 0.0, 0.0)


GarmentDecision = SetKind | HoldPoint | ReleasePoints
Message = Said
"""Any message of the page: each subclass is one."""


def _subclasses(kind: type[Said]) -> Iterator[type[Said]]:
    for each in kind.__subclasses__():
        yield from (each, *_subclasses(each))


KINDS = {str(kind.__struct_config__.tag): kind for kind in _subclasses(Said)}


_DECODER: msgspec.json.Decoder[Message] = msgspec.json.Decoder(reduce(or_, KINDS.values()))


def parsed(text: str) -> Message | MessageError:
    """Return one message of the page, or what is wrong with it.

    It may be no JSON, of an unknown type, or have missing, unknown or wrong fields.
    """
    if len(text) > MAX_MESSAGE_CHARS:
        return MessageError(f"A message of over {MAX_MESSAGE_CHARS} characters is too long; reload the page.")
    try:
        return _DECODER.decode(text)
    except (msgspec.DecodeError, UnicodeEncodeError, RecursionError) as error:
        return MessageError(f"A message was not understood: {error}. Reload the page.")
