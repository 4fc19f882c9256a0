from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from flatcloth import __version__
from flatcloth.cli import main
from flatcloth.export.data import read_shape
from flatcloth.methods.registry import method_names

ROOT = Path(__file__).parents[2]
COMMANDS = ("view", "run", "export", "evaluate", "import", "record", "synthesize")
SAMPLE = ROOT / "recordings" / "shirt-sleeve-clean"


@pytest.fixture(scope="module")
def sample(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Every second view of a bundled recording, with its truth."""
    folder = tmp_path_factory.mktemp("sample") / SAMPLE.name
    shutil.copytree(SAMPLE, folder)
    header = json.loads((folder / "recording.json").read_text())
    header["views"] = header["views"][::2]
    (folder / "recording.json").write_text(json.dumps(header))
    return folder


def test_run_integrates_resumes_and_evaluate_agrees(
    sample: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["run", str(sample), "--out", str(out)]) == 0
    for name in (
        "session.json",
        "journal.jsonl",
        "flattened.npz",
        "flattened.png",
        "cloud.ply",
        "grasps.json",
    ):
        assert (out / name).is_file()
    view = read_shape(out / "flattened.npz")
    assert view.pixel_size_m == 0.002
    first = capsys.readouterr()
    assert "views integrated" in first.out
    assert first.err == ""

    journal = (out / "journal.jsonl").read_bytes()
    assert main(["run", str(sample), "--out", str(out)]) == 0
    assert (out / "journal.jsonl").read_bytes() == journal
    assert capsys.readouterr().out == first.out

    figures = tmp_path / "figures.json"
    pictures = tmp_path / "pictures"
    code = main(["evaluate", str(sample), "--json", str(figures), "--pictures", str(pictures)])
    assert code == 0
    (row,) = json.loads(figures.read_text())
    assert row["pixels"] == int(view.valid.sum())  # the same integration, twice
    # Golden bounds of the sample: locally right to a millimetre, three quarters of the shirt placed.
    assert row["relative_median_mm"] < 1.0
    assert row["coverage"] > 0.75
    assert row["wrong_side_share"] < 0.001
    assert len(row["views"]) >= 6
    assert (pictures / "shirt-sleeve-clean.png").is_file()
    assert "shirt-sleeve-clean" in capsys.readouterr().out


@pytest.mark.parametrize(
    "arguments",
    [
        ["run", "no-such-recording", "--out", "out"],
        ["evaluate", "no-such-recording"],
        ["view", "no-such-recording"],
        ["no-such-recording"],
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert error.startswith("flatcloth: ")
    assert "no-such-recording" in error
    assert error.count("\n") == 1


def test_a_recording_without_truth_cannot_be_evaluated(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "bare"
    folder.mkdir()
    header = json.loads((SAMPLE / "recording.json").read_text())
    for kind in ("color", "depth", "mask"):
        (folder / kind).symlink_to(SAMPLE / kind)
    header.pop("truth")
    for view in header["views"]:
        view.pop("truth")
    (folder / "recording.json").write_text(json.dumps(header))
    for kind in ("color", "depth", "mask"):  # real folders: links that leave a recording are refused
        (folder / kind).unlink()
        (folder / kind).mkdir()
        for file in (SAMPLE / kind).iterdir():
            (folder / kind / file.name).write_bytes(file.read_bytes())
    assert main(["evaluate", str(folder)]) == 2
    assert "has no truth" in capsys.readouterr().err


@pytest.mark.parametrize("arguments", [["--port", "70000"], ["--port", "x"], ["--method", "magic"], ["run"]])
def test_wrong_options_exit_with_2(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2
    assert "usage:" in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments", [["--help"], ["view", "--help"], ["run", "--help"], ["evaluate", "--help"]]
)
def test_help_has_examples(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 0
    assert "examples:\n  flatcloth" in capsys.readouterr().out


def test_the_version_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--version"])
    assert __version__ in capsys.readouterr().out


def test_app_starts_without_realsense_and_open3d() -> None:
    code = (
        "import sys\nfor name in ('pyrealsense2', 'open3d', 'libusb_package'): sys.modules[name] = None\n"
        "import flatcloth.cli, flatcloth.engine.integration, flatcloth.recordings, flatcloth.viewer\n"
        "recording = flatcloth.recordings.open_recording('shirt-sleeve-clean')\n"
        "flatcloth.engine.integration.Integration(recording).views.flattening(0)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_help_offers_every_method_without_loading_the_numerics() -> None:
    code = (
        "import sys\nimport flatcloth.cli\n"
        "try: flatcloth.cli.main(['run', '--help'])\nexcept SystemExit: pass\n"
        "assert not {'numpy', 'scipy', 'cv2', 'numba'} & set(sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "--method {" + ",".join(method_names()) + "}" in done.stdout


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_tells_its_options_and_examples(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main([command, "--help"])
    assert ended.value.code == 0
    told = capsys.readouterr().out
    assert f"usage: flatcloth {command}" in told
    assert f"flatcloth {command}" in told


def test_the_help_names_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--help"])
    told = capsys.readouterr().out
    for command in COMMANDS:
        assert f"\n    {command} " in told


def test_blas_is_told_to_use_one_thread_before_numpy_is_loaded() -> None:
    script = (
        "import os, sys; os.environ.pop('OPENBLAS_NUM_THREADS', None); import flatcloth.cli as cli\n"
        "assert 'numpy' not in sys.modules\n"
        "try: cli.main(['run', 'no-such-recording', '--out', 'x'])\n"
        "finally: print(os.environ['OPENBLAS_NUM_THREADS'])"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "1", done.stderr


def assert_ends_with_its_status(script: str) -> None:
    """Run a program that does this, then the command; nothing but its own last word is printed."""
    script += "cli.main = lambda: 3\ncli.run_and_exit()"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (3, "ended\n")


def test_what_is_to_be_ended_with_the_program_is_ended_though_a_thread_still_computes() -> None:
    script = (
        "import atexit, threading, flatcloth.cli as cli\n"
        "atexit.register(lambda: print('ended', flush=True))\n"
        "threading.Thread(target=threading.Event().wait, daemon=True).start()\n"
    )
    assert_ends_with_its_status(script)


def test_at_its_end_the_process_does_not_take_apart_what_it_loaded() -> None:
    script = (
        "import atexit, flatcloth.cli as cli\n"
        "class Loaded:\n"
        "    def __del__(self): print('apart', flush=True)\n"
        "loaded = Loaded()\n"
        "atexit.register(lambda: print('ended'))\n"
    )
    assert_ends_with_its_status(script)


def test_the_page_is_started_and_stopped_as_a_user_does_it(tmp_path: Path) -> None:
    command = [sys.executable, "app.py", "view", str(SAMPLE), "--port", "0", "--session", str(tmp_path / "s")]
    running = subprocess.Popen(
        command,
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # Tests that run as a background job of a shell ignore Ctrl-C, and so would what they start.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    assert running.stdout is not None
    said = next((line for line in running.stdout if "http://127.0.0.1:" in line), None)
    running.send_signal(signal.SIGINT)
    rest, errors = running.communicate(timeout=60)
    assert said is not None, errors
    assert running.returncode in (0, 130)  # not by a signal, though threads may still compute
    assert "Traceback" not in rest + errors
    assert (tmp_path / "s" / "session.json").is_file()
