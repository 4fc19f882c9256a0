"""The command ``export``: files written from a session."""

from __future__ import annotations

from dataclasses import MISSING, Field, dataclass, fields, replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flatcloth.commands.options import ANGLE, HandEye, Output, SourceInformation
from flatcloth.commands.output import ProgressBar, report
from flatcloth.core.errors import FlatclothError, os_errors_as
from flatcloth.core.plain_files import check_replacing
from flatcloth.recordings.options import option

if TYPE_CHECKING:
    from flatcloth.export.session import OpenedSession

SUMMARY = "export a session as data, offline page, report, figures, animation, grasp poses or outline"
EXAMPLES = """examples:
  flatcloth export result --html shirt.html --report report.html
  flatcloth export result --data files
  flatcloth export result --figures figures --animation growth.mp4
  flatcloth export result --rerun result.rrd --mcap result.mcap
  flatcloth export result --grasps grasps.json --hand-eye camera.json --rotation 40"""

_DRAWING = ("matplotlib", "matplotlib", "export")
"""The module, the package and the extra that drawings need."""


@dataclass(kw_only=True)
class Options(Output, SourceInformation, HandEye):
    """The options of the command."""

    session: Path = option(
        "session folder, of --out or --session; it is not changed", "SESSION_DIR", MISSING, positional=True
    )
    data: Path | None = option("write the data files that run writes (docs/exports.md)", "DIR", writes="data")
    html: Path | None = option("write one page that works offline", "FILE", writes="page.html")
    report: Path | None = option(
        "write a report to print (HTML, A4)", "FILE", writes="report.html", needs=_DRAWING
    )
    figures: Path | None = option(
        "write every figure as PNG and SVG", "DIR", writes="figures", needs=_DRAWING
    )
    animation: Path | None = option(
        "write the growth as a film (.mp4)", "FILE", writes="growth.mp4", needs=_DRAWING, suffixes=(".mp4",)
    )
    grasps: Path | None = option("write the grasp poses (grasps.json)", "FILE", writes="grasps.json")
    outline: Path | None = option(
        "write the outline in mm as .svg, .dxf or .json (docs/exports.md)",
        "FILE",
        writes="outline",
        suffixes=(".svg", ".dxf", ".json"),
    )
    garment: Path | None = option(
        "write kind, dimensions and named points (garment.json)", "FILE", writes="garment.json"
    )
    rerun: Path | None = option(
        "write a recording for rerun (.rrd)", "FILE", writes="rrd", needs=("rerun", "rerun-sdk", "rerun")
    )
    mcap: Path | None = option(
        "write a recording for Foxglove (.mcap)",
        "FILE",
        writes="mcap",
        needs=("foxglove", "foxglove-sdk", "foxglove"),
    )
    rotation: float | None = option(
        "rotation of the item for --grasps in camera and robot frame (default: that of the last view)",
        "DEG",
        read=ANGLE,
    )
    recording: Path | None = option("present location of the recording, if it was moved", "SOURCE")


def run(options: Options) -> None:
    """Write the requested files."""
    from flatcloth.export.session import open_session

    outputs = [field for field in fields(Options) if "writes" in field.metadata]
    wanted = {field: path for field in outputs if (path := getattr(options, field.name)) is not None}
    if not wanted:
        listed = ", ".join(f"--{field.name}" for field in outputs)
        raise FlatclothError(f"{options.session}: no output is given; give one or more of {listed}.")
    base_from_camera = options.base_from_camera()
    for field, path in wanted.items():
        _check(field, path)
    written: list[str] = []
    try:
        with ProgressBar(str(options.session)) as bar:
            opened = open_session(
                options.session, options.recording, bar.show, options=options.source_options()
            )
            session = replace(opened, rotation_deg=options.rotation, base_from_camera=base_from_camera)
            for field, path in wanted.items():
                _write(field, session, path)
                written.append(str(path))
    finally:
        report(options, {"written": written}, [f"Written: {path}" for path in written])


def _check(output: Field[Any], path: Path) -> None:
    """Raise an error if an output could not be written, before the work for all of them begins."""
    about, suffix = output.metadata, path.suffix.lower()
    known = about.get("suffixes", (suffix,))
    if suffix not in known:
        names = ", ".join(known)
        raise FlatclothError(f"{path}: the {output.name} is written as {names}. Choose such a name.")
    module, package, extra = about.get("needs", ("flatcloth", "", ""))
    if find_spec(module) is None:
        raise FlatclothError(f"{package} is not installed; pip install 'flatcloth[{extra}]'.")
    kind = "folder" if about["form"] == "DIR" else "file"
    with os_errors_as(FlatclothError, f"{path}: cannot be written", f"Choose another {kind}."):
        check_replacing(path / "checked" if kind == "folder" else path)


def _write(output: Field[Any], session: OpenedSession, path: Path) -> None:
    from flatcloth.export import moments
    from flatcloth.export.by_name import made
    from flatcloth.export.files import write_file

    match output.metadata["writes"]:
        case "data":
            session.data.write(path)
        case "figures":
            from flatcloth.export.figures import figure_files

            for file, content in figure_files(session):
                write_file(path / file, content)
        case "rrd":
            moments.write_rrd(session, path)
        case "mcap":
            moments.write_mcap(session, path)
        case "outline":
            write_file(path, made(session, f"outline{path.suffix.lower()}"))
        case name:
            write_file(path, made(session, name))
