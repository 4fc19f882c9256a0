"""Text from files, shortened and cleaned for messages and titles."""

from __future__ import annotations

import json
from typing import Any


def shortened(value: Any, limit: int = 60) -> str:
    """Return a value as one printable line of at most ``limit`` characters."""
    text = value if isinstance(value, str) else json.dumps(value, default=str)
    text = json.dumps(text)[1:-1] if not text.isprintable() else text
    return text if len(text) <= limit else text[: limit - 3] + "..."


def one_line(text: str) -> str:
    """Return a title as one line, without control characters."""
    return "".join(c for c in " ".join(text.split()) if c.isprintable())[:500]
