"""The exports of a session by the names of their files, as the page and ``flatcloth export`` write them."""

from __future__ import annotations

import io
import zipfile

from flatcloth.core.errors import FlatclothError
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
            return _figures(session)
        case "growth.mp4":
            from flatcloth.export.animation import mp4_of

            return mp4_of(session)
        case "outline.svg" | "outline.dxf" | "outline.json":
            from flatcloth.export.garment import upright_rad
            from flatcloth.export.outline import outline_text

            turn_rad, about = upright_rad(session.garment), session.history.header.recording.name
            suffix = name.removeprefix("outline")
            return outline_text(session.view, about, suffix, turn_rad, session.other_view).encode()
        case "data.zip":
            return session.data().zipped()
    data = session.data().file(name)
    if data is None:
        raise FlatclothError(f"This session has no {name}.")
    return data


def _figures(session: OpenedSession) -> bytes:
    from flatcloth.export.figures import all_figures

    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        for figure in all_figures(session):
            # Without a date, so that the same session gives identical bytes.
            archive.writestr(zipfile.ZipInfo(f"{figure.name}.png"), figure.png())
            info = zipfile.ZipInfo(f"{figure.name}.svg")
            archive.writestr(info, figure.svg(), compress_type=zipfile.ZIP_DEFLATED)
    return data.getvalue()
