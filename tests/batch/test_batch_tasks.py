"""From sources to tasks: what each kind of source gives, the names, and when a task is still the same."""

import json
import os
import shutil
from pathlib import Path

import pytest
from tiny_recordings import write_recording

from flatcloth.batch.jobs import garment_columns
from flatcloth.batch.rows import DONE, write_row
from flatcloth.batch.tasks import Task, content_signature, quick_signature, slug, tasks_of
from flatcloth.core.config import Config
from flatcloth.core.errors import FlatclothError
from flatcloth.recordings import SourceOptions


@pytest.fixture
def data(tmp_path: Path) -> Path:
    for name in ("b", "a", "c d"):
        write_recording(tmp_path / "data" / name)
    return tmp_path / "data"


def tasks(*sources: object, out: Path = Path("/nowhere"), **options: object) -> list[Task]:
    return tasks_of([str(s) for s in sources], "robust", SourceOptions(**options), out)  # type: ignore[arg-type]


def names(*sources: object, out: Path = Path("/nowhere")) -> list[str]:
    return [task.name for task in tasks(*sources, out=out)]


def test_folders_patterns_and_recordings_give_tasks_in_order(data: Path) -> None:
    assert names(data) == ["a", "b", "c-d"]
    assert names(f"{data}/[ab]") == ["a", "b"]
    assert names(data / "b", data / "a", data) == ["b", "a", "c-d"]  # none twice
    assert tasks(data / "a")[0].source == str((data / "a").resolve())
    assert names("shirt-corner-d435") == ["shirt-corner-d435"]


def test_a_csv_manifest_has_options_as_columns(data: Path) -> None:
    (data / "list.csv").write_text("source,name,method,fov_deg,angles\na,first,paper,,\nb,,,60 40,t.csv\n")
    first, second = tasks(data / "list.csv", step_deg=10.0)
    assert (first.name, first.method, first.options) == ("first", "paper", SourceOptions(step_deg=10.0))
    assert (second.name, second.method) == ("b", "robust")
    said = SourceOptions(step_deg=10.0, fov_deg=(60.0, 40.0), angles=data / "t.csv")
    assert second.options == said
    assert Task.from_dict(json.loads(json.dumps(second.to_dict()))) == second


def test_a_json_lines_manifest_may_name_one_source_twice(data: Path) -> None:
    lines = [{"source": "a", "name": "forth"}, {"source": "a", "name": "back", "sweep": "back"}]
    (data / "list.jsonl").write_text("\n".join(map(json.dumps, lines)) + "\n\n")
    assert [(t.name, t.options.sweep) for t in tasks(data / "list.jsonl")] == [
        ("forth", None),
        ("back", "back"),
    ]


@pytest.mark.parametrize(
    ("name", "text", "cause"),
    [
        ("l.csv", "source,speed\na,3\n", "line 2: unknown option 'speed'"),
        ("l.csv", "name\nx\n", "line 2: names no source"),
        ("l.csv", "source,name\na,b,c\n", "does not have the columns"),
        ("l.csv", "source,name\na,../x\n", "is no folder name"),
        ("l.csv", "source\n", "lists no sources"),
        ("l.csv", "source,step_deg\na,1\na,2\n", "named twice with different options"),
        ("l.csv", "source,name\na,x\nb,x\n", "its name 'x' is that of"),
        ("l.csv", "source,name\n.,x\n", "has 3 recordings; one name"),
        ("l.jsonl", "{\n", "line 1 is not JSON"),
        ("l.jsonl", "[1]\n", "line 1 is no object"),
        ("l.jsonl", '{"source": 3}\n', "line 1: names no source"),
    ],
)
def test_a_manifest_that_is_not_valid_is_told_by_its_line(
    data: Path, name: str, text: str, cause: str
) -> None:
    (data / name).write_text(text)
    with pytest.raises(FlatclothError, match=cause) as caught:
        tasks(data / name)
    assert "\n" not in str(caught.value)


def test_names_tell_recordings_of_numbered_folders_and_never_collide(tmp_path: Path) -> None:
    for place in ("set/07/33/02", "set/07/33/03", "x/a", "y/a"):
        write_recording(tmp_path / place)
    assert names(f"{tmp_path}/set/*/*/*") == ["07-33-02", "07-33-03"]
    one, other = names(tmp_path / "x/a", tmp_path / "y/a")
    assert one == "a"
    assert other.startswith("a-")
    assert slug("../ü/b c\n") == "b-c"


def test_a_source_keeps_the_name_that_it_has_in_the_output(tmp_path: Path) -> None:
    for place in ("x/a", "y/a"):
        write_recording(tmp_path / place)
    out = tmp_path / "out"
    for task in tasks(tmp_path / "x/a", tmp_path / "y/a", out=out):
        write_row({**task.to_dict(), "options": None, "outcome": DONE}, out / task.name)
    assert names(tmp_path / "y/a", out=out)[0].startswith("a-")
    assert names(tmp_path / "y/a", tmp_path / "x/a", out=out)[1] == "a"


def test_a_task_is_the_same_by_content_options_and_settings(
    data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (task,) = tasks(data / "a")
    quick, content = quick_signature(task), content_signature(task)
    image = data / "a/color/1.png"
    os.utime(image, ns=(1, 1))
    assert quick_signature(task) != quick  # looked at again
    assert content_signature(task) == content  # and found to be the same
    assert content_signature(Task(source=task.source, name="a", method="paper")) != content
    monkeypatch.setattr(Config, "to_dict", lambda _: {"other": "settings"})
    assert content_signature(task) != content
    monkeypatch.undo()
    image.write_bytes(image.read_bytes() + b"x")
    assert content_signature(task) != content


def test_the_content_of_a_file_that_an_option_names_counts(data: Path, tmp_path: Path) -> None:
    camera = tmp_path / "camera.json"
    camera.write_text("1")
    (task,) = tasks(data / "a", camera_file=camera)
    before = content_signature(task)
    camera.write_text("2")
    assert content_signature(task) != before


def test_a_moved_data_set_is_the_same_content(data: Path, tmp_path: Path) -> None:
    shutil.copytree(data / "a", tmp_path / "copy")
    (here,), (there,) = tasks(data / "a"), tasks(tmp_path / "copy")
    assert content_signature(here) == content_signature(there)


def test_kind_probability_and_dimensions_are_told() -> None:
    sizes = {"chest_width": {"value": 512, "std": 6}}
    document = {
        "kind": "tshirt", "probabilities": {"tshirt": 0.97, "none": 0.03}, "dimensions_mm": sizes,
    }  # fmt: skip
    found = garment_columns(document)
    assert found["garment"] == "tshirt"
    assert found["garment_probability"] == 0.97
    assert json.loads(found["dimensions_mm"]) == sizes
    none = garment_columns({**document, "kind": None, "probabilities": {"none": 0.8, "towel": 0.2}})
    assert (none["garment"], none["garment_probability"]) == ("none of these", 0.8)
