"""The command ``synthesize``: a recording with truth from a garment mesh."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from flatcloth.commands.options import Output
from flatcloth.commands.output import ProgressBar, refuse_full, report
from flatcloth.synthesis.request import Request

SUMMARY = "render a garment mesh to a recording with its truth"
EXAMPLES = """examples:
  flatcloth synthesize shirt.obj --out my-shirt
  flatcloth synthesize shirt.glb --out my-shirt --panel back --sensor d435 --seed 2
  flatcloth synthesize shirt.glb --out my-shirt --sensor stereo --sway 3 --twist 0.7 --exposure 8
  flatcloth synthesize scan.ply --out my-shirt --scale 0.001 --up y --held 12 840 -3 --texture floral"""


@dataclass(kw_only=True)
class Options(Output, Request):
    """The options of the command."""


def run(options: Options) -> None:
    """Render and write the recording, and print a summary."""
    from flatcloth.synthesis.recording import synthesize
    from flatcloth.validation.kit import printed_cloth, read_kit, write_kit

    refuse_full(options.out)
    texture = options.texture or ""
    kit = read_kit(Path(texture)) if isinstance(texture, str) and texture.endswith(".json") else None
    with ProgressBar(options.out.name) as bar:
        made = synthesize(replace(options, texture=printed_cloth(kit)) if kit else options, bar.show)
    if kit:
        write_kit(kit, options.out / "kit.json")
    sides = ", ".join(f"{i} {panel.name}" for i, panel in enumerate(made.panels, start=1))
    count = len(options.angles_deg)
    line = (
        f"{count} views written to {options.out}. "
        f"Panels: {sides}; side of interest: {made.panel_of_interest}."
    )
    document = {
        "folder": str(options.out),
        "views": count,
        "panels": [panel.name for panel in made.panels],
        "panel_of_interest": made.panel_of_interest,
        "notes": made.warnings,
    }
    report(options, document, [*(f"note: {warning}" for warning in made.warnings), line])
