"""The page of a batch, served."""

from __future__ import annotations

from pathlib import Path


def serve_review(out: Path, port: int) -> None:
    """Serve it."""
