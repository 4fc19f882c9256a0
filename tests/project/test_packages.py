"""What is packed: the wheel, the container, and the hooks before a commit."""

import re
import tomllib
import zipfile
from pathlib import Path

import pytest
from hatchling.builders.wheel import WheelBuilder

from flatcloth.core.resources import sample_mesh

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> dict[str, int]:
    """The files of the wheel, each with its size in it."""
    builder = WheelBuilder(str(ROOT))
    (path,) = builder.build(directory=str(tmp_path_factory.mktemp("wheel")), versions=["standard"])
    with zipfile.ZipFile(path) as packed:
        return {entry.filename: entry.compress_size for entry in packed.infolist()}


def test_the_wheel_carries_the_page_one_recording_and_one_mesh(wheel: dict[str, int]) -> None:
    assert {"flatcloth/static/index.html", "flatcloth/static/offline/offline.html"} <= wheel.keys()
    headers = [name for name in wheel if name.endswith("/recording.json")]
    assert headers == ["flatcloth/samples/shirt-sleeve-clean/recording.json"]
    assert f"flatcloth/samples/{sample_mesh().name}" in wheel
    assert sum(wheel.values()) < 8_000_000


def test_the_classifiers_begin_with_the_least_version_of_python() -> None:
    versions = [c.rpartition(" ")[2] for c in PROJECT["classifiers"] if re.search(r":: 3\.\d+$", c)]
    assert versions == ["3.11", "3.12", "3.13", "3.14"]
    assert PROJECT["requires-python"] == f">={versions[0]}"


def test_the_container_installs_extras_that_exist_from_files_that_exist() -> None:
    steps = (ROOT / "Dockerfile").read_text()
    extras = re.search(r"/opt/flatcloth\[([a-z,]+)\]", steps)
    assert set(extras[1].split(",")) <= PROJECT["optional-dependencies"].keys()
    copied = [name for line in re.findall(r"^COPY (.*) \S+$", steps, re.MULTILINE) for name in line.split()]
    allowed = (ROOT / ".dockerignore").read_text().splitlines()
    assert copied
    for name in copied:
        assert (ROOT / name).exists()
        assert f"!{name}" in allowed
