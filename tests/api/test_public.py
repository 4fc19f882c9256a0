"""The public names: all there, documented, and loaded only when they are used."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

import flatcloth

ROOT = Path(__file__).parents[2]


def run(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    return done.stdout


@pytest.mark.parametrize("name", flatcloth.__all__)
def test_each_public_name_is_there_and_described(name: str) -> None:
    assert getattr(flatcloth, name) is not None
    assert name in dir(flatcloth)
    assert name == "__version__" or f"`{name}" in (ROOT / "docs" / "api.md").read_text()


def test_importing_loads_nothing_else() -> None:
    loaded = json.loads(
        run(
            "import sys, json; before = set(sys.modules); import flatcloth\n"
            "print(json.dumps(sorted(set(sys.modules) - before)))"
        )
    )
    assert [name for name in loaded if name.startswith("flatcloth")] == ["flatcloth"]
    assert not {"numpy", "scipy", "numba", "cv2", "viser"} & set(loaded)


def test_opening_a_recording_loads_no_numerics_and_integrating_no_page() -> None:
    code = "import sys, flatcloth; flatcloth.{}; print(*sys.modules)"
    opening = set(run(code.format("open_recording('shirt-sleeve-clean')")).split())
    assert not {"scipy", "numba", "viser", "matplotlib"} & opening
    assert not {"cv2", "open3d", "pyrealsense2", "rosbags", "sqlite3"} & opening, "other kinds"
    integrating = set(run(code.format("integrate")).split())
    assert not {"viser", "starlette", "uvicorn", "open3d", "matplotlib"} & integrating


def test_what_the_documentation_shows_runs(tmp_path: Path) -> None:
    """Programs of README and docs, on few views, the notebook, and the example: in one process."""
    pages = [(ROOT / page).read_text() for page in ("README.md", "docs/api.md")]
    programs = [code for page in pages for code in re.findall(r"```python\n(.*?)```", page, re.DOTALL)]
    assert len(programs) > 2
    assert all("import flatcloth" in program for program in programs)
    few = [
        re.sub(r"(recording = flatcloth.open_recording.*)", r"\1\nrecording = few(recording, 6)", p)
        for p in programs
    ]
    notebook = json.loads((ROOT / "examples" / "flatcloth.ipynb").read_text())
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in cells)
    shown = [
        "\n".join("".join(cell["source"]) for cell in cells),
        (ROOT / "examples" / "from_arrays.py").read_text(),
    ]
    (tmp_path / "programs.json").write_text(json.dumps([*few, *shown]))
    said = run(
        "import json, os, sys, matplotlib; matplotlib.use('agg')\n"
        f"os.chdir({str(tmp_path)!r}); sys.path.append({str(ROOT / 'examples')!r})\n"
        "from from_arrays import few\n"
        "for code in json.load(open('programs.json')): exec(code, {'__name__': '__main__', 'few': few})"
    )
    assert (tmp_path / "result" / "outcome.json").exists()
    assert "long_sleeved_shirt" in said
    assert "approach" in said
