"""Angles and depth in other units than they are read in: the true factor is named, or nothing is right."""

import json
import math
from pathlib import Path
from typing import Any

import pytest

from flatcloth.checking.units import ANGLES, DEPTHS, allowed
from flatcloth.cli import main

VIEWS = [(f"{n:05d}", n) for n in range(36)]


def _checked(folder: Path, angles: list[float], capsys: pytest.CaptureFixture[str], *more: str) -> Any:
    table = folder / "angles.csv"
    table.write_text("file,angle_deg\n" + "".join(f"{n:05d},{a:.6g}\n" for n, a in enumerate(angles)))
    main(["check", str(folder), "--json", *more])
    return json.loads(capsys.readouterr().out)


@pytest.mark.parametrize(
    ("factor", "known", "name"),
    [
        (math.degrees(1.0), ANGLES, "radians"),
        (360.0, ANGLES, "turns"),
        (0.9, ANGLES, "gradians"),
        (360 / 16384, ANGLES, "14-bit encoder"),
        (1.8, ANGLES, "motor with 200 a turn"),
        (360 / 3200, ANGLES, "motor with 3200 a turn"),
        (1 / 36, ANGLES, "gear of 1:36"),
        (10.0, ANGLES, "numbers of views 10 degrees apart"),
        (0.37, ANGLES, ""),
        (10.0, DEPTHS, "centimetres"),
        (0.25, DEPTHS, "quarters"),
        (0.125, DEPTHS, "1/8000 m"),
    ],
)
def test_a_unit_is_named_where_an_estimate_allows_it(factor, known, name):
    likeliest = allowed(1.003 * factor, 0.003, known)[0]
    assert name in likeliest.name
    assert bool(name) == bool(likeliest.name)
    assert likeliest.factor == pytest.approx(factor, rel=0.01)


@pytest.mark.parametrize(
    ("degrees_a_unit", "name"),
    [(-math.degrees(1.0), "radians"), (0.37, "")],
)
def test_a_unit_of_angles_is_found_with_its_factor(degrees_a_unit, name, take, capsys):
    folder = take(VIEWS, VIEWS)
    angles = [10.0 * n / degrees_a_unit for n in range(36)]
    check = _checked(folder, [float(f"{a:.5g}") for a in angles], capsys)
    found = {finding["name"]: finding for finding in check["findings"]}
    assert found["factor"]["certain"]
    assert name in found["factor"]["text"]
    factor = found["factor"]["mends"][0]["angle_factor"]
    assert factor == pytest.approx(abs(degrees_a_unit), rel=0.01)
    assert ("sense" in found) == (degrees_a_unit < 0)
    again = _checked(folder, angles, capsys, *found["factor"]["mends"][0]["options"].split())
    assert again["findings"] == []
    assert again["pairs"] >= 34


def test_an_encoder_that_passes_zero_is_found(take, capsys):
    check = _checked(take(VIEWS, VIEWS), [(700 + round(n * 1024 / 36)) % 1024 for n in range(36)], capsys)
    assert check["findings"][0]["mends"][0]["angle_factor"] == pytest.approx(360 / 1024)


@pytest.mark.parametrize(
    ("views", "step", "text"),
    [
        ([(f"{n:05d}", 0) for n in range(12)], "0.1", "its views are recorded 0.1 degrees apart, too near"),
        (VIEWS[::6], "60", "cannot be judged"),
    ],
    ids=["too near", "too far apart"],
)
def test_views_that_cannot_be_judged_are_not_called_right(views, step, text, take, capsys):
    assert main(["check", str(take(views, views)), "--step", step]) == 0
    said = capsys.readouterr().out
    assert "cannot be judged" in said
    assert text in said
    assert "Nothing is wrong" not in said
    assert "--angle-factor" not in said


@pytest.mark.parametrize(("units_a_mm", "name"), [(0.1, "centimetres"), (5.0, "1/5000 m")])
def test_a_unit_of_depth_is_among_the_names(units_a_mm, name, take, capsys):
    check = _checked(take(VIEWS, VIEWS, unit=units_a_mm), [10.0 * n for n in range(36)], capsys)
    found = check["findings"][0]
    assert found["name"] == "unit"
    assert name in found["text"]
    factors = [mend["depth_factor"] for mend in found["mends"]]
    assert any(factor == pytest.approx(1 / units_a_mm) for factor in factors)
