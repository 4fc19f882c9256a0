"""The garment's columns, from the garment.json of a result."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from flatcloth.batch.garments import garment_columns


def columns(folder: Path, content: Any) -> dict[str, Any]:
    (folder / "garment.json").write_text(content if isinstance(content, str) else json.dumps(content))
    return garment_columns(folder)


def test_kind_probability_and_dimensions_are_told(tmp_path: Path) -> None:
    sizes = {"chest_width": {"value": 512, "std": 6}}
    document = {
        "format": "flatcloth-garment/1", "kind": "tshirt",
        "probabilities": {"tshirt": 0.97, "none": 0.03}, "dimensions_mm": sizes,
    }  # fmt: skip
    found = columns(tmp_path, document)
    assert found["garment"] == "tshirt"
    assert found["garment_probability"] == 0.97
    assert json.loads(found["dimensions_mm"]) == sizes
    none = columns(tmp_path, {**document, "kind": None, "probabilities": {"none": 0.8, "towel": 0.2}})
    assert (none["garment"], none["garment_probability"]) == ("none of these", 0.8)


def test_without_a_garment_there_are_no_columns(tmp_path: Path) -> None:
    assert garment_columns(tmp_path) == {}
    for content in ("{", "[]", {"format": "other"}, {"format": "flatcloth-garment/1"}):
        assert columns(tmp_path, content) == {}
