"""Folders of other programs: TUM RGB-D lists, and ``color/`` and ``depth/`` as Open3D has them."""

from __future__ import annotations

import re
from pathlib import Path

from flatcloth.core.errors import RecordingError
from flatcloth.recordings.base import Recording
from flatcloth.recordings.files.paths import inside, read_text
from flatcloth.recordings.files.text import one_line, shortened
from flatcloth.recordings.film.angles import GivenAngles, Shots, left_out
from flatcloth.recordings.film.pairing import pair_by_time
from flatcloth.recordings.folder import ImageRecording
from flatcloth.recordings.formats.camera_file import Camera, read_camera
from flatcloth.recordings.manifest import Manifest, ViewFiles

TUM_UNITS_PER_M = 5000.0
OPEN3D_UNITS_PER_M = 1000.0
_ASSOCIATIONS = ("associations.txt", "associated.txt", "association.txt", "associate.txt")
_MOST_APART_S = 0.02  # as TUM's own tool
_COLOR_FOLDERS = ("color", "rgb", "image", "images")
_MASK_FOLDERS = ("mask", "masks")
_COLOR_KINDS = (".png", ".jpg", ".jpeg")
_DEPTH_KINDS = (".png", ".tif", ".tiff", ".exr", ".npy")


def is_tum(folder: Path) -> bool:
    """Say whether a folder has the lists of the TUM RGB-D format."""
    lists = all((folder / name).is_file() for name in ("rgb.txt", "depth.txt"))
    return lists or any((folder / name).is_file() for name in _ASSOCIATIONS)


def open_tum(folder: Path, angles: GivenAngles) -> Recording:
    """Open a TUM RGB-D folder: ``associations.txt``, or ``rgb.txt`` and ``depth.txt``; 5000 units per metre.

    Raises
    ------
    RecordingError
        If a list or an image is not valid, or there are no angles.
    """
    folder = folder.resolve()
    listed = next((folder / name for name in _ASSOCIATIONS if (folder / name).is_file()), None)
    pairs = _paired_lists(folder) if listed is None else _associations(folder, listed)
    return _recording(
        folder,
        pairs=[(color, depth) for _, color, depth in pairs],
        times_s=[time for time, _, _ in pairs],
        angles=angles,
        units_per_m=TUM_UNITS_PER_M,
        description="TUM RGB-D folder",
    )


def is_color_and_depth(folder: Path) -> bool:
    """Say whether a folder has ``color/`` and ``depth/`` in it."""
    return (folder / "depth").is_dir() and any((folder / name).is_dir() for name in _COLOR_FOLDERS)


def open_color_and_depth(folder: Path, angles: GivenAngles) -> Recording:
    """Open a folder as Open3D has it: ``color/``, ``depth/``, ``intrinsic.json``, and ``mask/`` if wanted.

    Raises
    ------
    RecordingError
        If the images do not pair, one of them is not valid, or there are no angles.
    """
    folder = folder.resolve()
    color_folder = next(folder / name for name in _COLOR_FOLDERS if (folder / name).is_dir())
    colors = _files(folder, color_folder, _COLOR_KINDS)
    depths = _files(folder, folder / "depth", _DEPTH_KINDS)
    return _recording(
        folder,
        pairs=_paired_names(colors, depths, color_folder, folder / "depth"),
        times_s=None,
        angles=angles,
        units_per_m=OPEN3D_UNITS_PER_M,
        description="folder of color and depth images",
    )


def _recording(
    folder: Path,
    *,
    pairs: list[tuple[Path, Path]],
    times_s: list[float] | None,
    angles: GivenAngles,
    units_per_m: float,
    description: str,
) -> Recording:
    names = [color.relative_to(folder).as_posix() for color, _ in pairs]
    shots = Shots(source=str(folder), count=len(pairs), names=names, times_s=times_s)

    def made(chosen: list[tuple[int, float]]) -> Recording:
        camera = read_camera(folder, pairs[0][0])
        masks = _masks(folder, [pairs[n][0] for n, _ in chosen])
        views = tuple(
            ViewFiles(
                angle_deg=angle,
                color=pairs[n][0],
                depth=pairs[n][1],
                mask=None if masks is None else masks[i],
                truth=None,
            )
            for i, (n, angle) in enumerate(chosen)
        )
        return ImageRecording(
            Manifest(
                folder=folder,
                name=one_line(folder.name) or "recording",
                description=description,
                notes=(*_assumed(camera), *left_out(shots, chosen)),
                intrinsics=camera.intrinsics,
                lens=camera.lens,
                depth_scale_m=1.0 / (camera.units_per_m or units_per_m),
                rotation_axis=None,
                held_point_m=None,
                views=views,
                any_depth=True,
            )
        )

    from flatcloth.recordings.film.recording import views_or_film

    return views_or_film(made, shots, angles, folder)


def _assumed(camera: Camera) -> tuple[str, ...]:
    if not camera.assumed:
        return ()
    return (
        "The camera of this recording is not described; it is taken for a Kinect's, with a focal length of "
        f"{camera.intrinsics.fx:g} px. Put an intrinsic.json into the folder.",
    )


# --- TUM RGB-D -------------------------------------------------------------------------------


def _rows(path: Path, columns: int) -> list[tuple[int, list[str]]]:
    lines = [(n, line.strip()) for n, line in enumerate(read_text(path).splitlines(), start=1)]
    rows = [(n, line.replace(",", " ").split()) for n, line in lines if line and not line.startswith("#")]
    for n, row in rows:
        if len(row) < columns:
            raise RecordingError(
                f"{path}: line {n} has {len(row)} columns. Expected a time, a file name, ..."
            )
    if not rows:
        raise RecordingError(f"{path}: lists no images. Record at least one.")
    return rows


def _time(path: Path, line: int, text: str) -> float:
    if not re.fullmatch(r"[+-]?[0-9]+(\.[0-9]*)?([eE][+-]?[0-9]+)?", text):
        raise RecordingError(f"{path}: line {line} has the time {shortened(text)}. Expected seconds.")
    return float(text)


def _associations(folder: Path, path: Path) -> list[tuple[float, Path, Path]]:
    pairs = []
    for n, row in _rows(path, 4):
        (time_a, a), (time_b, b) = (row[0], row[1]), (row[2], row[3])
        if "depth" in a.lower() and "depth" not in b.lower():  # some programs list depth first
            (time_a, a), (_, b) = (time_b, b), (time_a, a)
        where = f"line {n}"
        pairs.append((_time(path, n, time_a), inside(folder, a, path, where), inside(folder, b, path, where)))
    return pairs


def _listed(folder: Path, path: Path) -> list[tuple[float, Path]]:
    rows = _rows(path, 2)
    return [(_time(path, n, row[0]), inside(folder, row[1], path, f"line {n}")) for n, row in rows]


def _paired_lists(folder: Path) -> list[tuple[float, Path, Path]]:
    colors, depths = (_listed(folder, folder / name) for name in ("rgb.txt", "depth.txt"))
    pairs = pair_by_time([t for t, _ in colors], [t for t, _ in depths], _MOST_APART_S)
    if not pairs:
        raise RecordingError(
            f"{folder}: no color image was taken within {_MOST_APART_S:g} s of a depth image. "
            "Say in associations.txt which belong together."
        )
    return [(colors[i][0], colors[i][1], depths[j][1]) for i, j in pairs]


# --- color/ and depth/ -----------------------------------------------------------------------


def _files(folder: Path, images: Path, kinds: tuple[str, ...]) -> list[Path]:
    """Return the images of a folder as people count: 2 before 10."""

    def counted(path: Path) -> list[tuple[int, str]]:
        return [
            (int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"([0-9]+)", path.name)
        ]

    try:
        names = [file for file in images.iterdir() if file.suffix.lower() in kinds]
    except OSError as error:
        raise RecordingError(
            f"{images}: cannot be read ({error.strerror}). Check its permissions."
        ) from error
    if not names:
        raise RecordingError(f"{images}: has no images ({', '.join(kinds)}). Export them there.")
    relative = [file.relative_to(folder).as_posix() for file in sorted(names, key=counted)]
    return [inside(folder, name, images, "the image") for name in relative]


def _paired_names(
    colors: list[Path], depths: list[Path], color_folder: Path, depth_folder: Path
) -> list[tuple[Path, Path]]:
    """Pair the images by their names, or else by their order if there are as many of both."""
    by_name = {depth.stem: depth for depth in depths}
    if len(by_name) < len(depths):
        raise RecordingError(f"{depth_folder}: has one image in two kinds of file. Remove one of them.")
    if len({color.stem for color in colors}) < len(colors):
        raise RecordingError(f"{color_folder}: has one image in two kinds of file. Remove one of them.")
    named = [(color, by_name[color.stem]) for color in colors if color.stem in by_name]
    if len(named) == len(colors):
        return named
    if len(colors) != len(depths):
        raise RecordingError(
            f"{color_folder}: has {len(colors)} images, but {depth_folder.name} has {len(depths)}, of other "
            "names. Give images that belong together one name."
        )
    return list(zip(colors, depths, strict=True))


def _masks(folder: Path, colors: list[Path]) -> list[Path] | None:
    masks = next((folder / name for name in _MASK_FOLDERS if (folder / name).is_dir()), None)
    if masks is None:
        return None
    return [inside(folder, f"{masks.name}/{color.stem}.png", masks, "the mask") for color in colors]
