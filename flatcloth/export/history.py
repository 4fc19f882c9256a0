"""The history of a session, read from its folder: what was proposed, what was decided, what was picked.

Nothing is locked or changed. A last line that a crash cut short does not count, as when resuming.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from flatcloth.core.config import Config
from flatcloth.core.errors import ConfigError, IllegalDecisionError, JournalError
from flatcloth.core.plain_files import MOST_JOURNAL_BYTES, read_plain
from flatcloth.grasping.grasps import Grip
from flatcloth.grasping.grips import read_grips
from flatcloth.session.journal import FORMAT, Pick
from flatcloth.session.journal_lines import Entry, PickAdded, PickDeleted, PickRenamed, decode
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
    SessionState,
    Skip,
    Undo,
    apply,
)

ACCEPTED, REJECTED, SKIPPED = "accepted", "rejected", "skipped"
VERDICTS = (ACCEPTED, REJECTED, SKIPPED)


@dataclass(frozen=True, kw_only=True)
class Decision:
    """A verdict on a proposal.

    ``number`` counts from 1; ``time`` is that of the journal (UTC); ``before`` is the document in
    which the proposal was pending; ``by_hand`` marks a view that the operator chose; ``stands``
    is false if it was taken back, or made again later.
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
    """A session as its folder tells it; ``document`` is where it stands now."""

    folder: Path
    recording_name: str
    recording_location: str
    recording_fingerprint: str
    n_views: int
    method: str
    config: Config
    created: str
    versions: Mapping[str, str]
    document: Document
    decisions: tuple[Decision, ...]
    picks: tuple[Pick, ...]
    grips: Mapping[int, Grip]


@dataclass(frozen=True)
class _Made:
    """How a document came about: the numbers of the decisions behind it, and who chose its proposal."""

    document: Document
    standing: tuple[int, ...] = ()
    by_hand: bool = False


@dataclass
class _Replay:
    """The session while its lines are replayed."""

    state: SessionState
    decisions: list[Decision] = field(default_factory=list)
    picks: dict[int, Pick] = field(default_factory=dict)
    asked_by_hand: bool = False
    # Undo and redo bring back the very same documents. They are kept, so that no identity is used twice.
    made: list[_Made] = field(default_factory=list)

    def present(self) -> _Made:
        """Return how the present document came about."""
        document = self.state.document
        return next((m for m in reversed(self.made) if m.document is document), _Made(document))

    def take(self, entry: Entry, time: str) -> None:
        """Replay one line."""
        match entry:
            case PickAdded():
                row, col = entry.source_rc.tolist()
                self.picks[entry.id] = Pick(
                    id=entry.id,
                    name=entry.name,
                    position_held_m=entry.position_held_m,
                    normal_held=entry.normal_held,
                    view_index=entry.view_index,
                    source_rc=(row, col),
                )
            case PickRenamed():
                self.picks[entry.id] = replace(self.picks[entry.id], name=entry.name)
            case PickDeleted():
                del self.picks[entry.id]
            case _:
                self._decide(entry, time)

    def _decide(self, entry: Any, time: str) -> None:
        before = self.present()
        self.state = apply(self.state, entry)
        if isinstance(entry, Propose | Reopen):
            self.asked_by_hand = entry.view_index is not None
        if self.state.document is before.document or isinstance(entry, Undo | Redo):
            return
        made = replace(before, document=self.state.document)
        match entry:
            case Accept() | Reject() | Skip():
                self.decisions.append(_decision(len(self.decisions) + 1, time, entry, before))
                made = replace(made, standing=(*before.standing, len(self.decisions)), by_hand=False)
            case Reopen() | Followed(holds=False):
                made = replace(made, standing=self._without(before.standing, entry.view_index), by_hand=True)
            case Proposed():
                made = replace(made, by_hand=self.asked_by_hand)
            case Restart():
                made = _Made(self.state.document)
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
        If it is no session folder or is damaged; the message names the file and the line.
    """
    header = _header(folder)
    try:
        about = header["recording"]
        n_views = int(about["views"])
        history = SessionHistory(
            folder=folder,
            recording_name=str(about["name"]),
            recording_location=str(about["location"]),
            recording_fingerprint=str(about["fingerprint"]),
            n_views=n_views,
            method=str(header["method"]),
            config=Config.from_dict(header["config"]),
            created=str(header["created"]),
            versions={str(k): str(v) for k, v in header["versions"].items()},
            document=Document(),
            decisions=(),
            picks=(),
            grips=read_grips(folder),
        )
    except (KeyError, TypeError, ValueError, AttributeError, ConfigError) as error:
        raise JournalError(
            f"{folder / 'session.json'}: cannot be understood ({error}). Use the version that wrote it."
        ) from error
    replay = _replay(folder / "journal.jsonl", n_views)
    standing = replay.present().standing
    return replace(
        history,
        document=replay.state.document,
        decisions=tuple(replace(d, stands=d.number in standing) for d in replay.decisions),
        picks=tuple(replay.picks.values()),
    )


def _header(folder: Path) -> dict[str, Any]:
    path = folder / "session.json"
    try:
        header = json.loads(read_plain(path))
    except FileNotFoundError as error:
        raise JournalError(
            f"{folder}: is no session folder, it has no session.json. Name the folder of --out or --session."
        ) from error
    except OSError as error:
        raise JournalError(f"{path}: cannot be read ({error.strerror}). Mend its permissions.") from error
    except (ValueError, RecursionError) as error:
        raise JournalError(f"{path}: is damaged ({error}). Restore it from a copy.") from error
    found = header.get("format") if isinstance(header, dict) else None
    if not isinstance(header, dict) or found != FORMAT:
        raise JournalError(f"{path}: format {found!r} is unknown, not {FORMAT}.")
    return header


def _replay(path: Path, n_views: int) -> _Replay:
    try:
        data = read_plain(path, MOST_JOURNAL_BYTES)
    except FileNotFoundError:
        data = b""
    except OSError as error:
        raise JournalError(f"{path}: cannot be read ({error.strerror}). Mend its permissions.") from error
    replay = _Replay(SessionState(n_views=n_views))
    whole = data[: data.rfind(b"\n") + 1]
    for number, line in enumerate(whole.split(b"\n")[:-1], start=1):
        try:
            replay.take(decode(number, line), str(json.loads(line).get("time", "")))
        except (ValueError, KeyError, IllegalDecisionError) as error:
            raise JournalError(
                f"{path}: line {number} is damaged ({error}). Restore it from a copy."
            ) from error
    return replay
