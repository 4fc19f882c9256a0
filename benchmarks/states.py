"""Makes the recordings that calibrate and judge: of all meshes, both panels, each by both sensors.

``python -m benchmarks states --meshes MESHES/*.obj --keep DIR``; 28 meshes, two of them towels, give 108
recordings in an hour on two cores; those that the folder holds are not made again. With a stereo sensor the
item also sways. Seeds follow from the names.
"""

from __future__ import annotations

import shutil
from pathlib import Path
from zlib import crc32

from benchmarks.output import Options, say
from flatcloth.cli import main

SENSORS = {"d435": ("--sensor", "d435"), "stereo": ("--sensor", "stereo", "--sway", "2", "--twist", "0.5")}


def run(options: Options) -> None:
    """Make the recordings that the folder ``--keep`` lacks."""
    if not options.meshes or not options.keep:
        raise SystemExit(
            "states: --meshes OBJ ... names the meshes, --keep DIR the folder for the recordings."
        )
    for mesh in sorted(map(Path, options.meshes)):
        for panel in ("front", "back"):
            for sensor, words in SENSORS.items():
                made(mesh, Path(options.keep) / f"{mesh.stem}-{panel}-{sensor}", panel, words)


def made(mesh: Path, folder: Path, panel: str, sensor: tuple[str, ...]) -> None:
    """Make one recording, unless it is there."""
    if folder.exists():
        return
    part = folder.with_name(f"{folder.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    part.parent.mkdir(parents=True, exist_ok=True)
    seed = str(crc32(folder.name.encode()) % 1000)
    command = ["synthesize", str(mesh), "--out", str(part), "--name", folder.name, "--panel", panel]
    if main([*command, "--seed", seed, *sensor]):
        say(f"{folder.name} was not made: a towel has one panel.")
    else:
        part.rename(folder)
        say(folder.name)
