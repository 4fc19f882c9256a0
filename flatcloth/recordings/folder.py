"""Recordings of image files: a folder with ``recording.json`` (``flatcloth-recording/1``), or others."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flatcloth.core.errors import RecordingError
from flatcloth.core.types import Bool
from flatcloth.recordings.base import Recording, ViewImages
from flatcloth.recordings.files import depth_files, images
from flatcloth.recordings.files.depth_files import read_pcd
from flatcloth.recordings.manifest import HEADER, Manifest, ViewFiles, read_manifest
from flatcloth.recordings.source import Format, SourceOptions


def open_folder(folder: Path) -> Recording:
    """Open a recording folder, with its ``recording.json``."""
    return image_recording(read_manifest(folder))


def _open(path: Path, options: SourceOptions) -> Recording:
    options.refuse(str(path), "angles", "step_deg", "camera_file", "fov_deg", "turning_deg", "sweep")
    return open_folder(path)


def _folders_below(path: Path) -> list[Path]:
    is_one = (path / HEADER).exists()
    return [] if is_one else sorted(header.parent for header in path.glob(f"*/{HEADER}"))


FORMAT = Format(
    name="flatcloth",
    what=f"a recording folder (containing {HEADER})",
    recognises=lambda path: (path / HEADER).exists(),
    open=_open,
    recordings_below=_folders_below,
)


def image_recording(manifest: Manifest) -> Recording:
    """Return the recording of image files; the pixels are checked when a view is read, all else at once.

    Raises
    ------
    RecordingError
        If an image is missing, unreadable, of the wrong kind or of another size than the camera's;
        the message names file, cause and remedy.

    Notes
    -----
    Reads the headers of all images (a few milliseconds for 36 views) and decodes none.
    """
    for view in manifest.views:
        _checked(manifest, view)
    return Recording(
        name=manifest.name,
        description=manifest.description,
        notes=manifest.notes,
        location=str(manifest.folder),
        intrinsics=manifest.intrinsics,
        rotation_axis=manifest.rotation_axis,
        held_point_m=manifest.held_point_m,
        angles_deg=tuple(view.angle_deg for view in manifest.views),
        has_masks=manifest.views[0].mask is not None,
        read=lambda n: _read(manifest, manifest.views[n]),  # checks its files again
    )


OTHER_SIDE = 128
"""Value of the other side in a mask that names both sides. By definition."""


def _read(manifest: Manifest, view: ViewFiles) -> ViewImages:
    header, undistort = _checked(manifest, view), manifest.lens.undistort
    if view.is_cloud:
        cloud = read_pcd(view.depth)
        color, depth_m = cloud.rgb, cloud.depth_m
    else:
        color = images.decode_color(view.color)
        depth_m = depth_files.decode_depth_m(view.depth, header, manifest.depth_scale_m)
    depth_m = undistort(depth_m, blend=False)
    if color is None or not depth_m.any():
        what = "color" if color is None else "depth, every pixel is 0"
        raise RecordingError(f"{view.depth}: no {what}. Record the view again.")
    return ViewImages(undistort(color, blend=True), depth_m, *_masks(manifest, view.mask))


def _masks(manifest: Manifest, path: Path | None) -> tuple[Bool | None, Bool | None]:
    """Return the masks of this side and of the other; the second is None unless the file names both."""
    if path is None:
        return None, None
    values = manifest.lens.undistort(images.decode_raw(path, np.uint8), blend=False)
    other = values == OTHER_SIDE
    names_both = other.any() and (other | (values == 0) | (values == 255)).all()
    mask: Bool = values > (OTHER_SIDE if names_both else 127)
    if values.any() and not (mask.any() or names_both):
        raise RecordingError(
            f"{path}: no pixel exceeds 127, the largest value is {values.max()}. "
            "Mark the side of interest with 255."
        )
    # All False if the side of interest is not visible in this view.
    return mask, other if names_both else None


def _checked(manifest: Manifest, view: ViewFiles) -> images.ImageHeader:
    """Check the headers of a view's files, and return that of its depth."""
    if not view.is_cloud:
        images.read_checked(view.color, "color", manifest.intrinsics)
    if view.mask is not None:
        images.read_checked(view.mask, "mask", manifest.intrinsics)
    if not manifest.any_depth:
        return images.read_checked(view.depth, "depth", manifest.intrinsics)
    header = depth_files.read_depth_header(view.depth)
    images.check_size(view.depth, header, manifest.intrinsics)
    return header
