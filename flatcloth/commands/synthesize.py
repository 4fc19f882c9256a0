"""The command ``synthesize``: a recording with truth from a garment mesh."""

from __future__ import annotations

from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import Literal

from flatcloth.commands.options import Output
from flatcloth.commands.output import ProgressBar, report
from flatcloth.recordings.options import option

SUMMARY = "render a garment mesh to a recording with its truth"
EXAMPLES = """examples:
  flatcloth synthesize shirt.obj --out my-shirt
  flatcloth synthesize shirt.glb --out my-shirt --panel back --sensor d435 --seed 2
  flatcloth synthesize shirt.glb --out my-shirt --sensor stereo --sway 3 --twist 0.7 --exposure 8
  flatcloth synthesize scan.ply --out my-shirt --scale 0.001 --up y --held 12 840 -3 --texture floral"""
_ITEM, _CAMERA, _ERRORS = "the item", "the camera", "noise and errors"
_STD = "standard deviation of "


@dataclass(kw_only=True)
class Options(Output):
    """The options of the command."""

    mesh: Path = option("OBJ, PLY, glTF, GLB, STL or OFF file", "MESH", MISSING, positional=True)
    out: Path = option("recording folder to write", "DIR", MISSING)
    name: str | None = option("title of the recording (default: the folder's name)")
    up: Literal["x", "y", "z", "-x", "-y", "-z"] | None = option(
        "upward axis of the file (default: GLB and glTF y, others z); a downward one as --up=-z", group=_ITEM
    )
    scale: float = option("metres per unit of the file", default=1.0, group=_ITEM)
    held: tuple[float, float, float] | None = option(
        "held point, in the file's frame and unit (default: the highest vertex)", "X Y Z",
        group=_ITEM, either="held"
    )  # fmt: skip
    held_vertex: int | None = option("held vertex, counted from 0", "N", either="held")
    balance: bool = option("rotate the mesh rigidly so that it hangs below the held point", group=_ITEM)
    panel: str = option("side of interest: front, back, or 1 or 2", default="1", group=_ITEM)
    inside_out: bool = option("the faces of the file point inwards", group=_ITEM)
    texture: str | None = option(
        "checker, floral, stripes, plain, mesh (its own colors), or a kit.json, which is printed on it "
        "(default: its own if it has any, else checker)",
        group=_ITEM,
    )
    distance: float = option("distance from the turning axis", "M", 0.85, group=_CAMERA)
    step: float = option("angle between views", "DEG", 10.0, group=_CAMERA)
    size: tuple[int, int] = option("image size in pixels", "W H", (480, 848), group=_CAMERA)
    focal: float = option("focal length", "PX", 425.0, group=_CAMERA)
    center: tuple[float, float] | None = option(
        "principal point (default: the middle)", "CX CY", group=_CAMERA
    )
    noise: Literal["none", "d435", "stereo"] = option(
        "none, the noise model of a D435, or depth matched between two rendered infrared images",
        default="none", names=("--sensor", "--noise"), group=_ERRORS
    )  # fmt: skip
    angle_error: float = option(_STD + "the recorded angles", "DEG", 0.0, group=_ERRORS)
    axis_error: float = option(_STD + "the recorded axis", "MM", 0.0, group=_ERRORS)
    sway: float = option(
        _STD + "the lowest point from view to view", "MM", 0.0, names=("--sway", "--swing"), group=_ERRORS
    )
    twist: float = option(
        _STD + "the angle by which the lowest point lags behind the turn", "DEG", 0.0, group=_ERRORS
    )
    exposure: float = option(
        _STD + "the exposure from view to view; white balance a quarter of it", "PERCENT", 0.0, group=_ERRORS
    )
    seed: int = option("seed of the pattern and of all errors", default=0, group=_ERRORS)


def run(options: Options) -> None:
    """Render and write the recording, and print a summary."""
    from flatcloth.synthesis.hanging import PoseErrors
    from flatcloth.synthesis.recording import Request, camera_of, synthesize
    from flatcloth.synthesis.sensor import Exposure
    from flatcloth.validation.kit import printed_cloth, read_kit, write_kit

    texture = options.texture or ""
    kit = read_kit(Path(texture)) if texture.endswith(".json") else None
    request = Request(
        mesh=options.mesh,
        out=options.out,
        name=options.name,
        up=options.up,
        scale=options.scale,
        held=options.held or options.held_vertex,
        balanced=options.balance,
        inside_out=options.inside_out,
        panel=options.panel,
        texture=printed_cloth(kit) if kit else options.texture,
        camera=camera_of(options.size, options.focal, options.center),
        distance_m=options.distance,
        step_deg=options.step,
        noise=options.noise,
        loose=PoseErrors(
            angle_deg=options.angle_error,
            axis_m=options.axis_error / 1e3,
            swing_m=options.sway / 1e3,
            twist_deg=options.twist,
        ),
        exposure=Exposure(share=options.exposure / 100),
        seed=options.seed,
    )
    with ProgressBar(options.out.name) as bar:
        made = synthesize(request, bar.show)
    if kit:
        write_kit(kit, options.out / "kit.json")
    sides = ", ".join(f"{i} {panel.name}" for i, panel in enumerate(made.panels, start=1))
    line = (
        f"{len(request.angles_deg)} views written to {request.out}. "
        f"Panels: {sides}; side of interest: {made.panel_of_interest}."
    )
    document = {
        "folder": str(request.out),
        "views": len(request.angles_deg),
        "panels": [panel.name for panel in made.panels],
        "panel_of_interest": made.panel_of_interest,
        "notes": made.warnings,
    }
    report(options, document, [*(f"note: {warning}" for warning in made.warnings), line])
