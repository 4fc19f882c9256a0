"""The table's columns of the garment: kind and dimensions, where a result has them (``garment.json``)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from flatcloth.core.plain_files import read_plain

FILE = "garment.json"
FORMAT = "flatcloth-garment/1"


def garment_columns(folder: Path) -> dict[str, Any]:
    """Return the garment's columns of a result's folder; none if no garment was recognised."""
    try:
        found = json.loads(read_plain(folder / FILE))
        if found["format"] != FORMAT:
            return {}
        kind, chances = found["kind"], found["probabilities"]
        probability = max(chances.values()) if kind is None else chances.get(kind)
        return {
            "garment": "none of these" if kind is None else str(kind),
            "garment_probability": None if probability is None else float(probability),
            "dimensions_mm": json.dumps(found["dimensions_mm"]),
        }
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return {}
