"""Opening what the start screen offers, with the options of ``view``."""

from __future__ import annotations

import argparse
import contextlib
import functools
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flatcloth.commands.active import cell_of, goal_of
from flatcloth.commands.common import source_options_of
from flatcloth.commands.export import hand_eye_of
from flatcloth.commands.output import announce, say
from flatcloth.commands.record import add_capture_options
from flatcloth.core.errors import FlatclothError

if TYPE_CHECKING:
    from flatcloth.active.service import Eye
    from flatcloth.recordings import SourceOptions
    from flatcloth.viewer.places import Chosen
    from flatcloth.viewer.server.app import PageServer
    from flatcloth.viewer.server.workspace import Opened


def opened_recording(options: argparse.Namespace, source: str, session: Path | None = None) -> Opened:
    """Open a recording with its session; ``session`` is the session's folder, by default its own.

    Raises
    ------
    FlatclothError
        If the recording cannot be read, or its session is in use.
    """
    found = _opened(options, source, session, None)
    assert found is not None
    return found


class Opener:
    """Opens the places of the start screen with the options that the program was started with."""

    def __init__(self, options: argparse.Namespace) -> None:
        self._options = options

    def __call__(self, chosen: Chosen, current: Path | None) -> Opened | None:
        """Open a place; None if its session is ``current``, which is open already."""
        if chosen.kind == "camera":
            return opened_camera(self._options, chosen.source)
        if chosen.kind == "cell":
            return opened_cell(argparse.Namespace(**{**vars(self._options), "cell": "", "out": None}))
        options = argparse.Namespace(**vars(self._options))
        if chosen.header is None:
            return _opened(options, chosen.source, None, current, chosen)
        options.method = chosen.header.method
        return _opened(options, chosen.source, chosen.session, current, chosen)


def _opened(
    options: argparse.Namespace,
    source: str,
    session: Path | None,
    current: Path | None,
    chosen: Chosen | None = None,
) -> Opened | None:
    from flatcloth.api.integrating import integration_of
    from flatcloth.engine.warmup import begin_ahead, compile_beside
    from flatcloth.recordings import open_recording
    from flatcloth.session.axis_file import settle_axis
    from flatcloth.session.header import default_session_folder, kept_config
    from flatcloth.session.store import SessionFolder

    header = None if chosen is None else chosen.header
    if session is not None and session == current:
        return None
    config = None if header is None else header.effective_config
    if header is None and session is not None:
        config = kept_config(session, options.method)
    recording = open_recording(source, _source_options(options, chosen))
    integration = integration_of(recording, options.method, config)
    path = session or default_session_folder(integration.recording, options.method, integration.config)
    if path == current:
        return None
    folder = SessionFolder.open(path, integration.recording, integration.config, options.method)
    try:
        settle_axis(folder.folder, integration.views)
        compile_beside()
        begin_ahead(integration, folder.state)
        # The scene's library loads only now, while the first shape is being computed.
        from flatcloth.viewer.server.workspace import Opened

        return Opened(integration, folder, base_from_camera=hand_eye_of(options), close=folder.close)
    except BaseException:
        folder.close()
        raise


def _source_options(options: argparse.Namespace, chosen: Chosen | None) -> SourceOptions:
    """Return what a recording is opened with: what its session was opened with, or the options given now."""
    from flatcloth.recordings import SourceOptions

    if chosen is not None and chosen.options is not None:
        return chosen.options
    if chosen is not None and chosen.header is not None:
        return SourceOptions.from_dict(chosen.header.recording.options, "the session").again()
    return SourceOptions() if chosen is not None and chosen.kind == "example" else source_options_of(options)


def opened_camera(options: argparse.Namespace, serial: str) -> Opened:
    """Open a camera and its capture, for the page.

    Raises
    ------
    FlatclothError
        If there is no such camera, or options of the capture are invalid.
    """
    from flatcloth.cameras import capture, open_camera
    from flatcloth.cameras.feed import CameraFeed
    from flatcloth.engine.integration import Integration
    from flatcloth.engine.live import camera_recording
    from flatcloth.session.axis_file import settle_axis
    from flatcloth.session.header import default_session_folder
    from flatcloth.session.store import SessionFolder
    from flatcloth.viewer.modes.capture import CaptureApplication, CaptureSettings
    from flatcloth.viewer.server.workspace import Opened

    settings = CaptureSettings(
        folder=options.out or Path(f"recording-{datetime.now():%Y%m%d-%H%M%S}"),
        step_deg=10.0 if options.step is None else options.step,
        frames=capture.FRAMES if options.frames is None else options.frames,
        resume=options.resume,
    )
    capture.begin(settings.step_deg, settings.frames)  # invalid values are reported before a camera starts
    with contextlib.ExitStack[None]() as stack:
        feed = CameraFeed(open_camera(serial, options.align or "depth"))
        stack.callback(lambda: feed.stop(timeout_s=5.0))
        integration = Integration(camera_recording(feed), method=options.method)
        integration.notes = feed.camera.notes
        path = options.session or default_session_folder(
            integration.recording, options.method, integration.config
        )
        folder = SessionFolder.open(path, integration.recording, integration.config, options.method)
        stack.callback(folder.close)
        settle_axis(folder.folder, integration.views)
        controller = functools.partial(CaptureApplication, integration, folder, feed=feed, settings=settings)
        return Opened(integration, folder, controller=controller, close=stack.pop_all().close)


def opened_cell(options: argparse.Namespace) -> Opened:
    """Open a simulated cell with an active loop, for the page; its first view is taken.

    Raises
    ------
    FlatclothError
        If the mesh cannot be shown, or the folder cannot be written.
    """
    from flatcloth.active.station import view_of_cell
    from flatcloth.engine.warmup import compile_beside

    goal_of(options)  # an invalid goal is reported before the mesh is read
    compile_beside()
    cell = cell_of(options)
    eye = functools.partial(view_of_cell, cell, masks=not options.no_masks)
    return _opened_loop(options, eye, cell.name, contextlib.ExitStack())


def opened_looking_camera(options: argparse.Namespace, serial: str) -> Opened:
    """Open a camera with an active loop, for the page; its first view is taken when the item hangs still.

    Raises
    ------
    FlatclothError
        If there is no such camera, it sees no item at rest, or the folder cannot be written.
    """
    from flatcloth.active.eye import CameraEye
    from flatcloth.cameras import capture, open_camera
    from flatcloth.cameras.feed import CameraFeed

    goal_of(options)
    frames = capture.FRAMES if options.frames is None else options.frames
    with contextlib.ExitStack[None]() as stack:
        feed = CameraFeed(open_camera(serial, options.align or "depth"))
        stack.callback(lambda: feed.stop(timeout_s=5.0))
        eye = CameraEye(feed, frames)
        feed.start()
        say(f"{feed.camera.name}: the first view is taken when the item hangs still.")
        return _opened_loop(options, eye, feed.camera.name, stack.pop_all())


def _opened_loop(
    options: argparse.Namespace, eye: Eye, name: str, stack: contextlib.ExitStack[None]
) -> Opened:
    from flatcloth.session.header import state_folder
    from flatcloth.viewer.modes.active import ActiveApplication, PageLoop
    from flatcloth.viewer.server.workspace import Opened

    goal, budget = goal_of(options)
    folder = options.out or state_folder() / "sessions" / f"active-{datetime.now():%Y%m%d-%H%M%S}"
    with stack:
        loop = PageLoop(folder, goal, budget, options.method, name=name)
        stack.callback(loop.close)
        if not loop.views:
            loop.take(eye(0.0, 0))
        assert loop.integration is not None
        assert loop.session is not None
        return Opened(
            loop.integration,
            loop.session,
            controller=functools.partial(ActiveApplication, loop, eye=eye, source=name),
            base_from_camera=hand_eye_of(options),
            close=stack.pop_all().close,
        )


def page_options(options: argparse.Namespace) -> dict[str, Any]:
    """Return what the server of the page needs of the options of ``view``."""
    from flatcloth.viewer.places import Places
    from flatcloth.viewer.server.guard import PublicUrl, given_token, is_open

    public = None if options.public_url is None else PublicUrl.parse(options.public_url)

    def ready(server: PageServer) -> None:
        here = "" if public is None else f", served to its proxy at port {server.port}"
        words = f"flatcloth is at {server.url}{here} (Ctrl-C ends it)"
        session = None if server.session is None else str(server.session)
        announce(options, words, server.url, server.token, recording=server.recording, session=session)

    token = False if options.no_token else given_token(options.token_file) or True
    if token is True and options.quiet and is_open(options.host, public):
        raise FlatclothError("--quiet would keep the token to itself; give --token-file or FLATCLOTH_TOKEN.")
    return {
        "ready": ready,
        "host": options.host,
        "port": options.port,
        "token": token,
        "places": Places(options.root, own=not is_open(options.host, public)),
        "public": public,
        "opener": Opener(options),
    }


# --- view --camera: the page of a camera, with guided capture ------------------------------------


def add_camera(parser: argparse.ArgumentParser) -> None:
    """Declare ``--camera`` and the options of a capture."""
    group = parser.add_argument_group("camera")
    group.add_argument(
        "--camera",
        nargs="?",
        const="",
        metavar="SERIAL",
        help="show a RealSense camera instead of a recording; a RealSense file is played in its place",
    )
    group.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="recording folder that a guided capture writes (default: a new one here, named after the time); "
        "with --cell: session folder",
    )
    add_capture_options(group)


def first_of_camera(options: argparse.Namespace) -> Callable[[], Opened] | None:
    """Return what opens the camera or the cell that is shown first; None without ``--camera`` and ``--cell``.

    Raises
    ------
    FlatclothError
        If options contradict each other.
    """
    if options.cell is not None:
        for name in ("source", "camera", "session"):
            if getattr(options, name) not in (None, False):
                raise FlatclothError(f"--cell shows a simulated cell; it does not go with --{name}.")
        return lambda: opened_cell(options)
    if options.camera is None:
        given = [n for n in ("out", "frames", "align", "resume") if getattr(options, n) not in (None, False)]
        if given:
            raise FlatclothError(f"--{given[0]} needs --camera; give both, or neither.")
        return None
    if options.source is not None:
        raise FlatclothError(
            f"{options.source}: --camera shows a camera instead of a recording; give only one of"
            " them. A RealSense file is played in the place of a camera by --camera FILE."
        )
    opener = opened_camera if options.goal is None else opened_looking_camera
    return lambda: opener(options, options.camera)
