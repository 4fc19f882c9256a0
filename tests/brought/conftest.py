"""Views of a bundled recording, made small, as users of other programs keep them."""

import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from flatcloth.cli import main
from flatcloth.core.types import RgbdFrame
from flatcloth.recordings import open_recording

EVERY = 4
"""Each so many-th row and column is kept."""


def millimetres(frame: RgbdFrame, every: int) -> Any:
    return (1000 * frame.depth_m[::every, ::every]).round().astype(np.uint16)


@pytest.fixture(scope="session")
def small_views() -> tuple[dict[str, float], list[tuple[Any, Any]]]:
    """The camera, and color (B G R) and depth (mm) of three views."""
    recording = open_recording("shirt-corner-d435")
    k, frames = recording.intrinsics, [recording[n] for n in range(3)]
    camera = {name: getattr(k, name) / EVERY for name in ("fx", "fy", "cx", "cy")}
    size = {"width": k.width // EVERY, "height": k.height // EVERY}
    return size | camera, [(f.color[::EVERY, ::EVERY, ::-1], millimetres(f, EVERY)) for f in frames]


@pytest.fixture
def plain_folder(tmp_path: Path, small_views: Any) -> Callable[..., Path]:
    """Write ``color/`` and ``depth/`` of three views, and a camera file unless its content is None."""

    def write(
        content: dict[str, Any] | str | None = None,
        file: str = "intrinsic.json",
        folder: str = "take",
        name: Callable[[int], str] = "{:03d}".format,
    ) -> Path:
        camera, views = small_views
        place = tmp_path / folder
        for kind, n in (("color", 0), ("depth", 1)):
            (place / kind).mkdir(parents=True)
            for number, view in enumerate(views):
                (place / kind / f"{name(number)}.png").write_bytes(cv2.imencode(".png", view[n])[1].tobytes())
        text = content if isinstance(content, str) else json.dumps(camera | (content or {}))
        (place / file).write_text(text)
        return place

    return write


@pytest.fixture
def imported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[Any, list[Any], str]]:
    """Import a source on the command line; return the written header, depth (m), and what was said."""

    def run(source: Path, *options: str) -> tuple[Any, list[Any], str]:
        out = tmp_path / "imported"
        status = main(["import", str(source), *(options or ("--step", "10")), "--out", str(out)])
        said = capsys.readouterr()
        assert status == 0, said.err
        header = json.loads((out / "recording.json").read_text())
        depths = [cv2.imread(str(out / view["depth"]), cv2.IMREAD_UNCHANGED) for view in header["views"]]
        return header, [depth * np.float32(header["depth_scale_m"]) for depth in depths], said.out + said.err

    return run


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Run the command line on bad input; return its one line."""

    def run(*arguments: str) -> str:
        assert main(list(arguments)) == 2
        said = capsys.readouterr().err
        assert said.count("\n") == 1
        assert said.startswith("flatcloth: ")
        return said

    return run


HALF = 2


@pytest.fixture(scope="session")
def half_views() -> tuple[dict[str, float], list[tuple[Any, Any, Any]]]:
    """The camera, and color (BGR), depth (mm) and mask of 36 views, 10 degrees apart."""
    recording = open_recording("shirt-corner-d435")
    k, views = recording.intrinsics, []
    for n in range(len(recording)):
        frame = recording[n]
        color = cv2.resize(frame.color, None, fx=1 / HALF, fy=1 / HALF, interpolation=cv2.INTER_AREA)
        views.append(
            (color[..., ::-1], millimetres(frame, HALF), 255 * frame.mask[::HALF, ::HALF].astype(np.uint8))
        )
    camera = {"width": k.width // HALF, "height": k.height // HALF, "fx": k.fx / HALF, "fy": k.fy / HALF}
    return {**camera, "cx": k.cx / HALF - 0.25, "cy": k.cy / HALF - 0.25, "depth_scale": 1000}, views


@pytest.fixture
def take(tmp_path: Path, half_views: Any) -> Callable[..., Path]:
    """Write a take: ``color``, ``depth`` and ``mask`` are pairs of a name and the number of a view."""
    camera, views = half_views

    def write(
        color: Iterable[tuple[str, int]],
        depth: Iterable[tuple[str, int]],
        mask: Iterable[tuple[str, int]] = (),
        unit: float = 1.0,
    ) -> Path:
        folder = tmp_path / "take"
        for kind, named in enumerate((color, depth, mask)):
            for name, n in named:
                file = folder / ("color", "depth", "mask")[kind] / f"{name}.png"
                file.parent.mkdir(parents=True, exist_ok=True)
                image = views[n][kind]
                made = (image * unit).round().clip(0, 65535).astype(np.uint16) if kind == 1 else image
                assert cv2.imwrite(str(file), made, [cv2.IMWRITE_PNG_COMPRESSION, 1])
        (folder / "intrinsic.json").write_text(json.dumps(camera))
        return folder

    return write
