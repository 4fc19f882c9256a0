"""Where the piece that is placed by hand may belong, kept next to the journal as ``ghosts.json``.

The garment and the seams say so while the piece floats; as the proposal it is no piece of theirs any more.
"""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Literal

import msgspec

from flatcloth.core.errors import JournalError
from flatcloth.core.types import Rigid2
from flatcloth.session.kept import Metres, read_kept, write_kept

FILE = "ghosts.json"


class Ghost(msgspec.Struct, frozen=True, kw_only=True):
    """A place (plane of the shape from the component's own), what gives it, and its deviation."""

    source: Literal["garment", "seams"]
    theta_rad: float
    u_m: Metres
    v_m: Metres
    std_m: Metres

    @property
    def motion(self) -> Rigid2:
        """The motion to the place."""
        return Rigid2(self.theta_rad, self.u_m, self.v_m)


class Ghosts(msgspec.Struct, frozen=True, kw_only=True):
    """The places of a component of a view."""

    view_index: int = -1
    component: int = -1
    places: tuple[Ghost, ...] = ()


def keep_ghosts(folder: Path | None, ghosts: Ghosts) -> None:
    """Save the ghosts; without them, after a restart, the piece is placed as before."""
    if folder is not None:
        with contextlib.suppress(JournalError):
            write_kept(folder / FILE, ghosts, 0o600)


def read_ghosts(folder: Path | None) -> Ghosts:
    """Return the ghosts that were saved; none if there are none, or if the file is damaged."""
    with contextlib.suppress(JournalError):
        return (folder and read_kept(folder / FILE, Ghosts, "")) or Ghosts()
    return Ghosts()
