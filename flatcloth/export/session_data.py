"""The data files of a session, as ``run``, ``export --data`` and the page write them."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flatcloth.core.types import FlattenedView
from flatcloth.engine.garment.recognition import GarmentService, KnownGarment
from flatcloth.engine.outcome import FILE as OUTCOME
from flatcloth.engine.outcome import outcome_of, outcome_text, sides_entry
from flatcloth.engine.sheet import with_placed_pieces
from flatcloth.export.data import (
    GARMENT,
    Files,
    GraspFrames,
    json_bytes,
    other_files,
    remove_stale,
    shape_files,
    write_files,
)
from flatcloth.export.garment import garment_document, garment_points, other_points, outcome_entry
from flatcloth.garments.deciding import decided_pieces
from flatcloth.methods.answers import Canonical, JoinedSides
from flatcloth.session.journal import Pick
from flatcloth.session.machine import Document

if TYPE_CHECKING:
    from flatcloth.engine.integration import Integration

_FLOATING = re.compile(r"floating-[1-9][0-9]{0,2}\.npz")


@dataclass(frozen=True)
class SessionData:
    """What a session leaves behind as data; each part is computed on first use.

    ``scores`` are those of views whose acceptance keeps none, by view; ``garments`` recognises the garment, a
    new service by default. ``both`` joins the other side to a document's shape, if that belongs to it.
    ``is_growing``: views are still being added, and no garment is recognised for the deviations of the shape.
    """

    integration: Integration
    document: Document
    picks: tuple[Pick, ...]
    frames: GraspFrames
    scores: Mapping[int, float] = field(default_factory=dict)
    garments: GarmentService | None = None
    both: Callable[[Document], JoinedSides | str] | None = None
    is_growing: bool = False

    @cached_property
    def canonical(self) -> Canonical:
        """The shape, with the pieces that have a place on it, and its floating pieces.

        Raises
        ------
        FlatclothError
            If nothing is flattened yet.
        """
        if not self.is_growing:
            _ = self.garment  # recognised first: the deviations of the shape depend on it
        canonical = self.integration.canonical(self.document)
        pieces = decided_pieces(self.document.garment, canonical.view, canonical.floating)
        laid = self.sides.laid if isinstance(self.sides, JoinedSides) else ()
        return with_placed_pieces(canonical, pieces.with_laid(laid))

    @cached_property
    def sides(self) -> JoinedSides | str | None:
        """The other side, joined to the shape, or why there is none; None if it was not asked for."""
        return None if self.both is None else self.both(self.document)

    @cached_property
    def garment(self) -> KnownGarment | str:
        """What is known of the garment, or why nothing is."""
        if self.both is not None:
            self.both(self.document)  # the garment is recognised by both sides once they are joined
        return (self.garments or GarmentService(self.integration)).known(self.document)

    @cached_property
    def outcome(self) -> dict[str, Any]:
        """The content of ``outcome.json``."""
        outcome = outcome_of(self.integration, self.document, self.scores, self.canonical.view)
        outcome["garment"] = outcome_entry(self.garment)
        if self.sides is not None:
            outcome["other_side"] = sides_entry(self.sides)
            if outcome["wrong"] and "firm_share" in outcome["other_side"]:
                outcome["other_side"]["firm_share"] = 0.0
        return outcome

    def files(self) -> Files:
        """Return all files, each with the function that makes it; the report comes last."""
        shape = self.canonical

        def named() -> list[Pick]:
            return [*garment_points(self.garment), *other_points(self.garment, self.sides)]

        def other() -> Sequence[FlattenedView]:
            sides = self.sides
            return (sides.other.view, *sides.other.floating) if isinstance(sides, JoinedSides) else ()

        files = shape_files(shape.view, self.picks, self.frames, shape.floating, named, other)
        if isinstance(self.sides, JoinedSides):
            files |= other_files(self.sides, shape.view)
        garment = self.garment
        if not isinstance(garment, str):
            files[GARMENT] = lambda: json_bytes(garment_document(garment, self.sides))
        files[OUTCOME] = lambda: outcome_text(self.outcome).encode()
        return files

    def write(self, folder: Path, threads: int = 1) -> list[Path]:
        """Write all files to a folder, and remove files of an earlier, larger export.

        ``threads`` are the files that are written at the same time; the bytes do not depend on it.

        Raises
        ------
        FlatclothError
            If the folder cannot be written; the message names it.
        """
        files = self.files()
        written = write_files(files, folder, threads)
        remove_stale(files, folder)
        return written

    def file(self, name: str) -> bytes | None:
        """Return one file; None if the session has none of this name."""
        return make() if (make := self.files().get(name)) else None


def is_floating_file(name: str) -> bool:
    """Return whether a name is that of a floating piece's file."""
    return _FLOATING.fullmatch(name) is not None
