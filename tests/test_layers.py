"""The house stands as DESIGN.md draws it: imports point down only. Read from the sources by ast."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

# From the ground up; a module may import from lower layers, and from its own. A module that is in
# no layer fails the test: whoever adds one says where it stands.
LAYERS: tuple[tuple[str, ...], ...] = (
    ("", "errors"),
    ("types", "config", "resources", "memory", "plain_files"),
    ("child",),
    ("geometry", "visibility"),
    ("recordings",),
    ("ramps", "patches", "surface", "upsampling", "raster", "sampling", "necks", "minimisation", "sparse"),
    ("relaxation",),
    ("axis", "axis_estimation", "axis_views"),
    ("looseness",),
    ("flattening", "scan_sums", "scans", "scan_pairs", "registration", "surroundings", "cameras", "capture"),
    ("sightings", "connection", "hinges", "joint"),
    ("document",),
    ("decisions",),
    ("session",),
    ("outlook", "uncertainty", "mosaic"),
    (
        "grasping",
        "grips",
        "hand_eye",
        "guided_capture",
        "occlusion",
        "matching",
        "planning",
        "alignment",
        "merging",
    ),
    ("agreement", "hypotheses", "shapes", "difference", "measuring", "outline"),
    ("paper", "robust"),
    ("following", "repair"),
    ("integration",),
    ("axis_file", "journal_lines", "journal", "export", "evaluation", "synthesis", "teaching", "reasons"),
    ("pipeline", "live", "live_camera"),
    ("outcome",),
    ("viewer", "takeaway", "warmup"),
    ("commands",),
    ("cli",),
    ("app",),
)
LEVEL = {name: level for level, names in enumerate(LAYERS) for name in names}

# Numerics know no viewer, no web and no files.
NUMERICS = {
    "looseness",
    "geometry",
    "visibility",
    "ramps",
    "patches",
    "upsampling",
    "occlusion",
    "matching",
    "surface",
    "axis",
    "axis_estimation",
    "axis_views",
    "raster",
    "sampling",
    "necks",
    "minimisation",
    "sparse",
    "relaxation",
    "hinges",
    "flattening",
    "planning",
    "alignment",
    "merging",
    "difference",
    "measuring",
    "outline",
    "grasping",
    "scan_sums",
    "scans",
    "scan_pairs",
    "surroundings",
    "session",
    "capture",
    "types",
    "registration",
    "sightings",
    "connection",
    "joint",
    "outlook",
    "uncertainty",
    "mosaic",
    "agreement",
    "hypotheses",
    "shapes",
    "paper",
    "robust",
}
NOT_IN_NUMERICS = {"viser", "starlette", "uvicorn", "websockets", "json", "pathlib", "os", "io"}
VIEWER_ONLY = {"viser", "starlette", "uvicorn", "websockets"}
NEVER_AT_START = {"open3d", "pyrealsense2", "libusb_package", "rosbags", "OpenEXR"}


@dataclass(frozen=True)
class Import:
    file: Path
    line: int
    target: str
    at_start: bool
    for_types: bool

    def __str__(self) -> str:
        return f"{self.file.relative_to(ROOT)}:{self.line} imports {self.target}"


def sources() -> list[Path]:
    return sorted((ROOT / "flatcloth").rglob("*.py")) + [p for p in [ROOT / "app.py"] if p.exists()]


def unit(file: Path) -> str:
    """Return the part of the house a file belongs to: a module or a subpackage."""
    parts = file.relative_to(ROOT).with_suffix("").parts
    name = parts[1] if len(parts) > 1 else parts[0]
    return "" if name == "__init__" else name


def imports(file: Path) -> Iterator[Import]:
    tree = ast.parse(file.read_text())

    def walk(node: ast.AST, at_start: bool, for_types: bool) -> Iterator[Import]:
        for child in ast.iter_child_nodes(node):
            inside = at_start and not isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
            typed = for_types or (isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test))
            if isinstance(child, ast.Import):
                for alias in child.names:
                    yield Import(file, child.lineno, alias.name, at_start, for_types)
            elif isinstance(child, ast.ImportFrom):
                assert child.level == 0, f"{file}: relative import"
                for alias in child.names:
                    yield Import(file, child.lineno, f"{child.module}.{alias.name}", at_start, for_types)
            else:
                yield from walk(child, inside, typed)

    yield from walk(tree, at_start=True, for_types=False)


ALL = [found for file in sources() for found in imports(file)]


def target_unit(found: Import) -> str | None:
    package, *rest = found.target.split(".")
    if package != "flatcloth":
        return None
    name = rest[0] if rest else ""
    is_module = (ROOT / "flatcloth" / f"{name}.py").exists() or (ROOT / "flatcloth" / name).is_dir()
    return name if is_module else ""  # a name of the package itself, such as __version__


def test_every_module_has_its_place() -> None:
    assert {unit(file) for file in sources()} - set(LEVEL) == set(), "say in LAYERS where it stands"


@pytest.mark.parametrize("file", sources(), ids=lambda file: str(file.relative_to(ROOT)))
def test_imports_point_down_only(file: Path) -> None:
    level = LEVEL[unit(file)]
    upward = [
        str(f) for f in ALL if f.file == file and (t := target_unit(f)) is not None and LEVEL[t] > level
    ]
    assert upward == []


def test_numerics_know_no_viewer_no_web_and_no_files() -> None:
    known = [f for f in ALL if unit(f.file) in NUMERICS and f.target.split(".")[0] in NOT_IN_NUMERICS]
    assert [str(f) for f in known] == []


def test_only_the_viewer_knows_viser_and_the_web() -> None:
    known = [f for f in ALL if unit(f.file) != "viewer" and f.target.split(".")[0] in VIEWER_ONLY]
    assert [str(f) for f in known] == []


def test_open3d_and_realsense_are_imported_only_where_they_are_used() -> None:
    early = [f for f in ALL if f.target.split(".")[0] in NEVER_AT_START and f.at_start and not f.for_types]
    assert [str(f) for f in early] == []


def test_the_truth_is_read_by_the_evaluation_only() -> None:
    readers = {
        unit(f.file) for f in ALL if f.target.startswith("flatcloth.recordings.truth") and not f.for_types
    }
    assert readers <= {"recordings", "evaluation", "commands"}


def test_nothing_is_pickled() -> None:
    pickling = {"pickle", "marshal", "shelve", "joblib", "dill"}
    assert [str(f) for f in ALL if f.target.split(".")[0] in pickling] == []
    loads = [
        f"{file}:{node.lineno}"
        for file in sources()
        for node in ast.walk(ast.parse(file.read_text()))
        if isinstance(node, ast.keyword) and node.arg == "allow_pickle" and ast.unparse(node.value) != "False"
    ]
    assert loads == []


def test_the_reader_of_imports_sees_what_it_must(tmp_path: Path) -> None:
    source = tmp_path / "x.py"
    source.write_text(
        "import open3d\n"
        "from typing import TYPE_CHECKING\n"
        "if TYPE_CHECKING:\n    import viser\n"
        "class A:\n    def f(self):\n        from pyrealsense2 import pipeline\n"
        "try:\n    import cv2\nexcept ImportError:\n    pass\n"
    )
    found = {f.target: (f.at_start, f.for_types) for f in imports(source)}
    assert found == {
        "open3d": (True, False),
        "typing.TYPE_CHECKING": (True, False),
        "viser": (True, True),
        "pyrealsense2.pipeline": (False, False),
        "cv2": (True, False),
    }
