"""The command ``kit``: a coded fabric to print, or the places of stickers on a garment."""

from __future__ import annotations

import argparse
import re
from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import Literal

from flatcloth.commands.options import Output
from flatcloth.commands.output import report
from flatcloth.recordings.options import option

SUMMARY = "write a coded fabric or stickers to print, with which accuracy is measured"
EXAMPLES = """examples:
  flatcloth kit --out my-kit --size 1.2x0.8                         one sheet, in A4 pages and whole
  flatcloth kit --out my-kit --size 0.5x0.7 --sides 2               front and back of a sewn pillow case
  flatcloth kit --out my-kit --stickers 20                          stickers; then, from a photo of the
  flatcloth kit --out my-kit --from-photo flat.jpg                  garment lying flat, their places"""


def _size(text: str) -> tuple[float, float]:
    numbers = re.fullmatch(r"(\d{0,2}\.?\d{1,3})x(\d{0,2}\.?\d{1,3})", text)
    if numbers is None:
        raise argparse.ArgumentTypeError(f"{text}: give width and height in metres, as 1.2x0.8")
    return float(numbers[1]), float(numbers[2])


@dataclass(kw_only=True)
class Options(Output):
    """The options of the command."""

    out: Path = option("folder of the kit", "DIR", MISSING)
    size: tuple[float, float] | None = option(
        "a sheet in metres (default: 1.2x0.8, of stickers A4)", "WxH", read=_size
    )
    cell: float = option("marker and gap", "MM", 30.0)
    sides: Literal["1", "2"] = option("sheets", default="1")
    stickers: int | None = option("single markers instead of a fabric", "N")
    from_photo: Path | None = option(
        "measure the stickers of the kit in DIR by a photo of the garment lying flat", "FILE"
    )


def run(options: Options) -> None:
    """Write the files, and print what they hold."""
    from flatcloth.recordings.files.images import decode_color
    from flatcloth.validation.kit import grid_kit, read_kit, write_kit, write_pages
    from flatcloth.validation.markers import measured_kit

    written = ["kit.json"]
    if options.from_photo:
        kit = measured_kit(read_kit(options.out / "kit.json"), decode_color(options.from_photo))
        write_kit(kit, options.out / "kit.json")
    else:
        size_m = options.size or ((0.21, 0.27) if options.stickers else (1.2, 0.8))
        kit = grid_kit(size_m, options.cell / 1e3, int(options.sides), options.stickers)
        written = write_pages(kit, options.out)
    held = f"{kit.name}: {len(kit.corners_m)} markers."
    document = {"written": written, "markers": len(kit.corners_m)}
    report(options, document, [held, f"Written to {options.out}: {', '.join(written)}."])
