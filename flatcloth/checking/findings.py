"""What a check finds: mistakes of a recording, how sure they are, and what mends them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from flatcloth.core.errors import RecordingError
from flatcloth.recordings.options import Mends

CERTAIN = 0.99
"""A finding of at least this probability stops an unattended run. Chosen: one in a hundred of those is wrong
if the probabilities are right."""
MOST_SURE = 0.999
"""Highest probability that a finding states; it stands for all higher ones. Chosen."""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """A mistake of a recording.

    ``name`` is a word that stays, such as ``sense``; ``text`` says in one line what is wrong; ``probability``
    how sure that is. ``mends`` are the settings that remove it, the likeliest first; empty if none does.
    ``stops`` is whether results would be wrong, not only worse. ``views`` are two views that show it, or one
    twice if the outline in depth, drawn on its color, does.
    """

    name: str
    text: str
    probability: float
    mends: tuple[Mends, ...] = ()
    stops: bool = True
    views: tuple[int, int] | None = None

    @property
    def is_certain(self) -> bool:
        """Whether an unattended run must not go on with it."""
        return self.stops and self.probability >= CERTAIN

    def to_dict(self) -> dict[str, Any]:
        """Return the finding for JSON."""
        return {
            "name": self.name,
            "text": self.text,
            "probability": round(self.probability, 4),
            "certain": self.is_certain,
            "mends": [{"options": mends.words(), **mends.to_dict()} for mends in self.mends],
            "views": None if self.views is None else list(self.views),
        }

    @property
    def line(self) -> str:
        """The finding in one line: what, how sure, what mends it."""
        sure = f"{min(self.probability, MOST_SURE):.1%}".replace(".0%", "%")
        mend = " or ".join(mend.words() for mend in self.mends)
        return f"{self.text} ({sure} sure). {f'Mended by {mend}.' if mend else 'Record it again.'}"


@dataclass(frozen=True, kw_only=True)
class Check:
    """The result of a check: the findings, those that stop a run first, and what was compared.

    ``pairs`` of neighbouring views agree with their angles; if none does, ``unjudged`` says why.
    """

    findings: tuple[Finding, ...] = ()
    views: int = 0
    pairs: int = 0
    unjudged: str = ""

    @property
    def certain(self) -> tuple[Finding, ...]:
        """The findings with which an unattended run must not go on."""
        return tuple(finding for finding in self.findings if finding.is_certain)

    @property
    def lines(self) -> list[str]:
        """The check in lines of text."""
        lines = [finding.line for finding in self.findings]
        if self.unjudged and not any(finding.stops for finding in self.findings):
            return [*lines, f"Its turning cannot be judged: {self.unjudged}."]
        right = f"Nothing is wrong with {self.views} views; {self.pairs} pairs agree with the angles."
        return lines or [right]

    def refuse(self, location: str) -> None:
        """Refuse a recording with which results would certainly be wrong.

        Raises
        ------
        RecordingError
            With the finding, and the option that mends it.
        """
        if self.certain:
            line = self.certain[0].line.rstrip(".")
            raise RecordingError(f"{location}: {line}, or go on with --as-recorded.")

    def to_dict(self) -> dict[str, Any]:
        """Return the check for JSON."""
        return {
            "views": self.views,
            "pairs": self.pairs,
            "unjudged": self.unjudged,
            "findings": [finding.to_dict() for finding in self.findings],
        }
