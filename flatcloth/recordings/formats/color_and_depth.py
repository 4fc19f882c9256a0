"""Folders with ``color/`` and ``depth/``, as Open3D uses them, and what all folders of images share."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from flatcloth.core.errors import RecordingError, os_errors_as
from flatcloth.recordings.base import Format, Recording
from flatcloth.recordings.files.images import turned_by_exif
from flatcloth.recordings.files.text import inside, one_line
from flatcloth.recordings.film.angles import Shots, left_out, notes_of
from flatcloth.recordings.film.recording import views_or_film
from flatcloth.recordings.folder import ImageRecording, ViewFiles
from flatcloth.recordings.formats.camera_file import read_camera
from flatcloth.recordings.formats.naming import in_order, partners, slots, without_partner
from flatcloth.recordings.options import SourceOptions

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
    refuses=("turning_deg", "sweep"),
)


def _files(folder: Path, images: Path, kinds: tuple[str, ...]) -> list[Path]:
    """Return the images of a folder in the order that their names say."""
    with os_errors_as(RecordingError, f"{images}: cannot be read", "Check its permissions."):
        names = [file for file in images.iterdir() if file.suffix.lower() in kinds]
    if not names:
        raise RecordingError(f"{images}: has no images ({', '.join(kinds)}). Export them there.")
    relative = [file.relative_to(folder).as_posix() for file in in_order(names)]
    return [inside(folder, name, images, "the image") for name in relative]


def recording_of(
    folder: Path,
    pairs: Sequence[tuple[Path, ...]],
    options: SourceOptions,
    *,
    description: str,
    units_per_m: float,
    times_s: Sequence[float] | None = None,
    angles_deg: Sequence[float] | None = None,
    colors: Sequence[Path] = (),
    notes: Sequence[str] = (),
    name: str = "",
) -> Recording:
    """Return the recording of a folder of images: views, or the stops of a film.

    Parameters
    ----------
    folder, pairs
        Color and depth images in the folder, in order of capture, each pair with a mask if it has one.
    options : SourceOptions
        The camera, and the angles if the format does not contain them (``angles_deg``).
    description, notes
        One sentence, and remarks for the operator.
    units_per_m : float
        Units of integer depth, if the camera's file does not say.
    times_s : sequence of float, optional
        When each pair was taken.
    colors : sequence of Path
        All color images, also those without partner.
    name : str
        By default the folder's.
    """
    names, every = (
        [color.relative_to(folder).as_posix() for color in some]
        for some in ([color for color, *_ in pairs], colors)
    )
    shots = Shots(
        source=str(folder),
        count=len(pairs),
        names=names,
        times_s=times_s,
        every=every or names,
        slots=slots([color.stem for color, *_ in pairs]),
    )

    def made(chosen: list[tuple[int, float]]) -> Recording:
        camera = read_camera(folder, pairs[0][0], pairs[0][1], options)
        kinds = ("color", "depth", "mask")
        views = tuple(
            ViewFiles(angle_deg=angle, **dict(zip(kinds, pairs[n], strict=False))) for n, angle in chosen
        )
        told = [*camera.notes, *notes, *turned_by_exif(pairs[0][0])]
        told += [*notes_of(options, folder), *left_out(shots, chosen)]
        return ImageRecording(
            name=one_line(name or folder.name) or "recording",
            location=str(folder),
            description=description,
            notes=tuple(told),
            intrinsics=camera.intrinsics,
            lens=camera.lens,
            depth_scale_m=1.0 / (camera.units_per_m or units_per_m),
            files=views,
            any_depth=True,
        )

    if angles_deg is not None:
        return made(list(enumerate(angles_deg)))
    return views_or_film(made, shots, options, folder)
