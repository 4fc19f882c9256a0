"""The command ``active``: exit codes, what it prints, and that it goes on."""

from __future__ import annotations

from pathlib import Path

import pytest

from flatcloth.cli import main
from flatcloth.core.resources import sample_mesh
from flatcloth.synthesis.meshes import read_mesh


def test_a_goal_that_the_budget_does_not_reach_ends_with_1_and_its_reason(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    command = ["active", "--cell", "--out", str(out), "--sensor", "none", "--goal", "kind", "--budget"]
    assert main([*command, "1"]) == 1
    text = capsys.readouterr().out
    assert "View 0: turn by +0 to 0 degrees." in text
    assert "The budget of 1 views is spent" in text
    assert (out / "flattened.npz").exists()
    assert main([*command, "2"]) == 1
    text = capsys.readouterr().out
    assert "1 views so far" in text
    assert "View 1: turn by" in text
    assert "expected:" in text
    assert "got:" in text
    assert main(["export", str(out), "--data", str(tmp_path / "data")]) == 0


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ([], "active needs --cell"),
        (["--cell", "no.obj"], "no such file"),
        (["--cell", "--goal", "points:nose"], "no known garment has these points"),
        (["--cell", "--budget", "many"], "--budget 'many'"),
        (["--cell", "--within", "0"], "--within 0"),
    ],
)
def test_what_cannot_be_is_told_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], why: str
) -> None:
    assert main(["active", "--out", str(tmp_path / "out"), *options]) == 2
    error = capsys.readouterr().err
    assert why in error
    assert error.count("\n") == 1


def test_the_bundled_mesh_is_a_garment_with_two_sides() -> None:
    mesh = read_mesh(sample_mesh())
    assert mesh.group_names == ("front", "back")
    assert sample_mesh().stat().st_size < 500_000
