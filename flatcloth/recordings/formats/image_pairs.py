"""The common part of formats that are folders of color and depth images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from flatcloth.recordings.base import Recording
from flatcloth.recordings.files.text import one_line
from flatcloth.recordings.film.angles import Shots, left_out
from flatcloth.recordings.folder import image_recording
from flatcloth.recordings.formats.camera_file import read_camera
from flatcloth.recordings.manifest import Manifest, ViewFiles
from flatcloth.recordings.source import SourceOptions


@dataclass(frozen=True, kw_only=True)
class ImagePairs:
    """Pairs of color and depth images of a folder, in order of capture.

    ``masks`` (one per pair) and ``times_s`` may be missing; ``units_per_m`` is that of integer depth.
    ``angles_deg`` are set if the format contains them, otherwise the options give them. ``name`` is the
    name of the recording, by default the folder's.
    """

    folder: Path
    pairs: Sequence[tuple[Path, Path]]
    description: str
    units_per_m: float
    masks: Sequence[Path] | None = None
    times_s: Sequence[float] | None = None
    angles_deg: Sequence[float] | None = None
    name: str = ""


def recording_of(images: ImagePairs, options: SourceOptions) -> Recording:
    """Return the recording of a set of images: views, or the stops of a film.

    Raises
    ------
    RecordingError
        If an image or the camera is not valid, or the angles are unknown.
    """
    from flatcloth.recordings.film.recording import views_or_film

    folder, pairs = images.folder, images.pairs
    names = [color.relative_to(folder).as_posix() for color, _ in pairs]
    shots = Shots(source=str(folder), count=len(pairs), names=names, times_s=images.times_s)

    def made(chosen: list[tuple[int, float]]) -> Recording:
        camera = read_camera(folder, *pairs[0], options)
        views = tuple(
            ViewFiles(
                angle_deg=angle,
                color=pairs[n][0],
                depth=pairs[n][1],
                mask=None if images.masks is None else images.masks[n],
                truth=None,
            )
            for n, angle in chosen
        )
        return image_recording(
            Manifest(
                folder=folder,
                name=one_line(images.name or folder.name) or "recording",
                description=images.description,
                notes=(*camera.notes, *left_out(shots, chosen)),
                intrinsics=camera.intrinsics,
                lens=camera.lens,
                depth_scale_m=1.0 / (camera.units_per_m or images.units_per_m),
                rotation_axis=None,
                held_point_m=None,
                views=views,
                any_depth=True,
            )
        )

    if images.angles_deg is not None:
        return made(list(enumerate(images.angles_deg)))
    return views_or_film(made, shots, options.given_angles, folder)
