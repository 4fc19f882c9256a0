"""MultimodalClothes (TAMS): garments held by a robot hand and turned forth and back before an RGB-D camera.

Its layout is ``<class>/<sample>/<area>/<name>_<NN>_rgb.png, ..._depth.png, ..._pc.pcd``, with folder names
of two digits. An area, i.e. a place where the garment was held, is one recording of 50 images: 25 while it
turned forth and 25 while it turned back. The data set contains neither camera nor angles. Therefore:

- an organised cloud with colors gives color, depth and camera, all of the same pixels; without clouds, color
  and depth must be registered images of one size, and the user gives the camera;
- the images of a sweep are assumed to be evenly spaced over the turning range, which the user gives; the
  sweep back passes the same angles, so only one of the two is read.
"""

from __future__ import annotations

import re
from pathlib import Path

from flatcloth.core.errors import RecordingError
from flatcloth.recordings.base import Format, Recording
from flatcloth.recordings.files.depth_files import read_pcd
from flatcloth.recordings.files.images import read_header
from flatcloth.recordings.film.angles import ANGLES_FILE
from flatcloth.recordings.formats.camera_file import camera_files
from flatcloth.recordings.formats.color_and_depth import recording_of
from flatcloth.recordings.options import OPTION_NAMES, SourceOptions

UNITS_PER_M = 1000.0
"""Depth of the data set: millimetres."""
IMAGES_OF_A_SWEEP = 25
"""The data set's public loader splits its 50 images in this way."""
_COLOR = re.compile(r"(?P<name>.+)_(?P<number>[0-9]{2})_rgb\.png")
_TWO_DIGITS = re.compile(r"[0-9]{2}")
_LEVELS = 3
"""Class, sample, area."""
_LEAST_TURN_DEG, _MOST_TURN_DEG = 1.0, 720.0
"""Range of the angle between the first and the last image. Chosen: two turns at most."""


def is_area(path: Path) -> bool:
    """Return whether a folder contains the images of one area."""
    try:
        return path.is_dir() and any(
            _COLOR.fullmatch(file.name)
            and any(_beside(file, ending).exists() for ending in ("depth.png", "pc.pcd"))
            for file in path.glob("*_[0-9][0-9]_rgb.png")
        )
    except OSError:
        return False


def areas_below(path: Path) -> list[Path]:
    """Return the areas of the data set, of a class or of a sample; none for any other folder."""
    for levels in range(_LEVELS, 0, -1):
        found = [
            folder
            for folder in sorted(path.glob("/".join(["[0-9][0-9]"] * levels)))
            if all(_TWO_DIGITS.fullmatch(part) for part in folder.parts[-levels:]) and is_area(folder)
        ]
        if found:
            return found
    return []


def open_area(folder: Path, options: SourceOptions) -> Recording:
    """Open an area; its angles come from ``turning_deg`` and ``sweep``, or from a table."""
    folder = folder.resolve()
    colors, angles_deg = _sweep(folder, options)
    clouds = [_beside(color, "pc.pcd") for color in colors]
    if all(map(Path.is_file, clouds)) and read_pcd(clouds[0]).rgb is not None:
        kind, pairs = "organised clouds", [(cloud, cloud) for cloud in clouds]
    else:
        kind, pairs = "color and depth images", [(color, _beside(color, "depth.png")) for color in colors]
        one, other = map(read_header, pairs[0])
        if (one.width, one.height) != (other.width, other.height):
            raise RecordingError(
                f"{folder}: color has {one.width}x{one.height} px, depth {other.width}x{other.height}: they "
                "are not registered. Put the organised clouds (..._pc.pcd, with colors) next to them."
            )
        if options.camera_file is None and options.fov_deg is None and not camera_files(folder):
            raise RecordingError(
                f"{folder}: the data set does not describe its camera. Give --camera-file, or --fov."
            )
    return recording_of(
        folder,
        pairs,
        options,
        name="-".join(filter(_TWO_DIGITS.fullmatch, folder.parts[-_LEVELS:])) or folder.name,
        angles_deg=angles_deg,
        units_per_m=UNITS_PER_M,
        description=f"MultimodalClothes, {kind}",
    )


FORMAT = Format(
    name="multimodal_clothes",
    what="an area of MultimodalClothes (<name>_<NN>_rgb.png, ..._depth.png, ..._pc.pcd)",
    recognises=is_area,
    open=open_area,
    recordings_below=areas_below,
)


def _beside(color: Path, ending: str) -> Path:
    return color.with_name(f"{color.name.removesuffix('_rgb.png')}_{ending}")


# --- angles ----------------------------------------------------------------------------------


def _sweep(folder: Path, options: SourceOptions) -> tuple[list[Path], list[float] | None]:
    """Return the color images of the selected sweep, in order, and their angles if its range is given."""
    found = {
        int(match["number"]): (match["name"], folder / match.string)
        for file in folder.iterdir()
        if (match := _COLOR.fullmatch(file.name))
    }
    names = sorted({name for name, _ in found.values()})
    if len(names) != 1:
        raise RecordingError(
            f"{folder}: has the images of {len(names)} recordings ({', '.join(names[:3])}). "
            "Put each into a folder of its own."
        )
    back = options.sweep == "back"
    numbers = [n for n in sorted(found) if (n >= IMAGES_OF_A_SWEEP) == back]
    if not numbers:
        raise RecordingError(f"{folder}: has no images of the sweep {'back' if back else 'forth'}.")
    colors = [found[n][1] for n in numbers]
    if options.turning_deg is None:
        if options.angles is None and options.step_deg is None and not (folder / ANGLES_FILE).is_file():
            raise RecordingError(
                f"{folder}: the data set does not contain its angles. Give --turning DEG, the angle between "
                "the first and the last image of a sweep, or --angles FILE.csv."
            )
        return colors, None
    for name in ("angles", "step_deg"):
        if getattr(options, name) is not None:
            pair = f"{OPTION_NAMES['turning_deg']} given together with {OPTION_NAMES[name]}"
            raise RecordingError(f"{pair}. Give only one of them.")
    turning = options.turning_deg
    if not _LEAST_TURN_DEG <= abs(turning) <= _MOST_TURN_DEG:
        raise RecordingError(f"--turning {turning:g}: give the range in degrees, 1 to 720 or negative.")
    step = (-1.0 if back else 1.0) * turning / (IMAGES_OF_A_SWEEP - 1)
    # Images after a full turn repeat earlier angles.
    kept = [(n, c) for n, c in zip(numbers, colors, strict=True) if abs((n - numbers[0]) * step) < 359.99]
    return [c for _, c in kept], [(n - numbers[0]) * step for n, _ in kept]
