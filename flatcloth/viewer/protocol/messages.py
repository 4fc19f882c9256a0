"""What the page may say to the server: parsed strictly, so that a bad message is only a notification."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from flatcloth.core.errors import FlatclothError
from flatcloth.rendering.layers import LAYERS
from flatcloth.viewer.protocol.actions import REJECT_REASONS

MAX_MESSAGE_CHARS = 100_000
MAX_NAME_CHARS = 80
MAX_FPS = 240.0


MAX_PAIRS = 50

Numbers = tuple[float, ...]
Points = tuple[tuple[float, float], ...]


class MessageError(FlatclothError):
    """A message that the page's server does not understand; names the field and what was expected."""


@dataclass(frozen=True, kw_only=True)
class Do:
    """Perform a session action; ``view_index`` is the view the user means, if the action has one."""

    action: str
    view_index: int | None = None
    reason: str | None = None


@dataclass(frozen=True, kw_only=True)
class Move:
    """Move the pending view: turn about its own centre, then shift on the plane."""

    view_index: int
    theta_rad: float = 0.0
    u_m: float = 0.0
    v_m: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Choose:
    """Lay the pending view where one of its hypotheses says; ``index`` 0 is the best."""

    view_index: int
    index: int


@dataclass(frozen=True, kw_only=True)
class Preview(Move):
    """Ask how the pending view would fit if it were moved so; ``id`` comes back with the answer."""

    id: int


@dataclass(frozen=True, kw_only=True)
class TakePart:
    """Place another connected part of the pending view, the largest being 0."""

    view_index: int
    component: int


@dataclass(frozen=True, kw_only=True)
class Refine:
    """Refine the pending view from where it lies."""

    view_index: int


@dataclass(frozen=True, kw_only=True)
class Pairs:
    """Pairs of points: of the pending view, in its own plane, and of the shape; ``fit`` moves it so.

    ``weights`` one a pair. Without ``fit`` only the residuals are asked for.
    """

    view_index: int
    new_uv_m: Points
    shape_uv_m: Points
    weights: Numbers
    fit: bool = False


@dataclass(frozen=True, kw_only=True)
class Hover:
    """Ask for all attributes at a place of the plane; ``id`` comes back with the answer.

    ``view`` asks where it falls in the source image of a view, too.
    """

    id: int
    u_m: float
    v_m: float
    view: int | None = None


@dataclass(frozen=True, kw_only=True)
class Measure:
    """Ask for the distance between two places of the plane; ``id`` comes back with the answer."""

    id: int
    from_u_m: float
    from_v_m: float
    to_u_m: float
    to_v_m: float


@dataclass(frozen=True, kw_only=True)
class PickAt:
    """Pick the cloth at (or nearest to) a place of the plane.

    ``revision`` tells which picture the user saw; only frames of live mode change fast enough for
    that to matter.
    """

    u_m: float
    v_m: float
    revision: int | None = None


@dataclass(frozen=True, kw_only=True)
class ShowPick:
    """Make a pick of the list the current one; None: none is current."""

    id: int | None = None


@dataclass(frozen=True, kw_only=True)
class RenamePick:
    """Give a pick of the list another name."""

    id: int
    name: str


@dataclass(frozen=True, kw_only=True)
class DeletePick:
    """Delete a pick from the list."""

    id: int


@dataclass(frozen=True, kw_only=True)
class SetGrip:
    """Change how a pick is gripped: ``axis_deg`` on the plane (u towards v) or along the outline; opening."""

    id: int
    axis_deg: float | None = None
    outline: bool | None = None
    opening_m: float | None = None


@dataclass(frozen=True, kw_only=True)
class SetAuto:
    """Switch Auto on or off."""

    running: bool


@dataclass(frozen=True, kw_only=True)
class Set:
    """Change settings of the page, see ``settings.SETTINGS``; ``reset`` sets all as at first, before."""

    reset: bool = False
    auto_threshold: float | None = None
    advance: bool | None = None
    follow: bool | None = None
    step_mm: float | None = None
    step_deg: float | None = None


@dataclass(frozen=True, kw_only=True)
class ShowEdges:
    """Draw the edges that the flattening strained in the 3D scene as well, or not."""

    show: bool


@dataclass(frozen=True, kw_only=True)
class Play:
    """Live mode: play or pause, turn round, change the rate, or show a frame by hand."""

    playing: bool | None = None
    forward: bool | None = None
    fps: float | None = None
    frame: int | None = None
    step: int | None = None


@dataclass(frozen=True, kw_only=True)
class Capture:
    """Guided capture: begin, keep, repeat, turned, aim (at ``angle_deg``) or finish."""

    action: str
    angle_deg: float | None = None


@dataclass(frozen=True, kw_only=True)
class Ready:
    """Live mode: the tab has drawn what it was sent, and takes the next frame with this layer."""

    layer: str


Message = (
    Do
    | Move
    | Choose
    | Preview
    | Refine
    | TakePart
    | Pairs
    | Hover
    | Measure
    | PickAt
    | ShowPick
    | RenamePick
    | DeletePick
    | SetGrip
    | SetAuto
    | Set
    | ShowEdges
    | Play
    | Ready
    | Capture
)

KINDS: dict[str, type[Message]] = {
    "do": Do,
    "move": Move,
    "choose": Choose,
    "preview": Preview,
    "refine": Refine,
    "take_part": TakePart,
    "pairs": Pairs,
    "hover": Hover,
    "measure": Measure,
    "pick": PickAt,
    "show_pick": ShowPick,
    "rename_pick": RenamePick,
    "delete_pick": DeletePick,
    "grip": SetGrip,
    "auto": SetAuto,
    "set": Set,
    "edges": ShowEdges,
    "play": Play,
    "ready": Ready,
    "capture": Capture,
}

CAPTURE_ACTIONS = frozenset({"begin", "keep", "repeat", "turned", "aim", "finish"})
SESSION_ACTIONS = frozenset(
    {"step", "view", "accept", "reject", "skip", "reopen", "undo", "redo", "cancel", "restart"}
)


def parse(text: str) -> Message:
    """Read one message of the page.

    Raises
    ------
    MessageError
        If it is not JSON, of an unknown type, or has missing, unknown or wrong fields.
    """
    if len(text) > MAX_MESSAGE_CHARS:
        raise MessageError(f"A message of {len(text)} characters is too long; reload the page.")
    try:
        raw = json.loads(text)
    except ValueError as error:
        raise MessageError(f"A message was not JSON ({error}); reload the page.") from error
    if not isinstance(raw, dict):
        raise MessageError("A message was not a JSON object; reload the page.")
    kind = raw.pop("type", None)
    if not isinstance(kind, str) or kind not in KINDS:
        raise MessageError(f"Unknown message type {kind!r}; known are {', '.join(KINDS)}.")
    message = _fill(KINDS[kind], kind, raw)
    _check(message)
    return message


def _fill(target: type[Message], kind: str, raw: Mapping[str, Any]) -> Message:
    known = {f.name: f for f in fields(target)}
    for name in raw:
        if name not in known:
            raise MessageError(f"Message {kind!r}: no field {name!r}; known are {', '.join(known)}.")
    values = {name: _value(kind, name, str(f.type), raw[name]) for name, f in known.items() if name in raw}
    try:
        return target(**values)
    except TypeError as error:
        raise MessageError(f"Message {kind!r}: a field is missing ({error}).") from error


def _value(kind: str, name: str, hint: str, value: Any) -> Any:
    if value is None and hint.endswith("| None"):
        return None
    wanted = hint.removesuffix(" | None")
    if wanted == "float" and _is_number(value):
        return float(value)
    if wanted == "Numbers" and isinstance(value, list) and all(map(_is_number, value)):
        return tuple(map(float, value))
    if wanted == "Points" and isinstance(value, list) and all(map(_is_point, value)):
        return tuple((float(u), float(v)) for u, v in value)
    if wanted == "int" and isinstance(value, int) and not isinstance(value, bool) and abs(value) < 2**53:
        return value
    if wanted == "str" and isinstance(value, str):
        return value
    if wanted == "bool" and isinstance(value, bool):
        return value
    raise MessageError(f"Message {kind!r}: {name} must be of type {hint}, not {value!r:.60}.")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _is_point(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 2 and all(map(_is_number, value))


def _check(message: Message) -> None:
    match message:
        case Do(action=action) if action not in SESSION_ACTIONS:
            known = ", ".join(sorted(SESSION_ACTIONS))
            raise MessageError(f"Unknown action {action!r:.60}; known are {known}.")
        case Do(action="view" | "reopen" as action, view_index=None):
            raise MessageError(f"Action {action!r} needs a view_index.")
        case Do(reason=str(reason)) if reason not in REJECT_REASONS:
            raise MessageError(f"Unknown reason {reason!r:.60}; known are {', '.join(REJECT_REASONS)}.")
        case Pairs(weights=weights) if len(weights) > MAX_PAIRS or any(w <= 0 for w in weights):
            raise MessageError(f"There are up to {MAX_PAIRS} pairs, and their weights are above 0.")
        case Play(fps=float(fps)) if not 0 < fps <= MAX_FPS:
            raise MessageError(f"The frame rate lies above 0 and up to {MAX_FPS:g}, not at {fps:g}.")
        case Capture(action=action, angle_deg=angle):
            if action not in CAPTURE_ACTIONS or (action == "aim") != (angle is not None):
                raise MessageError(f"A capture cannot {action!r:.40}; only aiming has an angle.")
        case Ready(layer=layer) if layer not in LAYERS:
            raise MessageError(f"There is no layer {layer!r:.40}; known are {', '.join(LAYERS)}.")
        case RenamePick(name=name) if not name.strip() or len(name) > MAX_NAME_CHARS:
            raise MessageError(f"A pick's name has 1 to {MAX_NAME_CHARS} characters.")
