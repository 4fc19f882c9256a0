"""Folders with ``color/`` and ``depth/``, as Open3D uses them."""

from __future__ import annotations

import re
from pathlib import Path

from flatcloth.core.errors import RecordingError, os_errors_as
from flatcloth.recordings.base import Recording
from flatcloth.recordings.files.text import inside
from flatcloth.recordings.formats.image_pairs import ImagePairs, recording_of
from flatcloth.recordings.source import Format, SourceOptions

UNITS_PER_M = 1000.0
"""Default of the layout: millimetres, as Open3D's."""
_COLOR_FOLDERS = ("color", "rgb", "image", "images")
_MASK_FOLDERS = ("mask", "masks")
_COLOR_KINDS = (".png", ".jpg", ".jpeg")
_DEPTH_KINDS = (".png", ".tif", ".tiff", ".exr", ".npy", ".pcd")


def is_color_and_depth(folder: Path) -> bool:
    """Return whether a folder contains ``color/`` and ``depth/``."""
    return (folder / "depth").is_dir() and any((folder / name).is_dir() for name in _COLOR_FOLDERS)


def open_color_and_depth(folder: Path, options: SourceOptions) -> Recording:
    """Open a folder in Open3D's layout: ``color/``, ``depth/``, ``intrinsic.json``, optionally ``mask/``.

    Raises
    ------
    RecordingError
        If the images do not pair, one of them is not valid, or there are no angles.
    """
    options.refuse(str(folder), "turning_deg", "sweep")
    folder = folder.resolve()
    color_folder = next(folder / name for name in _COLOR_FOLDERS if (folder / name).is_dir())
    colors = _files(folder, color_folder, _COLOR_KINDS)
    depths = _files(folder, folder / "depth", _DEPTH_KINDS)
    images = ImagePairs(
        folder=folder,
        pairs=_paired_names(colors, depths, color_folder, folder / "depth"),
        masks=_masks(folder, colors),
        units_per_m=UNITS_PER_M,
        description="folder of color and depth images",
    )
    return recording_of(images, options)


FORMAT = Format(
    name="color_and_depth",
    what="a folder with color/, depth/ and intrinsic.json",
    recognises=is_color_and_depth,
    open=open_color_and_depth,
)


def _files(folder: Path, images: Path, kinds: tuple[str, ...]) -> list[Path]:
    """Return the images of a folder in numerical order: 2 before 10."""

    def counted(path: Path) -> list[tuple[int, str]]:
        return [
            (int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"([0-9]+)", path.name)
        ]

    with os_errors_as(RecordingError, f"{images}: cannot be read", "Check its permissions."):
        names = [file for file in images.iterdir() if file.suffix.lower() in kinds]
    if not names:
        raise RecordingError(f"{images}: has no images ({', '.join(kinds)}). Export them there.")
    relative = [file.relative_to(folder).as_posix() for file in sorted(names, key=counted)]
    return [inside(folder, name, images, "the image") for name in relative]


def _paired_names(
    colors: list[Path], depths: list[Path], color_folder: Path, depth_folder: Path
) -> list[tuple[Path, Path]]:
    """Pair the images by their names, otherwise by their order if their numbers are equal."""
    by_name = {depth.stem: depth for depth in depths}
    if len(by_name) < len(depths):
        raise RecordingError(f"{depth_folder}: has one image in two file formats. Remove one of them.")
    if len({color.stem for color in colors}) < len(colors):
        raise RecordingError(f"{color_folder}: has one image in two file formats. Remove one of them.")
    named = [(color, by_name[color.stem]) for color in colors if color.stem in by_name]
    if len(named) == len(colors):
        return named
    if len(colors) != len(depths):
        raise RecordingError(
            f"{color_folder}: has {len(colors)} images, but {depth_folder.name} has {len(depths)}, "
            "with other names. Give each pair the same name."
        )
    return list(zip(colors, depths, strict=True))


def _masks(folder: Path, colors: list[Path]) -> list[Path] | None:
    masks = next((folder / name for name in _MASK_FOLDERS if (folder / name).is_dir()), None)
    if masks is None:
        return None
    return [inside(folder, f"{masks.name}/{color.stem}.png", masks, "the mask") for color in colors]
