"""The garment's columns of a result."""

from __future__ import annotations

import json

from flatcloth.batch.jobs import garment_columns


def test_kind_probability_and_dimensions_are_told() -> None:
    sizes = {"chest_width": {"value": 512, "std": 6}}
    document = {
        "kind": "tshirt", "probabilities": {"tshirt": 0.97, "none": 0.03}, "dimensions_mm": sizes,
    }  # fmt: skip
    found = garment_columns(document)
    assert found["garment"] == "tshirt"
    assert found["garment_probability"] == 0.97
    assert json.loads(found["dimensions_mm"]) == sizes
    none = garment_columns({**document, "kind": None, "probabilities": {"none": 0.8, "towel": 0.2}})
    assert (none["garment"], none["garment_probability"]) == ("none of these", 0.8)
