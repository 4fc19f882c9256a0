"""The command validate on the bundled recording of a kit; gray cells in place of markers."""

import json

import pytest

from flatcloth.cli import main
from flatcloth.validation import validate
from flatcloth.validation.kit import grid_kit, write_kit


def once(function):
    """Return a function that computes at its first call, and gives that back at all others."""
    made: list[object] = []

    def first(*given, **options):
        if not made:
            made.append(function(*given, **options))
        return made[0]

    return first


def test_the_bundled_kit_is_right_to_a_few_millimetres(tmp_path, capsys, monkeypatch):
    shared, out = tmp_path / "shared.json", tmp_path / "out"
    for name in ("sightings_of", "integrate"):
        monkeypatch.setattr(validate, name, once(getattr(validate, name)))
    half = ",".join(map(str, range(9, 18)))  # a half turn is enough, in half the time
    given = ["validate", "tshirt-kit", "--sides", "one", "--leave-out", half, "--within", "10"]
    assert main([*given, "--out", str(out), "--share", str(shared), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["shape"]["shown_p95_mm"] < 5 < document["shape"]["p95_mm"] < 7
    assert document["shape"]["shown"]["this side"] > 0.5
    assert document["shape"]["within_3_std_share"] > 0.8
    assert document == json.loads((out / "validation.json").read_text())
    page = (out / "validation.html").read_text()
    assert all(line.partition(":")[0] in page for line in document["lines"][1:3])
    assert "tshirt-kit" not in shared.read_text()
    assert json.loads(shared.read_text())["shape"] == document["shape"]
    assert len(document["views"]) > 3
    assert page.count("Error by the kit (mm)") == len(document["pieces"])
    assert main([*given[:-1], "5"]) == 1  # what no marker shows counts


@pytest.mark.parametrize(
    ("recording", "kit", "said"),
    [
        ("shirt-sleeve-clean", None, "kit.json"),
        ("tshirt-kit", grid_kit((0.21, 0.27), 0.03, 1, stickers=12), "--from-photo"),
        ("tshirt-kit", grid_kit((1.2, 0.9), 0.035, 1), "Give the kit that was printed"),
    ],
)
def test_what_is_missing_is_told_in_one_line(recording, kit, said, tmp_path, capsys):
    if kit:
        write_kit(kit, tmp_path / "kit.json")
    given = ["--kit", str(tmp_path / "kit.json")] if kit else []
    assert main(["validate", recording, *given]) == 2
    line = capsys.readouterr().err.splitlines()[-1]
    assert line.startswith("flatcloth: ")
    assert said in line
