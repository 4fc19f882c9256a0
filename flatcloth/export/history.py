"""The history of a session, read from its folder: what was proposed, what was decided, what was picked.

The folder is neither locked nor changed. As on resuming, an incomplete last line is ignored.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from flatcloth.core.config import Config
from flatcloth.core.errors import FlatclothError, JournalError
from flatcloth.core.plain_files import MOST_JOURNAL_BYTES, read_plain
from flatcloth.grasping.grasps import Grip
from flatcloth.grasping.grips import read_grips
from flatcloth.session.header import read_header
from flatcloth.session.journal import JOURNAL, Line, OutOfBoundsLineError, Pick, Replay, read_journal
from flatcloth.session.machine import (
    Accept,
    Document,
    Followed,
    Propose,
    Proposed,
    Redo,
    Reject,
    Reopen,
    Restart,
    Skip,
    Undo,
)

_log = logging.getLogger(__name__)

ACCEPTED, REJECTED, SKIPPED = "accepted", "rejected", "skipped"
VERDICTS = (ACCEPTED, REJECTED, SKIPPED)


@dataclass(frozen=True, kw_only=True)
class Decision:
    """A verdict on a proposal.

    ``number`` counts from 1; ``time`` is that of the journal (UTC); ``before`` is the document in
    which the proposal was pending; ``by_hand`` marks a view that the operator chose; ``stands``
    is False if the decision was undone, or made again later.
    """

    number: int
    time: str
    view_index: int
    verdict: str
    reason: str
    score: float
    moved: bool
    by_hand: bool
    before: Document
    stands: bool = True


@dataclass(frozen=True, kw_only=True)
class SessionHistory:
    """The content of a session folder; ``document`` is its present state."""

    folder: Path
    recording_name: str
    recording_location: str
    recording_fingerprint: str
    recording_options: dict[str, Any]
    n_views: int
    method: str
    config: Config
    created: str
    versions: Mapping[str, str]
    document: Document
    decisions: tuple[Decision, ...]
    picks: tuple[Pick, ...]
    grips: Mapping[int, Grip]

    @property
    def begun(self) -> Document:
        """The present state, which has a shape.

        Raises
        ------
        FlatclothError
            If the session has no start view.
        """
        if self.document.start_view is None:
            raise FlatclothError(
                f"{self.folder}: the session has no start view, so there is nothing to export."
            )
        return self.document


@dataclass(frozen=True)
class _Made:
    """The origin of a document: the numbers of its decisions, and whether the operator chose its proposal."""

    document: Document
    standing: tuple[int, ...] = ()
    by_hand: bool = False


@dataclass
class _Told:
    """The content of a journal in addition to the resulting state."""

    replay: Replay
    decisions: list[Decision] = field(default_factory=list)
    asked_by_hand: bool = False
    # Undo and redo restore the same document objects. They are kept, so that no id is reused.
    made: list[_Made] = field(default_factory=list)

    def present(self) -> _Made:
        """Return the origin of the present document."""
        document = self.replay.state.document
        return next((m for m in reversed(self.made) if m.document is document), _Made(document))

    def take(self, line: Line, before: _Made) -> None:
        """Process a replayed line."""
        entry, document = line.entry, self.replay.state.document
        if isinstance(entry, Propose | Reopen):
            self.asked_by_hand = entry.view_index is not None
        if document is before.document or isinstance(entry, Undo | Redo):
            return
        made = replace(before, document=document)
        match entry:
            case Accept() | Reject() | Skip():
                self.decisions.append(_decision(len(self.decisions) + 1, line.time, entry, before))
                made = replace(made, standing=(*before.standing, len(self.decisions)), by_hand=False)
            case Reopen() | Followed(holds=False):
                made = replace(made, standing=self._without(before.standing, entry.view_index), by_hand=True)
            case Proposed():
                made = replace(made, by_hand=self.asked_by_hand)
            case Restart():
                made = _Made(document)
        self.made.append(made)

    def _without(self, standing: tuple[int, ...], view_index: int) -> tuple[int, ...]:
        return tuple(n for n in standing if self.decisions[n - 1].view_index != view_index)


def _decision(number: int, time: str, verdict: Accept | Reject | Skip, before: _Made) -> Decision:
    pending = before.document.pending
    assert pending is not None  # a verdict is only allowed on a proposal
    word = {Accept: ACCEPTED, Reject: REJECTED, Skip: SKIPPED}[type(verdict)]
    score = verdict.score if isinstance(verdict, Accept) else None
    return Decision(
        number=number,
        time=time,
        view_index=verdict.view_index,
        verdict=word,
        reason=verdict.reason if isinstance(verdict, Reject) else "",
        score=pending.score if score is None else score,
        moved=pending.moved,
        by_hand=before.by_hand,
        before=before.document,
    )


def read_history(folder: Path) -> SessionHistory:
    """Read a session folder without opening it for writing.

    Raises
    ------
    JournalError
        If it is not a session folder or is damaged; the message names the file and the line.
    """
    header = read_header(folder)
    told = _told(folder / JOURNAL, Replay.of(header))
    standing = told.present().standing
    return SessionHistory(
        folder=folder,
        recording_name=header.recording.name,
        recording_location=header.recording.location,
        recording_fingerprint=header.recording.fingerprint,
        recording_options=header.recording.options,
        n_views=header.recording.views,
        method=header.method,
        config=header.effective_config,
        created=header.created,
        versions=header.versions,
        document=told.replay.state.document,
        decisions=tuple(replace(d, stands=d.number in standing) for d in told.decisions),
        picks=tuple(told.replay.picks.values()),
        grips=read_grips(folder),
    )


def _told(path: Path, replay: Replay) -> _Told:
    told = _Told(replay)
    before = told.present()
    try:
        for line in read_journal(path, read_plain(path, MOST_JOURNAL_BYTES), replay):
            told.take(line, before)
            before = told.present()
    except FileNotFoundError:
        pass
    except OutOfBoundsLineError as error:
        _log.warning("%s It is shown as it was before.", error)
    except OSError as error:
        raise JournalError(f"{path}: cannot be read ({error.strerror}). Check its permissions.") from error
    return told
