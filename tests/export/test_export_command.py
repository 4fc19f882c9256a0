"""The command ``export``, as its user calls it."""

import json
import os
import shutil
import stat
import sys
from pathlib import Path

import numpy as np
import pytest
from exported_sessions import write_cylinder, write_session

from flatcloth.cli import main
from flatcloth.core.errors import FlatclothError


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("command")
    return write_session(folder / "session", write_cylinder(folder / "recording"))


@pytest.fixture
def session(written: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(written, tmp_path / "session"))


@pytest.fixture
def hand_eye(tmp_path: Path) -> Path:
    path = tmp_path / "camera.json"
    matrix = [[0, 0, 1, 0.5], [-1, 0, 0, 0], [0, -1, 0, 0.8], [0, 0, 0, 1]]
    path.write_text(json.dumps({"format": "flatcloth-hand-eye/1", "base_from_camera": matrix}))
    return path


def test_everything_is_written_and_the_session_stays_as_it_was(
    session: Path, tmp_path: Path, hand_eye: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = {p.name: p.read_bytes() for p in session.iterdir()}
    out = tmp_path / "out"
    options = {
        "--html": out / "page.html",
        "--report": out / "report.html",
        "--grasps": out / "grasps.json",
        "--hand-eye": hand_eye,
        "--rotation": "-40",
    }
    assert main(["export", str(session), *(str(x) for pair in options.items() for x in pair)]) == 0
    said = capsys.readouterr()
    assert said.err == ""
    assert said.out.count("Written: ") == 3
    assert {p.name for p in out.iterdir()} == {"page.html", "report.html", "grasps.json"}
    assert {p.name: p.read_bytes() for p in session.iterdir()} == before
    grasps = json.loads((out / "grasps.json").read_text())
    assert grasps["rotation_deg"] == -40.0
    pose = grasps["grasps"][0]["poses"]
    base_from_camera = np.array(grasps["base_from_camera"])
    np.testing.assert_allclose(pose["base"]["matrix"], base_from_camera @ pose["camera"]["matrix"], atol=2e-6)


def test_run_takes_a_hand_eye_transform(
    session: Path, written: Path, hand_eye: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording = written.parent / "recording"
    options = ["--out", str(session), "--method", "paper", "--hand-eye", str(hand_eye)]
    assert main(["run", str(recording), *options]) == 0
    grasps = json.loads((session / "grasps.json").read_text())
    assert {"held", "camera", "base"} == set(grasps["grasps"][0]["poses"])
    assert grasps["grasps"][0]["grip"]["opening_m"] == 0.06  # as the operator chose
    hand_eye.write_text("{}")
    assert main(["run", str(recording), *options]) == 2
    assert "flatcloth-hand-eye/1" in capsys.readouterr().err


PAGE = ["--html", "{tmp}/page.html"]


@pytest.mark.parametrize(
    ("options", "cause"),
    [
        ([], "give one or more of --data, --html, --report, --figures, --animation, --grasps, --outline"),
        ([*PAGE, "--outline", "{tmp}/shape.pdf"], "shape.pdf: the outline is written as .svg, .dxf, .json."),
        ([*PAGE, "--data", "{tmp}/file"], "Choose another folder"),
        ([*PAGE, "--outline", "{tmp}/file/shape.svg"], "cannot be written"),
        (["--html", "{tmp}/file/page.html"], "cannot be written"),
        ([*PAGE, "--report", "{tmp}/file/report.html"], "cannot be written"),
        ([*PAGE, "--figures", "{tmp}/file"], "cannot be written"),
        ([*PAGE, "--animation", "{tmp}/growth.gif"], "growth.gif: the animation is written as .mp4. Choose"),
        ([*PAGE, "--grasps", "{tmp}/g.json", "--hand-eye", "{tmp}/none.json"], "none.json: cannot be read"),
        ([*PAGE, "--grasps", "{tmp}/pipe"], "a pipe or device, not a file"),
        ([*PAGE, "--recording", "{tmp}/none"], "no such file or folder"),
        ([*PAGE, "--report", "{tmp}/r.html"], "matplotlib is not installed; pip install 'flatcloth[export]'"),
        ([*PAGE, "--animation", "{tmp}/growth.mp4"], "matplotlib is not installed"),
        (
            [*PAGE, "--mcap", "{tmp}/g.mcap"],
            "foxglove-sdk is not installed; pip install 'flatcloth[foxglove]'",
        ),
    ],
)
def test_what_cannot_be_made_is_told_in_one_line_before_anything_is_made(
    session: Path,
    tmp_path: Path,
    options: list[str],
    cause: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    (tmp_path / "file").write_text("")
    os.mkfifo(tmp_path / "pipe")
    for module in ("matplotlib", "foxglove"):
        if module in cause:
            monkeypatch.setitem(sys.modules, module, None)
    assert main(["export", str(session), *(option.format(tmp=tmp_path) for option in options)]) == 2
    error = capsys.readouterr().err
    assert error.startswith("flatcloth: ")
    assert cause in error
    assert error.count("\n") == 1
    assert not (tmp_path / "page.html").exists()
    assert stat.S_ISFIFO((tmp_path / "pipe").stat().st_mode)


def test_what_was_written_before_a_failure_is_told(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise FlatclothError("report.html: cannot be written (No space left on device). Choose another file.")

    monkeypatch.setattr("flatcloth.export.report.report", full)
    options = ["--html", str(tmp_path / "page.html"), "--report", str(tmp_path / "report.html")]
    assert main(["export", str(session), *options]) == 2
    said = capsys.readouterr()
    assert said.out == f"Written: {tmp_path / 'page.html'}\n"
    assert "No space left" in said.err


@pytest.mark.parametrize("option", ["--grasps", "--garment", "--outline", "--html"])
def test_a_session_without_a_start_view_is_one_line_that_names_it(
    session: Path, tmp_path: Path, option: str, capsys: pytest.CaptureFixture[str]
) -> None:
    empty = shutil.copytree(session, tmp_path / "empty")
    (empty / "journal.jsonl").write_text("")
    assert main(["export", str(empty), option, str(tmp_path / "made.svg")]) == 2
    assert capsys.readouterr().err == (
        f"flatcloth: {empty}: the session has no start view, so there is nothing to export.\n"
    )


def test_the_example_of_the_documentation_reads_the_file(
    session: Path, tmp_path: Path, hand_eye: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    document = (Path(__file__).parents[2] / "docs" / "grasps.md").read_text()
    example = document.split("```python\n")[1].split("```")[0]
    assert len([line for line in example.splitlines() if line.strip()]) <= 10
    path = tmp_path / "grasps.json"
    assert main(["export", str(session), "--grasps", str(path), "--hand-eye", str(hand_eye)]) == 0
    capsys.readouterr()
    exec(compile(example.replace("grasps.json", str(path)), "docs/grasps.md", "exec"), {})
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == ["middle", "edge", "gone"]
