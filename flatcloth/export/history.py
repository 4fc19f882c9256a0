"""The history of a session, read from its folder: what was proposed, what was decided, what was picked.

The folder is neither locked nor changed. As on resuming, an incomplete last line is ignored.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from flatcloth.core.errors import FlatclothError, JournalError
from flatcloth.core.plain_files import MOST_JOURNAL_BYTES, read_plain
from flatcloth.core.types import finite
from flatcloth.grasping.grasps import Grip
from flatcloth.grasping.grips import read_grips
from flatcloth.session.document import Accepted, Document
from flatcloth.session.header import Header, read_header
from flatcloth.session.journal import JOURNAL, Line, Pick, Replay, read_journal
from flatcloth.session.machine import Accept, Propose, Proposed, Reject, Reopen, Restart, Skip, TakePart

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
    header: Header
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
class _Origin:
    """The origin of a document: the numbers of its decisions, and whether the operator chose its proposal."""

    document: Document
    standing: tuple[int, ...] = ()
    by_hand: bool = False


class _Verdicts:
    """The verdicts of a journal, gathered line by line, and which of them stand in the present document."""

    def __init__(self, document: Document) -> None:
        self.decisions: list[Decision] = []
        self.present = _Origin(document)
        # Undo and redo restore the same document objects. They are kept, so that no id is used twice.
        self._origins = {id(document): self.present}
        self._chosen_by_hand = False

    def add(self, line: Line, document: Document) -> None:
        """Take a line and the document after it."""
        entry, before = line.entry, self.present
        if isinstance(entry, Propose | Reopen):
            self._chosen_by_hand = entry.view_index is not None
        made = replace(before, document=document)
        match entry:
            case _ if document is before.document:
                return
            case Accept() | Reject() | Skip():
                self.decisions.append(_decision(len(self.decisions) + 1, line.time, entry, before))
                made = replace(made, standing=(*before.standing, len(self.decisions)), by_hand=False)
            case Reopen() | TakePart() if entry.view_index in before.document.reopenable_views:
                kept = (n for n in before.standing if self.decisions[n - 1].view_index != entry.view_index)
                made = replace(made, standing=tuple(kept), by_hand=True)
            case Proposed():
                made = replace(made, by_hand=self._chosen_by_hand)
            case Restart():
                made = _Origin(document)
        self.present = self._origins.setdefault(id(document), made)


def _decision(number: int, time: str, verdict: Accept | Reject | Skip, before: _Origin) -> Decision:
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
    replay = Replay.of(header)
    verdicts, path = _Verdicts(replay.state.document), folder / JOURNAL
    try:
        for line, after in read_journal(path, read_plain(path, MOST_JOURNAL_BYTES), replay):
            verdicts.add(line, after.state.document)
            replay = after
    except FileNotFoundError:
        pass
    except OSError as error:
        raise JournalError(f"{path}: cannot be read ({error.strerror}). Check its permissions.") from error
    standing = verdicts.present.standing
    return SessionHistory(
        folder=folder,
        header=header,
        document=replay.state.document,
        decisions=tuple(replace(d, stands=d.number in standing) for d in verdicts.decisions),
        picks=tuple(replay.picks.values()),
        grips=read_grips(folder),
    )


# --- flags of accepted views ----------------------------------------------------------------------

BY_HAND, BELOW, OVERRIDDEN, LOW = "by_hand", "below_limit", "overridden", "low_score"
FLAGS = {
    BY_HAND: "placed by hand",
    BELOW: "its score is below the limit",
    OVERRIDDEN: "accepted against the check of the score",
    LOW: "its score is low",
}
"""The flags of an accepted view, in words."""
SUSPECT = frozenset({BELOW, OVERRIDDEN})
"""Flags of views that are to be reviewed first."""


def flags_of(added: Accepted, accept_score: float, overridden: frozenset[int]) -> tuple[str, ...]:
    """Return which flags an accepted view has.

    ``accept_score`` is the smallest score that is accepted without an operator; a score in the lower half
    above it is low. ``overridden`` are the views that an operator accepted with a smaller score at that time.
    """
    score = None if added.score is None else finite(added.score)
    flags = [BY_HAND] if added.fixed else []
    if score is not None and score < accept_score:
        flags.append(BELOW)
    if added.view_index in overridden:
        flags.append(OVERRIDDEN)
    elif score is not None and accept_score <= score < (1.0 + accept_score) / 2:
        flags.append(LOW)
    return tuple(flags)


def overridden(history: SessionHistory, accept_score: float) -> frozenset[int]:
    """Return the views whose standing acceptance had a score below the limit."""
    return frozenset(d.view_index for d in history.decisions if is_overridden(d, accept_score))


def is_overridden(decision: Decision, accept_score: float) -> bool:
    """Return whether a decision stands and accepted a place that scored below the limit."""
    return decision.stands and decision.verdict == ACCEPTED and decision.score < accept_score
