"""The settings of the page: their table, their file, and what happens to it when it is damaged."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest

from flatcloth.core.config import Config, PlanningConfig
from flatcloth.core.errors import FlatclothError
from flatcloth.viewer.protocol.settings import FILE, SETTINGS, Settings, SettingsStore, method_numbers
from flatcloth.viewer.protocol.state import Choice, Slider

FIRST = Settings(auto_threshold=0.5)


def test_every_setting_is_in_the_table_with_its_meaning() -> None:
    assert {s.name for s in SETTINGS} == {f.name for f in dataclasses.fields(Settings)}
    assert all(s.description.endswith(".") for s in SETTINGS)
    for setting in SETTINGS:  # only a number has a range, and its default lies in it
        default = getattr(FIRST, setting.name)
        assert isinstance(default, bool | str) != isinstance(setting, Slider)
        assert not isinstance(setting, Choice) or default in dict(setting.options)
        assert not isinstance(setting, Slider) or setting.low <= default <= setting.high


def test_settings_are_kept_with_the_session_and_reset(tmp_path: Path) -> None:
    book = SettingsStore(tmp_path, FIRST)
    assert book.now == FIRST
    assert not (tmp_path / FILE).exists()
    book.change(step_mm=5.0, advance=True)
    again = SettingsStore(tmp_path, FIRST)
    assert again.now == dataclasses.replace(FIRST, step_mm=5.0, advance=True)
    assert again.table().step_mm.value == 5.0
    assert again.table().step_mm.default == 2.0
    again.reset()
    assert SettingsStore(tmp_path, FIRST).now == FIRST
    # All effective ones are in the file, so that it tells how the session was worked on.
    assert set(json.loads((tmp_path / FILE).read_text())) == {"format", *(s.name for s in SETTINGS)}


def test_a_value_out_of_its_range_is_refused_and_changes_nothing(tmp_path: Path) -> None:
    book = SettingsStore(tmp_path, FIRST)
    with pytest.raises(FlatclothError, match=r"Arrow key, mm: between 0\.1 and 50, not 0\."):
        book.change(advance=True, step_mm=0.0)
    assert book.now == FIRST
    assert not (tmp_path / FILE).exists()


@pytest.mark.parametrize(
    "text",
    ["", "[]", "{}", '{"format": "x"}', "[" * 99999]
    + [
        json.dumps({"format": "flatcloth-settings/1", **values})
        for values in ({"step_mm": "2"}, {"step_mm": True}, {"advance": 1}, {"auto_threshold": 2.0})
    ],
)
def test_a_damaged_file_is_named_with_its_remedy(tmp_path: Path, text: str) -> None:
    (tmp_path / FILE).write_text(text)
    with pytest.raises(FlatclothError, match=r"settings\.json: is damaged .* Delete it") as caught:
        SettingsStore(tmp_path, FIRST)
    assert "\n" not in str(caught.value)


def test_a_file_with_fewer_settings_keeps_the_rest_as_at_first(tmp_path: Path) -> None:
    (tmp_path / FILE).write_text('{"format": "flatcloth-settings/1", "step_deg": 3}')
    assert SettingsStore(tmp_path, FIRST).now == dataclasses.replace(FIRST, step_deg=3)


def test_a_folder_that_cannot_be_written_is_told_and_nothing_is_set(tmp_path: Path) -> None:
    book = SettingsStore(tmp_path / "gone", FIRST)
    with pytest.raises(FlatclothError, match="Nothing was set"):
        book.change(step_mm=5.0)
    assert book.now == FIRST


def test_the_numbers_of_the_method_are_told_with_their_meaning_and_default() -> None:
    told = {
        s["section"]: s["values"]
        for s in method_numbers(Config(planning=PlanningConfig(z_angle_limit_deg=40.0)))
    }
    limit = next(v for v in told["planning"] if v["name"] == "z_angle_limit_deg")
    assert (limit["value"], limit["default"]) == (40.0, 50.0)
    assert limit["about"]
    assert {name for name, values in Config().to_dict().items() if values} == set(told)
    assert all(v["about"] for values in told.values() for v in values), "a number without its sentence"
