"""The table of all actions; buttons, tooltips, keys and the sheet of commands are made from it."""

from __future__ import annotations

from msgspec import structs

from flatcloth.session.machine import (
    Accept,
    Cancel,
    Command,
    Phase,
    Propose,
    Redo,
    Reject,
    Reopen,
    Restart,
    SessionState,
    Skip,
    Start,
    Undo,
    why_illegal,
)
from flatcloth.viewer.protocol import Sent, table

REJECT_REASONS = ("too small", "wrong place", "bad depth", "wrong side", "other")
"""Reasons in the reject menu."""

DEFAULT_REASON = "wrong place"

ONLY_A_CAMERA = "The page shows a camera, where nothing is decided; open a recording to decide."
NO_CAMERA = "There is no camera; start with view --camera to capture with one."


class Action(Sent, frozen=True):
    """An action of the operator; ``why_not`` is the reason if it is not allowed now.

    ``keys`` are values of the browser's ``KeyboardEvent.key`` (letters match either case); the first
    is printed on the button. ``Space`` and ``Ctrl+z`` are written as such. The same key may have
    another meaning in another mode. ``group`` is ``session`` (the server decides whether it is
    allowed), ``proposal`` (needs a pending view), ``timeline`` (applies to views chosen there),
    ``capture`` (with a camera), ``view`` or ``page`` (always allowed), or
    ``teaching`` (while it is open). ``mode`` is that of the group, one of ``_MODES``, or "" if it is always
    available.
    """

    name: str
    title: str
    keys: tuple[str, ...]
    description: str
    group: str
    mode: str = ""
    why_not: str | None = None


_MODES = {
    "session": "session",
    "proposal": "session",
    "timeline": "session",
    "sides": "session",
    "doubt": "doubt",
    "capture": "capture",
    "teaching": "teaching",
}
_TABLE = {
    "session": """
step | Step | s | Choose the next view, flatten it and propose its placement.
accept | Accept | a | Make the proposed view part of the shape.
reject | Reject | r | Reject the proposed view (reason: wrong place).
reject_menu | Reject with reason | e | Reject the proposed view with a reason.
skip | Skip | k | Postpone the proposed view until the shape has grown or the others are done.
undo | Undo | u Ctrl+z | Undo the last decision.
redo | Redo | y Ctrl+y | Redo the decision that was undone.
auto | Auto | g | Accept proposals by their score; waits for you where one is unsure. Again: stop.
cancel | Cancel | Escape | Cancel the running computation.
restart | Restart | n | Start again from the largest view; this can be undone.
""",
    "timeline": """
reopen | Reopen | Ctrl+e | Decide again about the chosen view; all other decisions stay.
play_views | Play | Space | Turn the item once through all views; again: stop.
next_undecided | Next undecided | j | Go to the next view on the timeline without a decision.
review | List | Shift+r | Show or hide the list of all views: sort, filter, turn the item to one, decide
    again.
result | Result | Shift+e | Show or hide the result: areas, uncertainty, cloth left out, data to export.
doubts | Doubts | Shift+y | Show why it is joined, or not: weak joints, floating pieces, seams; keep, cut or
    place. Click cloth to ask.
""",
    "proposal": """
left | Move left | ArrowLeft | Move the proposal; Shift for ten times as far.
right | Move right | ArrowRight | Move the proposal; Shift for ten times as far.
up | Move up | ArrowUp | Move the proposal; Shift for ten times as far.
down | Move down | ArrowDown | Move the proposal; Shift for ten times as far.
turn_left | Turn left | [ { | Turn the proposal counter-clockwise; Shift for ten times as far.
turn_right | Turn right | ] } | Turn the proposal clockwise; Shift: tenfold.
pairs | Pairs | p | Pick pairs of points on the proposal and on the shape; again: stop.
fit_pairs | Fit pairs | Ctrl+Enter | Move the proposal so that the pairs fit.
refine | Refine from here | Ctrl+i | Let the method refine the present placement.
compare_shape | A: shape | , | Show the shape alone; again: both.
compare_proposal | B: proposal | . | Show the proposal alone; again: both.
blink | Blink | b | Blink the proposal against the shape; again: stop.
compare_difference | Difference | d | Map the difference in color; again: in height, in 3D, then both.
diagnostics | Diagnostics | i | Show the diagnostics of the proposal: pairs of cloth, or the paper's
    lines.
""",
    "capture": """
capture_pause | Pause | Space | Capture: hold the picture, or go on.
capture_turned | It is there | i | Capture: the item is at the requested angle.
capture_keep | Keep | m | Capture: keep the view that was taken.
capture_repeat | Repeat | j | Capture: take the view again.
""",
    "view": """
layer_color | Color | 1 | Show the color of the cloth.
layer_height | Height z | 2 | Show the height along the turning axis.
layer_z_angle | Z-angle | 3 | Show the Z-angle of each pixel in its view.
layer_source | Source | 4 | Show the source view of each pixel.
layer_stretch | Stretch | 5 | Show the change of lengths by flattening.
layer_incidence | Incidence | 6 | Show the incidence angle of each pixel.
layer_density | Density | 7 | Show the density of the measurement.
layer_place | Uncertainty | 8 | Show the placement uncertainty of each pixel.
layer_truth | Error | * | Show the error of each pixel by the recorded kit.
fit | Fit | f | Fit the whole flattened view into its pane.
zoom_in | Zoom in | + = | Zoom in.
zoom_out | Zoom out | - | Zoom out.
look | Look | Shift+l | All layers; rotate, ruler; what the 3D scene shows. The data stay as they are.
turn_left_seen | Turn view ↺ | 9 | Rotate the display of the flattened view counter-clockwise.
turn_right_seen | Turn view ↻ | 0 | Rotate the display of the flattened view clockwise.
source_image | Source image | Shift+i | Show or hide the source image with its mask, and the views of the
    pick; the wheel zooms into it.
garment | Garment | Shift+g | Show or hide the garment's outline and its named points.
upright | Upright | Shift+t | Turn the display so that the garment is upright; again: back.
source_mask | Mask | Shift+m | Show or hide the mask on the source image.
source_states | Left out | Shift+d | Show on the source image which pixels are not in the shape, and why.
ruler | Ruler | z | Measure by dragging: flat, along the cloth, through the air; Esc clears.
pointer | Pointer | Shift+p | Move the pointer with arrows (Shift: tenfold); Enter clicks, Space drags,
    Esc ends.
readout | Values | Shift+b | Fold or unfold the values under the pointer.
follow | Follow | v | Keep the 3D camera at the real camera's position.
""",
    "sides": """
brush_this | This side | Shift+s | Paint cloth of the side of interest: on the source image, the shape or
    the 3D scene; again: stop.
brush_other | Not this side | Shift+n | Paint cloth that is not of interest; again: stop.
brush_smaller | Smaller brush | < | Make the brush smaller.
brush_larger | Larger brush | > | Make the brush larger.
where_to_stroke | Where to stroke next | Shift+w | Go to the view and the place where a stroke settles
    most; again: the next undecided place.
where_before | Place before | ; | Go back to the undecided place before this one.
turn_over | Turn over | m | Turn the flattened garment over, computing its other side if need be; again:
    back.
beside | Side by side | Shift+j | Show both sides of the garment side by side; again: one.
show_sides | Sides | Shift+o | Show or hide which side the cloth is.
show_certainty | Certainty | Shift+u | Show where the side is uncertain.
""",
    "doubt": """
doubt_next | Next choice | . | Doubts: show what else may be true, and where the cloth lies then.
doubt_decide | Decide | a | Doubts: decide for what is shown.
""",
    "page": """
teach | Teach | h | Go through the method step by step, without decisions; again: leave.
home | Open | Shift+h | Go to the start screen: open another recording, session or camera.
keep_pick | Keep pick | Enter | Keep the pick: else it goes with the next.
copy | Copy pick | c | Copy the numbers of the current pick.
export | Export | x | Export the session: page, report, figures, animation.
settings | Settings | Ctrl+, | Settings, each with its reset; also how far Auto runs.
log | Messages | l | Show all messages.
theme | Theme | t | Switch between light and dark.
help | Commands | ? Ctrl+k | Show all commands with their keys; find one by a few letters.
""",
    "teaching": """
teach_next | Next | PageDown | Teaching: the next stage; → does it too.
teach_back | Back | PageUp | Teaching: the previous stage; ← does it too.
teach_play | Play stage | k | Teaching: play or pause the animation.
""",
}
"""A row an action: its name, title, keys and description; an indented line goes on with the one before."""


ACTIONS = tuple(
    Action(
        name=name,
        title=title,
        keys=tuple(keys.split()),
        description=description,
        group=group,
        mode=_MODES.get(group, ""),
    )
    for group, rows in _TABLE.items()
    for name, title, keys, description in table(rows)
)


# --- which of them a session allows now -----------------------------------------------------------


def command_of(
    name: str,
    state: SessionState,
    view_index: int | None = None,
    reason: str | None = None,
    score: float | None = None,
) -> Command:
    """Return the session command of an action at present.

    ``view_index`` is the view the user saw. A decision without a view refers to the pending one; without
    one it is -1, which the session refuses.
    """
    document = state.document
    pending = -1 if document.pending is None else document.pending.view_index
    view = pending if view_index is None else view_index
    # After a cancelled start there is no start view yet: the step is the start.
    begin = Start if document.start_view is None else Propose
    reject = Reject(view, reason or DEFAULT_REASON)
    commands: dict[str, Command] = {
        "step": begin(),
        "view": begin(view_index),
        "accept": Accept(view, score),
        "skip": Skip(view),
        "reopen": Reopen(-1 if view_index is None else view_index),
        "reject": reject,
        "reject_menu": reject,
        "undo": Undo(),
        "redo": Redo(),
        "cancel": Cancel(),
        "restart": Restart(view_index),
    }
    return commands[name]


def _why_not(action: Action, state: SessionState | None) -> str | None:
    """Return why an action is not allowed now, or None if it is allowed."""
    if state is None:
        return ONLY_A_CAMERA if action.mode == "session" else None
    name, document = action.name, state.document
    if name == "auto":
        return document.finished if state.phase is Phase.FINISHED else None
    if action.mode == "capture":
        return NO_CAMERA
    if name == "reopen" and state.phase is Phase.COMPUTING:
        return why_illegal(state, Reopen(0))
    if name == "reopen":
        return None if document.reopenable_views else "There is no decision to reopen."
    if action.group == "session":
        return why_illegal(state, command_of(name, state))
    if action.group == "proposal" and document.pending is None:
        return "There is no proposal to move; step first."
    return None


def action_table(state: SessionState | None) -> tuple[Action, ...]:
    """Return the table for the page, with the reason if an action is not allowed now.

    Without a state it is the table of a camera's page, which has no decisions.
    """
    history = {} if state is None else {"undo": state.undo, "redo": state.redo}
    last = {name: f"{items[-1].name}." for name, items in history.items() if items}
    return tuple(
        structs.replace(
            action,
            description=f"{action.title}: {last[action.name]}" if action.name in last else action.description,
            why_not=_why_not(action, state),
        )
        for action in ACTIONS
    )
