"""The common part of formats that are folders of color and depth images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from flatcloth.recordings.base import Recording
from flatcloth.recordings.files.images import turned_by_exif
from flatcloth.recordings.files.text import one_line
from flatcloth.recordings.film.angles import Shots, left_out
from flatcloth.recordings.film.recording import views_or_film
from flatcloth.recordings.folder import image_recording
from flatcloth.recordings.formats.camera_file import read_camera
from flatcloth.recordings.formats.naming import slots
from flatcloth.recordings.manifest import Manifest, ViewFiles
from flatcloth.recordings.source import SourceOptions


@dataclass(frozen=True, kw_only=True)
class ImagePairs:
    """Pairs of color and depth images of a folder, in order of capture, each with a mask if it has one.

    ``times_s`` may be missing; ``units_per_m`` is that of integer depth.
    ``colors`` are all color images, also those without partner; ``notes`` are remarks for the operator.
    ``angles_deg`` are set if the format contains them, otherwise the options give them. ``name`` is the
    name of the recording, by default the folder's.
    """

    folder: Path
    pairs: Sequence[tuple[Path, ...]]
    description: str
    units_per_m: float
    times_s: Sequence[float] | None = None
    angles_deg: Sequence[float] | None = None
    colors: Sequence[Path] = ()
    notes: Sequence[str] = ()
    name: str = ""


def recording_of(images: ImagePairs, options: SourceOptions) -> Recording:
    """Return the recording of a set of images: views, or the stops of a film.

    Raises
    ------
    RecordingError
        If an image or the camera is not valid, or the angles are unknown.
    """
    folder, pairs = images.folder, images.pairs
    names, every = (
        [color.relative_to(folder).as_posix() for color in colors]
        for colors in ([color for color, *_ in pairs], images.colors)
    )
    shots = Shots(
        source=str(folder),
        count=len(pairs),
        names=names,
        times_s=images.times_s,
        every=every or names,
        slots=slots([color.stem for color, *_ in pairs]),
    )

    def made(chosen: list[tuple[int, float]]) -> Recording:
        camera = read_camera(folder, pairs[0][0], pairs[0][1], options)
        kinds = ("color", "depth", "mask")
        views = tuple(
            ViewFiles(angle_deg=angle, **dict(zip(kinds, pairs[n], strict=False))) for n, angle in chosen
        )
        return image_recording(
            Manifest(
                folder=folder,
                name=one_line(images.name or folder.name) or "recording",
                description=images.description,
                notes=(
                    *camera.notes,
                    *images.notes,
                    *turned_by_exif(pairs[0][0]),
                    *options.given_angles.notes(folder),
                    *left_out(shots, chosen),
                ),
                intrinsics=camera.intrinsics,
                lens=camera.lens,
                depth_scale_m=1.0 / (camera.units_per_m or images.units_per_m),
                views=views,
                any_depth=True,
            )
        )

    if images.angles_deg is not None:
        return made(list(enumerate(images.angles_deg)))
    return views_or_film(made, shots, options.given_angles, folder)
