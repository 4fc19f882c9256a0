from exported_sessions import write_cylinder

from flatcloth.cli import main
from flatcloth.session.header import read_header

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
