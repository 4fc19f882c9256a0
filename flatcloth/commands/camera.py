"""``view --camera``: the page of a camera, with guided capture."""

from __future__ import annotations

import argparse
from datetime import datetime
from pathlib import Path

from flatcloth.commands.record import add_capture_options
from flatcloth.core.errors import FlatclothError


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
        help="recording folder that a guided capture writes (default: a new one here, named after the time)",
    )
    add_capture_options(group)


def serve_camera(options: argparse.Namespace) -> bool:
    """Serve the page of a camera until it is stopped; return False without ``--camera``.

    Raises
    ------
    FlatclothError
        If options contradict each other, or the camera cannot be opened.
    """
    if options.camera is None:
        given = [n for n in ("out", "frames", "align", "resume") if getattr(options, n) not in (None, False)]
        if given:
            raise FlatclothError(f"--{given[0]} needs --camera; give both, or neither.")
        return False
    if options.live:
        raise FlatclothError("--live plays a recording, and --camera shows a camera; give only one of them.")
    _serve(options)
    return True


def _serve(options: argparse.Namespace) -> None:
    from flatcloth.cameras import capture, open_camera
    from flatcloth.cameras.feed import CameraFeed
    from flatcloth.engine.integration import Integration
    from flatcloth.engine.playing.camera import CameraRecording
    from flatcloth.session.axis_file import settle_axis
    from flatcloth.session.header import default_session_folder
    from flatcloth.session.store import SessionFolder
    from flatcloth.viewer import serve
    from flatcloth.viewer.modes.capture import CaptureSettings, capture_controller

    settings = CaptureSettings(
        folder=options.out or Path(f"recording-{datetime.now():%Y%m%d-%H%M%S}"),
        step_deg=10.0 if options.step is None else options.step,
        frames=capture.FRAMES if options.frames is None else options.frames,
        resume=options.resume,
    )
    capture.begin(settings.step_deg, settings.frames)  # invalid values are reported before a camera starts
    feed = CameraFeed(open_camera(options.camera, options.align or "depth"))
    try:
        integration = Integration(CameraRecording(feed), method=options.method)
        integration.notes = feed.camera.notes
        path = options.session or default_session_folder(
            integration.recording, options.method, integration.config
        )
        folder = SessionFolder.open(path, integration.recording, integration.config, options.method)
        try:
            settle_axis(folder.folder, integration)
            serve(
                integration,
                folder,
                host=options.host,
                port=options.port,
                token=not options.no_token,
                controller=capture_controller(integration, folder, feed, settings),
            )
        finally:
            folder.close()
    finally:
        feed.stop(timeout_s=5.0)
