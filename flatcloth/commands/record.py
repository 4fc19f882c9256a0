"""The command ``record``: guided capture with a camera, on the command line."""

from __future__ import annotations

import select
import sys
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from flatcloth.commands.options import Capture as CaptureOptions
from flatcloth.commands.options import Output
from flatcloth.commands.output import ProgressBar, report, say
from flatcloth.core.errors import FlatclothError, IllegalDecisionError
from flatcloth.recordings.options import option

if TYPE_CHECKING:
    from flatcloth.cameras import Camera
    from flatcloth.cameras.capture import Capture
    from flatcloth.cameras.guided_capture import GuidedCapture

SUMMARY = "capture a hanging item view by view with a RealSense camera"
EXAMPLES = """examples:
  flatcloth record --out my-recording --step 10
  flatcloth record --out my-recording --camera 728612070259 --resume
  flatcloth record --out my-recording --camera turned.db3 --yes    a file in place of a camera"""

_LOOK_EVERY_S = 1.0
"""Interval of the progress lines. Chosen."""


@dataclass(kw_only=True)
class Options(Output, CaptureOptions):
    """The options of the command."""

    out: Path = option("recording folder to write", "DIR", MISSING)
    step: float | None = option(
        "rotation between views (default: 10); negative if the side that faces the camera moves to the left",
        "DEG",
    )
    camera: str = option(
        "serial number of the camera if there are several; or a RealSense file to play in its place",
        "SERIAL",
        "",
    )
    name: str | None = option("title of the recording (default: the folder's name)", "TEXT")
    yes: bool = option("keep every view without asking")


def run(options: Options) -> None:
    """Run the capture until the turn is complete or the operator ends it."""
    from flatcloth.cameras import capture, open_camera
    from flatcloth.cameras.guided_capture import GuidedCapture, writer_for

    if not options.yes and not sys.stdin.isatty():
        raise FlatclothError("record needs a terminal for its questions; give --yes to keep every view.")
    if not options.yes and (options.quiet or options.json):
        raise FlatclothError("--quiet and --json show no questions; give --yes to keep every view.")
    with closing(open_camera(options.camera, options.align or "depth")) as camera:
        guided = GuidedCapture(
            camera,
            lambda: writer_for(camera, str(options.out), options.name or options.out.name, options.resume),
            10.0 if options.step is None else options.step,
            capture.FRAMES if options.frames is None else options.frames,
        )
        try:
            lead(camera, guided, None if options.yes else typed)
        except KeyboardInterrupt:
            pass  # what was kept is a recording
        finally:
            guided.close()
            count = len(guided.writer)
            views = "1 view is" if count == 1 else f"{count} views are"
            line = f"{views} in {options.out}. Open it with: flatcloth view {options.out}"
            document = {"folder": str(options.out), "angles_deg": list(guided.writer.angles_deg)}
            report(options, document, [line])


def lead(camera: Camera, guided: GuidedCapture, answer: Callable[[], str | None] | None) -> None:
    """Read the camera until the capture is done.

    ``answer`` returns the operator's input since the last frame, None if there is none; without it every
    view is kept.
    """
    from flatcloth.cameras import CameraEndedError
    from flatcloth.cameras.capture import Phase
    from flatcloth.cameras.checks import check_frame

    say(f"{camera.name}: {camera.intrinsics.width}x{camera.intrinsics.height} px, {camera.fps:g} frames/s")
    for note in camera.notes:
        say(f"Note: {note}")
    reported: tuple[Phase, int] | None = None
    warnings: Sequence[str] = ()
    next_look_s = 0.0
    with ProgressBar(camera.name) as bar:
        while guided.state.phase is not Phase.DONE:
            try:
                frame = camera.read()
            except CameraEndedError as end:
                say(str(end))
                return
            state = guided.see(frame)
            place = (state.phase, len(state.kept_deg))
            if place != reported:
                _print_step(guided, reported, asking=answer is not None)
                reported = place
                bar.clear()
            if state.phase is not Phase.REVIEW:  # the operator types there
                bar.show(min(1.0, abs(state.target_deg) / 360), _stillness(state))
            if frame.time_s >= next_look_s and not state.taken:
                next_look_s, before = frame.time_s + _LOOK_EVERY_S, warnings
                warnings = check_frame(frame.rgbd(camera)).warnings
                if _kinds(warnings) != _kinds(before):
                    for text in warnings:
                        say(f"Warning: {text}")
            if answer is not None:
                _obey(guided, answer())
            elif state.phase is Phase.REVIEW:
                guided.keep()


def _obey(guided: GuidedCapture, text: str | None) -> None:
    from flatcloth.cameras import capture
    from flatcloth.cameras.capture import Phase

    if text is None:
        return
    word = text.strip().lower()
    try:
        if word == "q":
            guided.do(capture.finish)
        elif word == "r":
            guided.do(capture.repeat)
        elif word == "" and guided.state.phase is Phase.REVIEW:
            guided.keep()
        elif word == "" and guided.state.phase is Phase.TURN:
            guided.do(capture.turned)
        elif word != "":
            guided.do(lambda state: capture.aim(state, float(word)))
    except ValueError:
        say(f"{text.strip()[:40]!r}? Enter, r, q, or the angle in degrees.")
    except IllegalDecisionError as error:
        say(str(error))


def _print_step(guided: GuidedCapture, before: tuple[object, int] | None, *, asking: bool) -> None:
    """Print the next step; what changes continuously is beside the bar."""
    from flatcloth.cameras.capture import Phase

    state, number = guided.state, len(guided.state.kept_deg)
    if before is not None and number > before[1]:
        say(f"View {number - 1} is kept.")
    if state.phase is Phase.TURN:
        hint = " (Enter: done; q: end)" if asking else ""
        say(f"View {number}: turn the item by {state.turn_by_deg:+g} degrees, to {state.target_deg:g}.{hint}")
    elif state.phase is Phase.SETTLE and number == 0 and before is None:
        say("View 0: let the item hang still.")
    elif state.phase is Phase.REVIEW and guided.taken is not None:
        view = guided.taken
        hint = " (Enter: keep; r: repeat; a number: correct its angle; q: end)" if asking else ""
        say(
            f"View {number} at {state.target_deg:g} degrees: {view.frames} frames, "
            f"noise {view.noise_mm:.1f} mm.{hint}"
        )
        for warning in view.warnings:
            say(f"  {warning}")


def _stillness(state: Capture) -> str:
    from flatcloth.cameras.capture import Phase

    speed = "-" if state.speed_px_s is None else f"{state.speed_px_s:.0f}"
    words = {
        Phase.TAKE: f"taking frame {state.taken} of {state.frames}",
        Phase.SETTLE: f"still for {state.still_s:.1f} s" if state.still_s else f"moving, {speed} px/s",
    }
    return words.get(state.phase, f"motion {speed} px/s")


def _kinds(warnings: Sequence[str]) -> list[str]:
    return [text.split(":")[0] for text in warnings]


def typed() -> str | None:
    """Return the line typed on the terminal, None if there is none yet; ``q`` at its end."""
    if not select.select([sys.stdin], [], [], 0.0)[0]:
        return None
    return sys.stdin.readline() or "q"
