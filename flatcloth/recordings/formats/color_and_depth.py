"""Folders with ``color/`` and ``depth/``, as Open3D uses them."""

from __future__ import annotations

from pathlib import Path

from flatcloth.core.errors import RecordingError, os_errors_as
from flatcloth.recordings.base import Recording
from flatcloth.recordings.files.text import inside
from flatcloth.recordings.formats.image_pairs import recording_of
from flatcloth.recordings.formats.naming import in_order, partners, without_partner
from flatcloth.recordings.options import SourceOptions
from flatcloth.recordings.source import Format

UNITS_PER_M = 1000.0
"""Default of the layout: millimetres, as Open3D's."""
_COLOR_FOLDERS = ("color", "rgb", "image", "images")
_MASK_FOLDERS = ("mask", "masks")
_COLOR_KINDS = (".png", ".jpg", ".jpeg")
_MASK_KINDS = (".png",)
_DEPTH_KINDS = (".png", ".tif", ".tiff", ".npy", ".pcd")


def is_color_and_depth(folder: Path) -> bool:
    """Return whether a folder contains ``color/`` and ``depth/``."""
    return (folder / "depth").is_dir() and any((folder / name).is_dir() for name in _COLOR_FOLDERS)


def open_color_and_depth(folder: Path, options: SourceOptions) -> Recording:
    """Open a folder in Open3D's layout: ``color/``, ``depth/``, ``intrinsic.json``, optionally ``mask/``."""
    options.refuse(str(folder), "turning_deg", "sweep")
    folder = folder.resolve()
    color_folder = next(folder / name for name in _COLOR_FOLDERS if (folder / name).is_dir())
    colors = _files(folder, color_folder, _COLOR_KINDS)
    depths = _files(folder, folder / "depth", _DEPTH_KINDS)
    depth_of = partners(colors, depths)
    notes = without_partner(colors, depth_of, depths)
    paired: list[tuple[Path, ...]] = [(colors[n], depths[other]) for n, other in depth_of.items()]
    masks = next((folder / name for name in _MASK_FOLDERS if (folder / name).is_dir()), None)
    if masks is not None:
        files = _files(folder, masks, _MASK_KINDS)
        taken = [color for color, _ in paired]
        found = partners(taken, files)
        notes += without_partner(taken, found, files)
        if len(found) < len(paired) / 2:
            cause = f"{masks}: has masks of less than half of the {len(paired)} views"
            raise RecordingError(f"{cause}. Add the others, or rename the folder.")
        paired = [(*paired[n], files[other]) for n, other in found.items()]
    return recording_of(
        folder,
        paired,
        options,
        colors=colors,
        notes=notes,
        units_per_m=UNITS_PER_M,
        description="folder of color and depth images",
    )


FORMAT = Format(
    name="color_and_depth",
    what="a folder with color/, depth/ and intrinsic.json",
    recognises=is_color_and_depth,
    open=open_color_and_depth,
)


def _files(folder: Path, images: Path, kinds: tuple[str, ...]) -> list[Path]:
    """Return the images of a folder in the order that their names say."""
    with os_errors_as(RecordingError, f"{images}: cannot be read", "Check its permissions."):
        names = [file for file in images.iterdir() if file.suffix.lower() in kinds]
    if not names:
        raise RecordingError(f"{images}: has no images ({', '.join(kinds)}). Export them there.")
    relative = [file.relative_to(folder).as_posix() for file in in_order(names)]
    return [inside(folder, name, images, "the image") for name in relative]
