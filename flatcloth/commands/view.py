"""The command ``view``: the operator page, and opening what its start screen offers."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flatcloth.commands.options import (
    PORT,
    SOURCES,
    Address,
    Aim,
    Capture,
    HandEye,
    Method,
    Output,
    SimulatedCell,
    SourceInformation,
    excluded,
)
from flatcloth.commands.output import announce, say
from flatcloth.core.errors import FlatclothError
from flatcloth.recordings.options import option

if TYPE_CHECKING:
    from flatcloth.active.service import Eye
    from flatcloth.cameras.feed import CameraFeed
    from flatcloth.viewer.places import Chosen
    from flatcloth.viewer.server.app import PageServer
    from flatcloth.viewer.server.workspace import Opened

SUMMARY = "open the operator page (the default command)"
EXAMPLES = """examples:
  flatcloth                                    the page, where a recording is chosen
  flatcloth view --root ~/recordings           the same, also of the folders below this one
  flatcloth view trousers-waist-d435
  flatcloth view my-recording --port 9000 --session my-session
  flatcloth view --camera --out my-recording --step 10    a RealSense camera, and guided capture"""


@dataclass(kw_only=True)
class Options(Output, SimulatedCell, Aim, Capture, Address, HandEye, Method, SourceInformation):
    """The options of the command."""

    source: str | None = option(
        f"{SOURCES} (default: the start screen, where one is chosen)", "SOURCE", positional=True
    )
    port: int = option("port of the page, 0 for any free one", default=8080, read=PORT)
    token_file: Path | None = option(
        "file with the token of the page, made with a new one if it does not exist (default: the variable "
        "FLATCLOTH_TOKEN, or the user's own token)",
        "FILE",
        either="token",
    )
    no_token: bool = option("let every user and program of this computer use the page", either="token")
    root: Path | None = option(
        "let the start screen open recordings and sessions below this folder (default: none)", "DIR"
    )
    session: Path | None = option(
        "session folder, resumed if it exists (default: one per recording in the user's state folder)", "DIR"
    )
    camera: str | None = option(
        "show a RealSense camera instead of a recording; a RealSense file is played in its place",
        "SERIAL",
        const="",
        group="camera",
    )
    out: Path | None = option(
        "recording folder that a guided capture writes (default: a new one here, named after the time); with "
        "--cell: session folder",
        "DIR",
        group="camera",
    )


def opened_place(options: Options, chosen: Chosen, current: Path | None = None) -> Opened | None:
    """Open a place: a recording with its session, by default its own, or a camera or cell.

    None if the session is ``current``, which is open already.

    Raises
    ------
    FlatclothError
        If the recording cannot be read, its session is in use, or the camera or cell cannot be opened.
    """
    if chosen.kind == "camera":
        return opened_camera(options, chosen.source)
    if chosen.kind == "cell":
        return opened_loop(dataclasses.replace(options, cell="", out=None))
    from flatcloth.api.integrating import integration_of
    from flatcloth.engine.warmup import begin_ahead, compile_beside
    from flatcloth.recordings import SourceOptions, open_recording
    from flatcloth.session.header import default_session_folder, kept_config
    from flatcloth.session.store import SessionFolder

    header, session = chosen.header, chosen.session
    if session is not None and session == current:
        return None
    given = chosen.options  # what the session was opened with, or the options given now
    if given is None and header is not None:
        given = SourceOptions.from_dict(header.recording.options, "the session")
    if given is None:
        given = SourceOptions() if chosen.kind == "example" else options.source_options()
    method, config = options.method, None
    if header is not None:
        method, config = header.method, header.effective_config
    elif session is not None:
        config = kept_config(session, method)
    integration = integration_of(open_recording(chosen.source, given), method, config)
    path = session or default_session_folder(integration.recording, method, integration.config)
    if path == current:
        return None
    folder = SessionFolder.open(path, integration.recording, integration.config, method)
    try:
        compile_beside()
        begin_ahead(integration, folder.state)
        # The scene's library loads only now, while the first shape is being computed.
        from flatcloth.viewer.server.workspace import Opened

        return Opened(integration, folder, base_from_camera=options.base_from_camera(), close=folder.close)
    except BaseException:
        folder.close()
        raise


def opened_camera(options: Options, serial: str) -> Opened:
    """Open a camera and its capture, for the page.

    Raises
    ------
    FlatclothError
        If there is no such camera, or options of the capture are invalid.
    """
    from flatcloth.cameras import capture
    from flatcloth.engine.integration import Integration
    from flatcloth.engine.live import camera_recording
    from flatcloth.session.header import default_session_folder
    from flatcloth.session.store import SessionFolder
    from flatcloth.viewer.modes.capture import CaptureApplication, CaptureSettings
    from flatcloth.viewer.server.workspace import Opened

    settings = CaptureSettings(
        folder=options.out or Path(f"recording-{datetime.now():%Y%m%d-%H%M%S}"),
        step_deg=10.0 if (step_deg := options.source_options().step_deg) is None else step_deg,
        frames=_frames(options),
        resume=options.resume,
    )
    capture.begin(settings.step_deg, settings.frames)  # invalid values are reported before a camera starts
    with contextlib.ExitStack[None]() as stack:
        feed = _feed(options, serial, stack)
        integration = Integration(camera_recording(feed), method=options.method)
        integration.notes = feed.camera.notes
        path = options.session or default_session_folder(
            integration.recording, options.method, integration.config
        )
        folder = SessionFolder.open(path, integration.recording, integration.config, options.method)
        stack.callback(folder.close)
        controller = functools.partial(CaptureApplication, integration, folder, feed=feed, settings=settings)
        return Opened(integration, folder, controller=controller, close=stack.pop_all().close)


def opened_loop(options: Options, serial: str | None = None) -> Opened:
    """Open an active loop for the page, with a camera or a simulated cell; its first view is taken.

    That of a camera is taken when the item hangs still.
    """
    from flatcloth.active.eye import CameraEye, view_of_cell
    from flatcloth.engine.warmup import compile_beside
    from flatcloth.session.header import state_folder
    from flatcloth.viewer.modes.active import ActiveApplication, PageLoop
    from flatcloth.viewer.server.workspace import Opened

    goal, budget = options.aim()  # an invalid goal is reported before anything is opened
    folder = options.out or state_folder() / "sessions" / f"active-{datetime.now():%Y%m%d-%H%M%S}"
    eye: Eye
    with contextlib.ExitStack[None]() as stack:
        if serial is None:
            compile_beside()
            cell = options.simulated(options.out)
            eye, name = functools.partial(view_of_cell, cell, masks=not options.no_masks), cell.name
        else:
            feed = _feed(options, serial, stack)
            eye, name = CameraEye(feed, _frames(options)), feed.camera.name
            feed.start()
            say(f"{name}: the first view is taken when the item hangs still.")
        loop = PageLoop(folder, goal, budget, options.method, name=name)
        stack.callback(loop.close)
        if not loop.views:
            loop.take(eye(0.0, 0))
        assert loop.integration is not None
        assert loop.session is not None
        return Opened(
            loop.integration,
            loop.session,
            controller=functools.partial(ActiveApplication, loop, eye=eye),
            base_from_camera=options.base_from_camera(),
            close=stack.pop_all().close,
        )


def _feed(options: Options, serial: str, stack: contextlib.ExitStack[None]) -> CameraFeed:
    from flatcloth.cameras import open_camera
    from flatcloth.cameras.feed import CameraFeed

    feed = CameraFeed(open_camera(serial, options.align or "depth"))
    stack.callback(lambda: feed.stop(timeout_s=5.0))
    return feed


def _frames(options: Options) -> int:
    from flatcloth.cameras import capture

    return capture.FRAMES if options.frames is None else options.frames


def page_options(options: Options) -> dict[str, Any]:
    """Return what the server of the page needs of the options of ``view``."""
    from flatcloth.viewer.places import Places
    from flatcloth.viewer.server.guard import Endpoint, PublicUrl, given_token

    endpoint = Endpoint(options.host, options.port, PublicUrl.parse(options.public_url))

    def ready(server: PageServer) -> None:
        here = "" if endpoint.public is None else f", served to its proxy at port {server.port}"
        words = f"flatcloth is at {server.url}{here} (Ctrl-C ends it)"
        session = None if server.session is None else str(server.session)
        announce(options, words, server.url, server.token, recording=server.recording, session=session)

    token = False if options.no_token else given_token(options.token_file) or True
    if token is True and options.quiet and endpoint.is_open:
        raise FlatclothError("--quiet would keep the token to itself; give --token-file or FLATCLOTH_TOKEN.")
    return {
        "ready": ready,
        "endpoint": endpoint,
        "token": token,
        "places": Places(options.root, own=not endpoint.is_open),
        "opener": functools.partial(opened_place, options),
    }


def first_of(options: Options) -> Callable[[], Opened] | None:
    """Return what opens the recording, camera or cell that is shown first; None for the start screen.

    Raises
    ------
    FlatclothError
        If options contradict each other.
    """
    from flatcloth.viewer.places import Chosen

    if options.cell is not None:
        for name in excluded(options, ("source", "camera", "session")):
            raise FlatclothError(f"--cell shows a simulated cell; it does not go with --{name}.")
        return functools.partial(opened_loop, options)
    if options.camera is not None:
        if options.source is not None:
            raise FlatclothError(
                f"{options.source}: --camera shows a camera instead of a recording; give only one of"
                " them. A RealSense file is played in the place of a camera by --camera FILE."
            )
        opener = opened_camera if options.goal is None else opened_loop
        return functools.partial(opener, options, options.camera)
    for name in excluded(options, ("out", "frames", "align", "resume")):
        raise FlatclothError(f"--{name} needs --camera; give both, or neither.")
    if options.source is None:
        if options.session:
            raise FlatclothError("--session needs SOURCE; name a recording, or open one on the page.")
        return None
    chosen = Chosen("folder", options.source, options.session)

    def opened() -> Opened:
        found = opened_place(options, chosen)
        assert found is not None, "nothing else is open yet"
        return found

    return opened


def run(options: Options) -> None:
    """Serve the page until it is stopped."""
    first, page = first_of(options), page_options(options)
    if first is not None and options.source is not None:
        first = [first()].pop  # its shape is computed while the server is loaded; nobody else keeps it
    from flatcloth.viewer.server.app import serve

    serve(first=first, **page)
