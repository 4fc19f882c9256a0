"""How far a session is, in a small file of its folder that lists of sessions read: ``summary.json``."""

from __future__ import annotations

import contextlib
from pathlib import Path

import msgspec

from flatcloth.core.errors import JournalError
from flatcloth.session.document import Document
from flatcloth.session.kept import read_kept, write_kept

FILE = "summary.json"


class Summary(msgspec.Struct, frozen=True, kw_only=True):
    """The content of ``summary.json``: views and areas of the shape, its garment, whether it has ended."""

    views: int
    area_cm2: float
    floating_cm2: float
    garment: str = ""
    ended: bool = False


def keep_summary(
    folder: Path | None, document: Document, area_m2: float, floating_m2: float, garment: str
) -> None:
    """Write how far a session is, with the kind of its garment ("": none).

    What cannot be written is left as it was, because only lists show it.
    """
    if folder is None:
        return
    summary = Summary(
        views=len(document.used_views),
        area_cm2=round(1e4 * area_m2, 1),
        floating_cm2=round(1e4 * floating_m2, 1),
        garment=garment,
        ended=document.finished is not None,
    )
    with contextlib.suppress(JournalError):
        write_kept(folder / FILE, summary, 0o600)


def read_summary(folder: Path) -> Summary | None:
    """Return how far a session is; None if it is not known."""
    with contextlib.suppress(JournalError):
        return read_kept(folder / FILE, Summary, "")
    return None
