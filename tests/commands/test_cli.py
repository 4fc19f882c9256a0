import fcntl
import json
import os
import re
import shutil
import signal
import struct
import subprocess
import sys
import termios
from pathlib import Path

import httpx
import pytest
from exported_sessions import write_cylinder
from tiny_recordings import few_views

from flatcloth import __version__
from flatcloth.cli import main
from flatcloth.export.data import read_shape
from flatcloth.methods.registry import method_names
from flatcloth.session.header import read_header

ROOT = Path(__file__).parents[2]
COMMANDS = ("view", "run", "export", "evaluate", "import", "record", "synthesize")
SAMPLE = ROOT / "recordings" / "shirt-sleeve-clean"


@pytest.fixture(scope="module")
def sample(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Every fourth view of a bundled recording, with its truth."""
    return few_views(SAMPLE.name, 4, tmp_path_factory.mktemp("sample") / SAMPLE.name)


def test_run_integrates_resumes_and_evaluate_agrees(sample, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["run", str(sample), "--sides", "one", "--out", str(out)]) == 0
    view = read_shape(out / "flattened.npz")
    assert view.pixel_size_m == 0.002
    first = capsys.readouterr()
    assert "views integrated" in first.out
    assert f"{sample.name}: 100% writing" in first.err  # no terminal: lines in place of a bar

    journal = (out / "journal.jsonl").read_bytes()
    log = tmp_path / "log.txt"
    assert (
        main(["run", str(sample), "--sides", "one", "--out", str(out), "--quiet", "--log-file", str(log)])
        == 0
    )
    assert (out / "journal.jsonl").read_bytes() == journal
    said = capsys.readouterr()
    assert (said.out, said.err) == ("", "")
    logged = log.read_text()
    assert all(line in logged for line in first.out.splitlines())

    figures = tmp_path / "figures.json"
    assert main(["evaluate", str(sample), "--sides", "one", "--json", str(figures)]) == 0
    (row,) = json.loads(figures.read_text())
    assert row["pixels"] == int(view.valid.sum())  # the same integration, twice
    # Golden bounds of the sample: locally right to a millimetre, three quarters of the shirt placed.
    assert row["relative_median_mm"] < 1.0
    assert row["coverage"] > 0.75
    assert row["wrong_side_share"] < 0.001
    assert len(row["views"]) >= 6
    assert "shirt-sleeve-clean" in capsys.readouterr().out


def test_a_run_is_told_as_json_or_with_a_line_a_view(tmp_path, capsys):
    recording, out = str(write_cylinder(tmp_path / "cylinder")), str(tmp_path / "out")
    command = ["run", recording, "--out", out, "--method", "paper"]
    assert main([*command, "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((tmp_path / "out" / "outcome.json").read_text())
    assert main(command) == 0
    short = capsys.readouterr().out
    assert main([*command, "--verbose"]) == 0
    told = capsys.readouterr().out
    assert printed["accepted"]
    for view in printed["accepted"]:
        line = f"View {view['view_index']} at {view['angle_deg']:g} degrees: accepted"
        assert line in told
        assert line not in short


LAB = "lab.example.org"
REFUSED = [
    *((words, "no-such-recording") for words in (
        ["run", "no-such-recording", "--out", "out"], ["evaluate", "no-such-recording"],
        ["view", "no-such-recording"], ["no-such-recording"],
    )),
    (["rnu", "x", "--out", "y"], "did you mean 'flatcloth run'?"),
    (["run", "shirt-slev-clean", "--out", "y"], "Did you mean the bundled shirt-sleeve-clean?"),
    (["view", "--camera"], "No RealSense camera is connected"),
    (["view", "--camera", "none.db3"], "No such file"),
    (["view", "shirt-sleeve-clean", "--camera"], "shirt-sleeve-clean: --camera shows a camera"),
    (["view", "--camera", "--step", "0"], "step of 0"),
    (["view", "--camera", "--frames", "2"], "2 frames per view"),
    (["view", "--out", "x"], "--out needs --camera"),
    (["view", "--resume"], "--resume needs --camera"),
    (["view", "--camera", "--cell"], "it does not go with --"),
    (["view", "shirt-sleeve-clean", "--cell"], "it does not go with --"),
    # A token that nobody would see.
    (["view", "--host", "0.0.0.0", "--port", "0", "--quiet"], "--token-file or FLATCLOTH_TOKEN"),
    (["view", "--port", "0", "--public-url", f"https://{LAB}/", "--no-token"], "would admit everybody"),
    *((["view", "--port", "0", "--public-url", url], f"{url!r}: not the address of a page") for url in (
        LAB, f"ftp://{LAB}/", f"https://me@{LAB}/", f"https://{LAB}/?token=x", f"https://{LAB}:99999/",
        "https://[::1/", "https:///cloth/",
    )),
    (["view", "shirt-sleeve-clean", "--port", "0", "--session", "/proc/none/s"], "Choose a writable folder"),
    (["batch", "none", "--coco", "out"], "none: cannot be read"),
    (["active", "--out", "out"], "active needs --cell"),
    (["active", "--out", "out", "--cell", "no.obj"], "no such file"),
    (["active", "--out", "out", "--cell", "--goal", "points:nose"], "no known garment has these points"),
    (["active", "--out", "out", "--cell", "--budget", "many"], "--budget 'many'"),
    (["active", "--out", "out", "--cell", "--within", "0"], "--within 0"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("arguments", "said"), REFUSED, ids=lambda given: " ".join(given) if isinstance(given, list) else ""
)
def test_what_cannot_be_is_one_line_and_exit_code_2(arguments, said, tmp_path, monkeypatch, capsys):
    monkeypatch.delenv("FLATCLOTH_TOKEN", raising=False)
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert error.startswith("flatcloth: ")
    assert said in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "meant"),
    [
        (["run", "x", "--out", "y", "--mehtod", "paper"], "did you mean --method?"),
        (["view", "x", "--prot", "1"], "did you mean --port?"),
        (["check", "x", "more"], "unrecognized arguments: more"),
        (["view", "--port", "70000"], "--port"),
        (["view", "--port", "x"], "--port"),
        (["batch", "x", "--review", "--port", "70000"], "--port"),
        (["active", "--out", "x", "--listen", "70000"], "--listen"),
        (["active", "--out", "x", "--cell", "--start", "nan"], "--start"),
        (["export", "x", "--grasps", "x.json", "--rotation", "nan"], "is not an angle"),
        (["view", "--method", "magic"], "--method"),
        (["run"], "required: SOURCE"),
    ],
)
def test_wrong_options_exit_with_2_and_the_usage_of_their_command(arguments, meant, capsys):
    with pytest.raises(SystemExit, match="2"):
        main(arguments)
    said = capsys.readouterr().err
    assert said.startswith(f"usage: flatcloth {arguments[0]} ")
    assert meant in said


def test_a_recording_may_be_called_as_no_command_is(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rnu").mkdir()
    assert main(["rnu"]) == 2
    assert "recording.json" in capsys.readouterr().err


def test_errors_are_in_the_log_file_too(tmp_path, capsys):
    log = tmp_path / "new" / "log.txt"
    assert main(["run", "no-such-recording", "--out", "y", "--log-file", str(log), "-q"]) == 2
    said = capsys.readouterr().err
    assert said.startswith("flatcloth: no-such-recording")
    assert said.count("\n") == 1
    assert "ERROR" in log.read_text()
    assert "no-such-recording" in log.read_text()
    assert main(["run", "x", "--out", "y", "--log-file", str(tmp_path)]) == 2
    assert f"{tmp_path}: the log cannot be written" in capsys.readouterr().err


def test_on_a_terminal_a_line_stands_above_the_bar_that_is_drawn_while_it_is_said():
    code = (
        "from flatcloth.commands.options import Output\n"
        "from flatcloth.commands.output import ProgressBar, say, speaking\n"
        "with speaking(Output()), ProgressBar('cell') as bar:\n"
        "    bar.show(0.5, 'a view'); say('View 1: turn.')\n"
    )
    reader, terminal = os.openpty()
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, stdout=terminal, stderr=terminal, check=True)
    shown = os.read(reader, 10_000).decode()
    assert "a view" in shown
    assert re.search(r"\r *\rView 1: turn\.\r\n", shown), shown


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
def test_bash_completes_commands_options_and_choices(capsys):
    with pytest.raises(SystemExit, match="0"):
        main(["--print-completion", "bash"])
    script = capsys.readouterr().out
    ask = """
complete_words() { COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); COMP_LINE="$*"; COMPREPLY=()
    _shtab_flatcloth "$1" "${@: -1}" "${@: -2:1}"; echo "${COMPREPLY[@]}"; }
complete_words flatcloth ev
complete_words flatcloth run --meth
complete_words flatcloth run --method pa
"""
    done = subprocess.run(["bash", "-c", script + ask], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ["evaluate", "--method", "paper"]


def test_app_starts_without_realsense_and_open3d():
    code = (
        "import sys\nfor name in ('pyrealsense2', 'open3d', 'libusb_package'): sys.modules[name] = None\n"
        "import flatcloth.cli, flatcloth.engine.integration, flatcloth.recordings, flatcloth.viewer\n"
        "recording = flatcloth.recordings.open_recording('shirt-sleeve-clean')\n"
        "flatcloth.engine.integration.Integration(recording).views.flattening(0)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_help_offers_every_method_without_loading_the_numerics_which_get_one_blas_thread():
    code = (
        "import os, sys; os.environ.pop('OPENBLAS_NUM_THREADS', None)\nimport flatcloth.cli\n"
        "try: flatcloth.cli.main(['run', '--help'])\nexcept SystemExit: pass\n"
        "assert not {'numpy', 'scipy', 'cv2', 'numba'} & set(sys.modules)\n"
        "assert flatcloth.cli.main(['run', 'no-such-recording', '--out', 'x']) == 2\n"
        "assert os.environ['OPENBLAS_NUM_THREADS'] == '1'"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "--method {" + ",".join(method_names()) + "}" in done.stdout


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_tells_its_options_and_examples(command, capsys):
    with pytest.raises(SystemExit) as ended:
        main([command, "--help"])
    assert ended.value.code == 0
    told = capsys.readouterr().out
    assert f"usage: flatcloth {command}" in told
    assert "examples:\n  flatcloth" in told
    assert f"flatcloth {command}" in told


def test_the_help_names_every_command_and_the_version_is_printed(capsys):
    for option, wanted in (("--help", [f"\n    {name} " for name in COMMANDS]), ("--version", [__version__])):
        with pytest.raises(SystemExit):
            main([option])
        told = capsys.readouterr().out
        assert all(text in told for text in wanted)


def test_at_its_end_nothing_waits_for_threads_or_takes_apart_what_was_loaded():
    script = (
        "import atexit, threading, flatcloth.cli as cli\n"
        "class Loaded:\n"
        "    def __del__(self): print('apart', flush=True)\n"
        "loaded = Loaded()\n"
        "atexit.register(lambda: print('ended'))\n"
        "threading.Thread(target=threading.Event().wait, daemon=True).start()\n"
        "cli.main = lambda: 3\ncli.run_and_exit()"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (3, "ended\n")


def test_the_page_is_started_and_stopped_as_a_user_does_it(tmp_path):
    log = tmp_path / "log.txt"
    command = [sys.executable, "app.py", "view", str(SAMPLE), "--port", "0", "--session", str(tmp_path / "s")]
    command += ["--json", "--token-file", str(tmp_path / "token"), "--log-file", str(log)]
    running = subprocess.Popen(
        command,
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # Tests that run as a background job of a shell ignore Ctrl-C, and so would what they start.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    said = running.stdout.readline()
    answer = httpx.get(json.loads(said)["url"]) if said else None
    running.send_signal(signal.SIGINT)
    rest, errors = running.communicate(timeout=60)
    assert answer is not None, errors
    assert answer.status_code == 303  # with the token of the address: on to the page
    token = (tmp_path / "token").read_text().strip()
    about = {"recording": SAMPLE.name, "session": str(tmp_path / "s"), "pid": running.pid, "token": token}
    assert about.items() <= json.loads(said).items()
    assert "flatcloth is at http://127.0.0.1:" in log.read_text()
    assert token not in log.read_text()
    assert running.returncode in (0, 130)  # not by a signal, though threads may still compute
    assert "Traceback" not in rest + errors
    assert (tmp_path / "s" / "session.json").is_file()


@pytest.mark.parametrize(
    "command", ["import x --out", "segment x --out", "synthesize x --out", "check x --pictures"]
)
def test_a_folder_with_something_in_it_is_refused_before_any_work(command, tmp_path, capsys):
    (tmp_path / "mine.txt").write_text("keep")
    assert main([*command.split(), str(tmp_path)]) == 2
    assert f"{tmp_path}: not empty" in capsys.readouterr().err  # and not that there is no x


NAME = "shirt-corner-d435"


def test_a_finding_is_one_line_with_its_mend_and_a_picture(capsys, tmp_path):
    assert main(["check", NAME, "--angle-factor", "0.5", "--pictures", str(tmp_path / "why")]) == 1
    said = capsys.readouterr().out.splitlines()
    assert said[0].endswith("Mended by --angle-factor 2.")
    assert (tmp_path / "why" / "factor.png").stat().st_size > 1000


def test_run_stops_at_what_is_certain_and_names_the_option(capsys, tmp_path):
    assert main(["run", NAME, "--reverse", "--out", str(tmp_path / "out")]) == 2
    line = capsys.readouterr().err.strip().splitlines()[-1]
    assert "Mended by --reverse or --mirror, or go on with --as-recorded." in line
    assert not (tmp_path / "out").exists()


def test_a_mend_stays_with_its_session(capsys, tmp_path):
    given = ["run", str(write_cylinder(tmp_path / "few")), "--out", str(tmp_path / "out"), "--sides", "one"]
    assert main([*given, "--view-angles", "1=30.5"]) == 0
    assert read_header(tmp_path / "out").recording.options["view_angles"] == [[1, 30.5]]
    assert main(given) == 0, "it is continued with the same mends"
    assert main([*given, "--reverse"]) == 2
    assert "belongs to another recording" in capsys.readouterr().err
