"""The command ``export``: files written from a session."""

from __future__ import annotations

from dataclasses import MISSING, dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from flatcloth.commands.options import ANGLE, HandEye, Output, SourceInformation
from flatcloth.commands.output import ProgressBar, report
from flatcloth.core.errors import FlatclothError, GarmentError, os_errors_as
from flatcloth.core.plain_files import check_replacing
from flatcloth.recordings.options import option

if TYPE_CHECKING:
    from flatcloth.export.data import SessionData
    from flatcloth.export.session import OpenedSession

SUMMARY = "export a session as data, offline page, report, figures, animation, grasp poses or outline"
EXAMPLES = """examples:
  flatcloth export result --html shirt.html --report report.html
  flatcloth export result --data files
  flatcloth export result --figures figures --animation growth.mp4
  flatcloth export result --rerun result.rrd --mcap result.mcap
  flatcloth export result --grasps grasps.json --hand-eye camera.json --rotation 40"""

_NAMES = {
    "html": "page.html",
    "report": "report.html",
    "animation": "growth.mp4",
    "garment": "garment.json",
}
"""The names of the outputs that are made without options."""
_SUFFIXES = {"animation": (".mp4",), "outline": (".svg", ".dxf", ".json")}
"""How the name of an output ends that is written in several formats, or was in another."""
_DRAWING = ("matplotlib", "matplotlib", "export")
_LIBRARIES = {
    "report": _DRAWING,
    "figures": _DRAWING,
    "animation": _DRAWING,
    "rerun": ("rerun", "rerun-sdk", "rerun"),
    "mcap": ("foxglove", "foxglove-sdk", "foxglove"),
}
"""The module, the package and the extra that an output needs."""


@dataclass(kw_only=True)
class Options(Output, SourceInformation, HandEye):
    """The options of the command."""

    session: Path = option(
        "session folder, of --out or --session; it is not changed", "SESSION_DIR", MISSING, positional=True
    )
    data: Path | None = option("write the data files that run writes (docs/exports.md)", "DIR")
    html: Path | None = option("write one page that works offline", "FILE")
    report: Path | None = option("write a report to print (HTML, A4)", "FILE")
    figures: Path | None = option("write every figure as PNG and SVG", "DIR")
    animation: Path | None = option("write the growth as a film (.mp4)", "FILE")
    grasps: Path | None = option("write the grasp poses (grasps.json)", "FILE")
    outline: Path | None = option("write the outline in mm as .svg, .dxf or .json (docs/exports.md)", "FILE")
    garment: Path | None = option("write kind, dimensions and named points (garment.json)", "FILE")
    rerun: Path | None = option("write a recording for rerun (.rrd)", "FILE")
    mcap: Path | None = option("write a recording for Foxglove (.mcap)", "FILE")
    rotation: float | None = option(
        "rotation of the item for --grasps in camera and robot frame (default: that of the last view)",
        "DEG",
        read=ANGLE,
    )
    recording: Path | None = option("present location of the recording, if it was moved", "SOURCE")


OUTPUTS = (
    "data", "html", "report", "figures", "animation", "grasps", "outline", "garment", "rerun", "mcap"
)  # fmt: skip


def run(options: Options) -> None:
    """Write the requested files."""
    from flatcloth.export.session import open_session

    wanted = [name for name in OUTPUTS if getattr(options, name) is not None]
    if not wanted:
        listed = ", ".join(f"--{name}" for name in OUTPUTS)
        raise FlatclothError(f"{options.session}: no output is given; give one or more of {listed}.")
    base_from_camera = options.base_from_camera()
    for name in wanted:
        _check(name, getattr(options, name))
    written: list[str] = []
    try:
        with ProgressBar(str(options.session)) as bar:
            session = open_session(
                options.session, options.recording, bar.show, options=options.source_options()
            )
            turned_deg = session.data.frames.rotation_deg if options.rotation is None else options.rotation
            frames = replace(session.data.frames, base_from_camera=base_from_camera, rotation_deg=turned_deg)
            data = replace(session.data, frames=frames)
            for name in wanted:
                _write(name, session, data, getattr(options, name))
                written.append(str(getattr(options, name)))
    finally:
        report(options, {"written": written}, [f"Written: {path}" for path in written])


def _check(name: str, path: Path) -> None:
    """Raise an error if an output could not be written, before the work for all of them begins."""
    known = _SUFFIXES.get(name, (path.suffix.lower(),))
    if path.suffix.lower() not in known:
        raise FlatclothError(f"{path}: the {name} is written as {', '.join(known)}. Choose such a name.")
    module, package, extra = _LIBRARIES.get(name, ("flatcloth", "", ""))
    if find_spec(module) is None:
        raise FlatclothError(f"{package} is not installed; pip install 'flatcloth[{extra}]'.")
    kind = "folder" if name in ("data", "figures") else "file"
    with os_errors_as(FlatclothError, f"{path}: cannot be written", f"Choose another {kind}."):
        check_replacing(path / "checked" if kind == "folder" else path)


def _write(name: str, session: OpenedSession, data: SessionData, path: Path) -> None:
    from flatcloth.export.by_name import made
    from flatcloth.export.files import write_file

    if name == "data":
        data.write(path)
    elif name == "figures":
        from flatcloth.export.figures import figure_files

        for file, content in figure_files(session):
            write_file(path / file, content)
    elif name in ("rerun", "mcap"):
        from flatcloth.export import moments

        (moments.write_rrd if name == "rerun" else moments.write_mcap)(session, path)
    elif name == "grasps":
        write_file(path, data.files()["grasps.json"]())
    elif name == "garment" and isinstance(session.data.garment, str):
        raise GarmentError(session.data.garment)
    else:
        write_file(path, made(session, _NAMES.get(name, f"outline{path.suffix.lower()}")))
