"""The exports of a session by the names of their files, as the page and ``flatcloth export`` write them."""

from __future__ import annotations

from flatcloth.core.errors import FlatclothError, GarmentError
from flatcloth.export.data import GARMENT
from flatcloth.export.files import zipped
from flatcloth.export.session import OpenedSession

MEDIA = {
    "page.html": "text/html",
    "report.html": "text/html",
    "figures.zip": "application/zip",
    "growth.mp4": "video/mp4",
    "outline.svg": "image/svg+xml",
    "outline.dxf": "image/vnd.dxf",
    "outline.json": "application/json",
    "data.zip": "application/zip",
    "flattened.npz": "application/octet-stream",
    "flattened-other.npz": "application/octet-stream",
    "flattened.png": "image/png",
    "cloud.ply": "application/octet-stream",
    "outcome.json": "application/json",
    "garment.json": "application/json",
}
"""The exports, and the media type of each; those that draw load their modules with the first one."""


def made(session: OpenedSession, name: str) -> bytes:
    """Return the content of an export, or of another data file.

    Raises
    ------
    FlatclothError
        If the session has none of this name, or it cannot be made.
    """
    match name:
        case "page.html":
            from flatcloth.export.page import page

            return page(session).encode()
        case "report.html":
            from flatcloth.export.report import report

            return report(session).encode()
        case "figures.zip":
            from flatcloth.export.figures import figure_files

            return zipped(figure_files(session))
        case "growth.mp4":
            from flatcloth.export.animation import mp4_of

            return mp4_of(session)
        case "outline.svg" | "outline.dxf" | "outline.json":
            from flatcloth.export.garment import upright_rad
            from flatcloth.export.outline import outline_text

            turn_rad, sides = upright_rad(session.data.garment), session.data.joined
            other, about = None if sides is None else sides.other.view, session.history.header.recording.name
            suffix = name.removeprefix("outline")
            return outline_text(session.view, about, suffix, turn_rad, other).encode()
        case "data.zip":
            return zipped((name, make()) for name, make in session.data.files().items())
    if name == GARMENT and isinstance(session.data.garment, str):
        raise GarmentError(session.data.garment)
    make = session.data.files().get(name)
    if make is None:
        raise FlatclothError(f"This session has no {name}.")
    return make()
