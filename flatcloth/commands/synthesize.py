"""The command ``synthesize``: a recording with truth from a garment mesh."""

from __future__ import annotations

import argparse
from pathlib import Path

from flatcloth.commands.common import ProgressBar
from flatcloth.commands.output import report

NAME = "synthesize"
SUMMARY = "render a garment mesh to a recording with its truth"
EXAMPLES = """examples:
  flatcloth synthesize shirt.obj --out my-shirt
  flatcloth synthesize shirt.glb --out my-shirt --panel back --sensor d435 --seed 2
  flatcloth synthesize shirt.glb --out my-shirt --sensor stereo --sway 3 --twist 0.7 --exposure 8
  flatcloth synthesize scan.ply --out my-shirt --scale 0.001 --up y --held 12 840 -3 --texture floral"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("mesh", type=Path, metavar="MESH", help="OBJ, PLY, glTF, GLB, STL or OFF file")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="recording folder to write")
    parser.add_argument("--name", help="title of the recording (default: the folder's name)")
    _add_hanging(parser.add_argument_group("the item"))
    _add_camera(parser.add_argument_group("the camera"))
    _add_errors(parser.add_argument_group("noise and errors"))


def _add_hanging(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--up",
        choices=("x", "y", "z", "-x", "-y", "-z"),
        help="upward axis of the file (default: GLB and glTF y, others z); a downward one as --up=-z",
    )
    group.add_argument("--scale", type=float, default=1.0, help="metres per unit of the file (default: 1)")
    held = group.add_mutually_exclusive_group()
    held.add_argument(
        "--held", type=float, nargs=3, metavar=("X", "Y", "Z"),
        help="held point, in the file's frame and unit (default: the highest vertex)",
    )  # fmt: skip
    held.add_argument("--held-vertex", type=int, metavar="N", help="held vertex, counted from 0")
    group.add_argument(
        "--balance", action="store_true", help="rotate the mesh rigidly so that it hangs below the held point"
    )
    group.add_argument("--panel", default="1", help="side of interest: front, back, or 1 or 2 (default: 1)")
    group.add_argument("--inside-out", action="store_true", help="the faces of the file point inwards")
    group.add_argument(
        "--texture",
        help="checker, floral, stripes, plain, mesh (its own colors), or a kit.json, which is printed on it "
        "(default: its own if it has any, else checker)",
    )  # fmt: skip


def _add_camera(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--distance",
        type=float,
        default=0.85,
        metavar="M",
        help="distance from the turning axis (default: 0.85)",
    )
    group.add_argument(
        "--step", type=float, default=10.0, metavar="DEG", help="angle between views (default: 10)"
    )
    group.add_argument(
        "--size",
        type=int,
        nargs=2,
        default=(480, 848),
        metavar=("W", "H"),
        help="image size in pixels (default: 480 848)",
    )
    group.add_argument("--focal", type=float, default=425.0, metavar="PX", help="focal length (default: 425)")
    group.add_argument(
        "--center", type=float, nargs=2, metavar=("CX", "CY"), help="principal point (default: the middle)"
    )


_DEVIATIONS = (
    (("--angle-error",), "DEG", "the recorded angles"),
    (("--axis-error",), "MM", "the recorded axis"),
    (("--sway", "--swing"), "MM", "the lowest point from view to view"),
    (("--twist",), "DEG", "the angle by which the lowest point lags behind the turn"),
    (("--exposure",), "PERCENT", "the exposure from view to view; white balance a quarter of it"),
)


def _add_errors(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--sensor",
        "--noise",
        dest="noise",
        choices=("none", "d435", "stereo"),
        default="none",
        help="none, the noise model of a D435, or depth matched between two rendered infrared images",
    )
    for names, unit, text in _DEVIATIONS:
        group.add_argument(
            *names, dest=names[0][2:].replace("-", "_"), type=float, default=0.0, metavar=unit,
            help=f"standard deviation of {text}",
        )  # fmt: skip
    group.add_argument(
        "--seed", type=int, default=0, help="seed of the pattern and of all errors (default: 0)"
    )


def run(options: argparse.Namespace) -> None:
    """Render and write the recording, and print a summary."""
    from flatcloth.synthesis.hanging import PoseErrors
    from flatcloth.synthesis.recording import Request, camera_of, synthesize
    from flatcloth.synthesis.stereo import Exposure
    from flatcloth.validation.kit import printed_cloth, read_kit, write_kit

    kit = read_kit(Path(options.texture)) if (options.texture or "").endswith(".json") else None
    request = Request(
        mesh=options.mesh,
        out=options.out,
        name=options.name,
        up=options.up,
        scale=options.scale,
        held=tuple(options.held) if options.held else options.held_vertex,
        balanced=options.balance,
        inside_out=options.inside_out,
        panel=options.panel,
        texture=printed_cloth(kit) if kit else options.texture,
        camera=camera_of(tuple(options.size), options.focal, options.center),
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
