"""The page of a batch."""

from __future__ import annotations

from pathlib import Path


def write_report(out: Path) -> Path:
    """Write it."""
    return out / "report.html"
