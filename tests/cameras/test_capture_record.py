"""The command ``record``, with a played file as the camera and a list of answers as the operator."""

import io
import json
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from realsense_files import stop_and_go, turning, write_realsense

from flatcloth import cameras
from flatcloth.cameras.capture import Phase
from flatcloth.cameras.guided_capture import GuidedCapture, writer_for
from flatcloth.cameras.playback import PlaybackCamera
from flatcloth.cli import main
from flatcloth.commands import record
from flatcloth.commands.options import Output
from flatcloth.commands.output import speaking
from flatcloth.engine.integration import Integration
from flatcloth.engine.segmenting import prepare
from flatcloth.recordings import open_recording


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three stops of 2.2 s, 10 degrees apart."""
    folder = tmp_path_factory.mktemp("record")
    return write_realsense(folder / "stops.db3", turning(stop_and_go(3, 10.0, 2.2, 0.8), 8.5))


@pytest.fixture
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Files play as fast as they can."""
    monkeypatch.setattr(
        cameras, "open_camera", lambda which, align: PlaybackCamera(Path(which), align, real_time=False)
    )


def led(file: Path, out: Path, answer: Callable[[GuidedCapture], str | None]) -> GuidedCapture:
    """Lead through a capture; ``answer`` is asked at each frame what the operator types."""
    camera = PlaybackCamera(file, real_time=False)
    guided = GuidedCapture(camera, lambda: writer_for(camera, str(out), "coat", False), 10.0)
    with speaking(Output()):
        record.lead(camera, guided, lambda: answer(guided))
    guided.close()
    camera.close()
    return guided


@pytest.mark.usefixtures("at_once")
def test_each_stop_of_a_turned_item_becomes_a_view(file, tmp_path, capsys):
    out = tmp_path / "coat"
    assert main(["record", "--out", str(out), "--camera", str(file), "--yes"]) == 0
    said = capsys.readouterr().out
    for line in (
        "stops.db3: 240x240 px, 15 frames/s",
        "View 0: let the item hang still.",
        "View 1: turn the item by +10 degrees, to 10.",
        "View 2 at 20 degrees: 10 frames, noise",
        "View 2 is kept.",
        "played to its end",
        f"3 views are in {out}. Open it with: flatcloth view {out}",
    ):
        assert line in said
    read = open_recording(out)
    assert (read.name, read.angles_deg) == ("coat", (0.0, 10.0, 20.0))
    # It has no masks: as ``view`` opens it, the side of interest is found in all that was captured.
    integration = Integration(read, segmenter=prepare)
    found = integration.views.solver().solve(())
    assert sorted(found.observed.views) == [0, 1, 2]
    assert found.area_of_interest_m2 > 0.01
    for n in range(3):
        mask, depth_m = found.mask(n), read[n].depth_m
        before_wall = (depth_m > 0) & (depth_m < 1.4)
        assert not (mask & ~before_wall).any()
        assert mask.sum() > 0.8 * before_wall.sum()


@pytest.mark.usefixtures("at_once")
def test_a_capture_is_gone_on_with_only_when_asked(file, tmp_path, capsys):
    out = tmp_path / "coat"
    given = ["--camera", str(file), "--yes", "--step", "-20", "--frames", "8"]
    arguments = ["record", "--out", str(out), *given]
    assert main(arguments) == 0
    assert main(arguments) == 2
    assert "--resume" in capsys.readouterr().err
    assert main([*arguments, "--resume"]) == 0
    capsys.readouterr()
    # The file's two turns are the fourth and the fifth of the recording.
    assert open_recording(out).angles_deg == (0.0, -20.0, -40.0, -60.0, -80.0)
    assert main([*arguments, "--resume", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told == {"folder": str(out), "angles_deg": list(open_recording(out).angles_deg)}


def test_the_operator_keeps_repeats_corrects_and_ends(file, tmp_path, capsys):
    typed: list[str] = []

    def answer(guided: GuidedCapture) -> str | None:
        view, phase = len(guided.state.kept_deg), guided.state.phase
        if phase is Phase.TURN and view == 1 and "nonsense" not in typed:
            typed.append("nonsense")
            return "nonsense\n"
        if phase is Phase.TURN and view == 2:
            return "q\n"
        if phase is not Phase.REVIEW:
            return None
        step = {0: ["360x", "\n"], 1: ["12.5\n", "0\n", "\n"]}[view]
        done = sum(1 for t in typed if t.startswith(f"{view}:"))
        typed.append(f"{view}:{step[done]}")
        return step[done]

    guided = led(file, tmp_path / "out", answer)
    assert guided.state.phase is Phase.DONE
    said = capsys.readouterr().out
    assert "'nonsense'? Enter, r, q, or the angle" in said
    assert "'360x'? Enter" in said
    assert "view at 0 degrees already" in said
    assert open_recording(tmp_path / "out").angles_deg == (0.0, 12.5)


def test_without_a_terminal_it_must_be_told_to_keep_everything(file, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "stdin", io.StringIO(""))
    assert main(["record", "--out", str(tmp_path / "out"), "--camera", str(file)]) == 2
    assert "--yes" in capsys.readouterr().err
    monkeypatch.setattr(sys.stdin, "isatty", lambda: True)
    assert main(["record", "--out", str(tmp_path / "out"), "--camera", str(file), "--json"]) == 2
    assert "show no questions; give --yes" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("at_once")
def test_ctrl_c_leaves_what_was_kept(file, tmp_path, monkeypatch, capsys):
    keep = GuidedCapture.keep

    def interrupted(self: GuidedCapture) -> None:
        keep(self)
        raise KeyboardInterrupt

    monkeypatch.setattr(GuidedCapture, "keep", interrupted)
    out = tmp_path / "out"
    assert main(["record", "--out", str(out), "--camera", str(file), "--yes"]) == 0
    assert "1 view is in" in capsys.readouterr().out
    assert len(open_recording(out)) == 1


def test_what_is_typed_is_read_without_waiting(monkeypatch):
    import os

    reading, writing = os.pipe()
    with os.fdopen(reading) as stdin, os.fdopen(writing, "w", buffering=1) as keyboard:
        monkeypatch.setattr(sys, "stdin", stdin)
        assert record.typed() is None
        keyboard.write("r\n")
        assert record.typed() == "r\n"
        assert record.typed() is None
        keyboard.close()
        assert record.typed() == "q"  # the terminal is gone
