"""The common part of formats that are folders of color and depth images."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from flatcloth.recordings.base import Recording
from flatcloth.recordings.files.images import turned_by_exif
from flatcloth.recordings.files.text import one_line
from flatcloth.recordings.film.angles import Shots, left_out, notes_of
from flatcloth.recordings.film.recording import views_or_film
from flatcloth.recordings.folder import ImageRecording, ViewFiles
from flatcloth.recordings.formats.camera_file import read_camera
from flatcloth.recordings.formats.naming import slots
from flatcloth.recordings.options import SourceOptions


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
