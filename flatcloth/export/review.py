"""Flags of accepted views that a reviewer should check first."""

from __future__ import annotations

from dataclasses import dataclass

from flatcloth.core.types import finite
from flatcloth.export.history import ACCEPTED, Decision, SessionHistory
from flatcloth.session.machine import Accepted

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


@dataclass(frozen=True)
class Flags:
    """Which flags an accepted view has.

    Parameters
    ----------
    accept_score : float
        Smallest score that is accepted without an operator; a score in the lower half above it is low.
    overridden : frozenset of int
        Views that an operator accepted although the score at that time was smaller.
    """

    accept_score: float
    overridden: frozenset[int] = frozenset()

    def of(self, added: Accepted) -> tuple[str, ...]:
        """Return the flags of an accepted view."""
        score = None if added.score is None else finite(added.score)
        flags = [BY_HAND] if added.fixed else []
        if score is not None and score < self.accept_score:
            flags.append(BELOW)
        if added.view_index in self.overridden:
            flags.append(OVERRIDDEN)
        elif score is not None and self.accept_score <= score < (1.0 + self.accept_score) / 2:
            flags.append(LOW)
        return tuple(flags)


def overridden(history: SessionHistory, accept_score: float) -> frozenset[int]:
    """Return the views whose standing acceptance had a score below the limit."""
    return frozenset(d.view_index for d in history.decisions if is_overridden(d, accept_score))


def is_overridden(decision: Decision, accept_score: float) -> bool:
    """Return whether a decision stands and accepted a place that scored below the limit."""
    return decision.stands and decision.verdict == ACCEPTED and decision.score < accept_score
