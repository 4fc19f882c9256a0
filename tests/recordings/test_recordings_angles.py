"""Angles for sources without them: a step, or a table in any of its forms."""

from pathlib import Path

import pytest
from foreign_folders import write_open3d, write_tum
from tiny_recordings import write_recording

from flatcloth.core.errors import RecordingError
from flatcloth.recordings import open_recording
from flatcloth.recordings.film.angles import Shots, views_of
from flatcloth.recordings.options import SourceOptions

SHOTS = Shots(
    source="scan", count=4, names=("color/a.png", "color/b.png", "color/10.png", "more/b.png"),
    times_s=(1000.0, 1001.0, 1002.0, 1003.0),
)  # fmt: skip


def of_table(tmp_path: Path, text: str) -> list[tuple[int, float]]:
    table = tmp_path / "angles.csv"
    table.write_text(text)
    return views_of(SHOTS, SourceOptions(angles=table))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0\n10\n20.5\n-30\n", [(0, 0), (1, 10), (2, 20.5), (3, -30)]),
        ("# turned by hand\n\nangle_deg\n5\n15\n25\n35\n", [(0, 0), (1, 10), (2, 20), (3, 30)]),
        ("view,angle_deg\n3,90\n0,0\n", [(3, 0), (0, -90)]),
        ("file, angle_deg\na.png, 0\n10, 40\ncolor/b.png, 80", [(0, 0), (2, 40), (1, 80)]),
        ("a.png 0\nmore/b.png\t45", [(0, 0), (3, 45)]),
        ("time_s,angle_deg\n1001.2,0\n1003,30\n", [(1, 0), (3, 30)]),
        ("\ufeffview,angle_deg\n0,0\n", [(0, 0)]),
    ],
)
def test_a_table_is_read_in_its_forms(tmp_path: Path, text: str, expected: list[tuple[int, float]]) -> None:
    assert of_table(tmp_path, text) == expected


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        ("", "has no angles"),
        ("0\n10\n", "has 2 angles, but scan has 4 views"),
        ("0\n10\nx\n30", "line 3 has the angle x"),
        ("0\n10\n9999\n30", "line 3 has the angle 9999"),
        ("0 1\n10 2\n", "does not show which number is the angle"),
        ("view,degrees\n0,0\n", "has no column angle_deg"),
        ("view,angle_deg\n0,0\n1\n", "line 3 has 1 columns, not 2"),
        ("view,angle_deg\n0,0\n4,10\n", "line 3: there is no view 4, they are 0 to 3"),
        ("view,angle_deg\n0,0\none,10\n", "view is one, not a number"),
        ("view,angle_deg\n0,0\n0,10\n", "line 3 and line 2 name the same view"),
        ("view,angle_deg\n0,0\n1,360\n", "line 3 has the angle of line 2"),
        ("file,angle_deg\nc.png,0\n", "no color images are named c.png"),
        ("file,angle_deg\nb.png,0\n", "2 color images are named b.png"),
        ("time_s,angle_deg\n1010,0\n", "no image was taken at 1010 s"),
        ("time_s,angle_deg\nnoon,0\n", "time_s is noon"),
    ],
)
def test_a_table_that_is_wrong_is_one_line(tmp_path: Path, text: str, cause: str) -> None:
    with pytest.raises(RecordingError, match=cause) as caught:
        of_table(tmp_path, text)
    assert str(tmp_path / "angles.csv") in str(caught.value)
    assert "\n" not in str(caught.value)


def test_names_and_times_that_a_source_has_not_cannot_be_used(tmp_path: Path) -> None:
    table = tmp_path / "angles.csv"
    for text, cause in (("file,angle_deg\na,0\n", "no image files"), ("time_s,angle_deg\n0,0\n", "no times")):
        table.write_text(text)
        with pytest.raises(RecordingError, match=cause):
            views_of(Shots(source="scan", count=1), SourceOptions(angles=table))


def test_a_step_counts_from_0_and_stops_after_a_whole_turn(tmp_path: Path) -> None:
    folder = write_open3d(tmp_path / "scan", 10)
    assert open_recording(folder, step_deg=36).angles_deg == tuple(36.0 * n for n in range(10))
    assert open_recording(folder, step_deg=36).notes == ()  # type: ignore[attr-defined]
    turned = open_recording(folder, step_deg=-40)
    assert turned.angles_deg == tuple(-40.0 * n for n in range(9))
    assert turned.notes[0].startswith("1 image is left out")  # type: ignore[attr-defined]
    for step, cause in ((0, "0.01 to 180"), (200, "0.01 to 180"), (60, "1.7 turns")):
        with pytest.raises(RecordingError, match=cause):
            open_recording(folder, step_deg=step)


def test_a_table_in_the_folder_is_found_and_a_named_one_is_preferred(tmp_path: Path) -> None:
    folder = write_tum(tmp_path / "tum")
    (folder / "angles.csv").write_text("0\n7\n14\n")
    assert open_recording(folder).angles_deg == (0, 7, 14)
    assert open_recording(folder, step_deg=10).angles_deg == (0, 10, 20)
    (tmp_path / "other.csv").write_text("view,angle_deg\n2,0\n1,20\n")
    chosen = open_recording(folder, angles=tmp_path / "other.csv")
    assert chosen.angles_deg == (0, 20)
    assert [int(chosen[n].color[5, 5, 2]) for n in range(2)] == [20, 10]


def test_angles_are_given_once_and_only_where_there_are_none(tmp_path: Path) -> None:
    folder = write_open3d(tmp_path / "scan")
    with pytest.raises(RecordingError, match="together with --step"):
        open_recording(folder, angles=tmp_path / "angles.csv", step_deg=10)
    with pytest.raises(RecordingError, match=r"angles\.csv: cannot be read \(No such file"):
        open_recording(folder, angles=tmp_path / "angles.csv")
    with pytest.raises(RecordingError, match="contains its angles"):
        open_recording(write_recording(tmp_path / "native"), step_deg=10)


def test_a_list_that_is_too_long_is_refused_at_once(tmp_path: Path) -> None:
    folder = write_tum(tmp_path / "tum")
    (listed,) = folder.glob("assoc*.txt")
    listed.write_text(listed.read_text().splitlines()[-1] + "\n")
    listed.write_text(listed.read_text() * 10_001)
    with pytest.raises(RecordingError, match=r"lists 10001 images; the limit is 10000\. Keep a part"):
        open_recording(folder)
