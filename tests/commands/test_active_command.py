"""The command ``active``: exit codes, what it prints, and that it goes on."""

import json

from garment_meshes import arc, write_obj

from flatcloth.cli import main
from flatcloth.commands.view import Options, opened_place
from flatcloth.viewer.places import Places


def test_a_goal_that_the_budget_does_not_reach_ends_with_1_and_its_reason(tmp_path, capsys):
    out, sheet = tmp_path / "out", write_obj(tmp_path / "sheet.obj", *arc(200, columns=48))
    command = ["active", "--cell", str(sheet), "--out", str(out), "--sensor", "none", "--goal", "kind"]
    command += ["--panel", "1", "--budget"]
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
    assert main([*command, "2", "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert (told["done"], told["reached"], told["views"]) == (True, False, 2)
    assert told["reason"] in text
    assert [step["number"] for step in told["steps"]] == [0, 1]


def test_the_start_screen_opens_the_bundled_cell_with_its_first_view_in_the_users_sessions(
    tmp_path, monkeypatch
):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.setattr("flatcloth.engine.warmup.compile_beside", lambda: None)
    opened = opened_place(Options(), Places().chosen("cell", ""))
    try:
        assert len(opened.integration.recording) == 1
        assert opened.folder.folder.parent == tmp_path / "flatcloth" / "sessions"
        assert (opened.folder.folder / "recording" / "recording.json").exists()
    finally:
        opened.close()
