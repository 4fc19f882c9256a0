"""The settings: written beside each result, read back strictly."""

import json
from typing import Any

import pytest

from flatcloth.core.config import Config, FlatteningConfig, PlanningConfig
from flatcloth.core.errors import ConfigError


def test_a_configuration_survives_json() -> None:
    config = Config(
        flattening=FlatteningConfig(sampling_intervals_px=(24, 12, 6), pixel_size_m=0.0015),
        planning=PlanningConfig(overlap_area_m2=0.05),
    )
    assert Config.from_dict(json.loads(json.dumps(config.to_dict()))) == config
    assert Config.from_dict(Config().to_dict()) == Config()


@pytest.mark.parametrize(
    ("values", "complaint"),
    [
        ([], r"config: .* does not fit; expected an object"),
        ({"planing": {}}, r"config\.planing: no such setting; known are .*planning"),
        ({"planning": 5}, r"config\.planning: 5 does not fit; expected an object"),
        ({"planning": {"overlap_m2": 1}}, r"config\.planning\.overlap_m2: no such setting"),
        ({"planning": {"overlap_area_m2": "0.1"}}, r"config\.planning\.overlap_area_m2: '0\.1' does not fit"),
        ({"flattening": {"sampling_intervals_px": []}}, r"sampling_intervals_px: \[\] does not fit"),
    ],
)
def test_what_does_not_fit_is_named(values: Any, complaint: str) -> None:
    with pytest.raises(ConfigError, match=complaint):
        Config.from_dict(values)
