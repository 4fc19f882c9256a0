"""Recordings of image files: a folder with ``recording.json`` (``flatcloth-recording/1``), or others."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from flatcloth.core.errors import RecordingError
from flatcloth.core.types import Bool, Float32, Float64, Intrinsics, RgbdFrame, RotationAxis
from flatcloth.recordings.base import check_index
from flatcloth.recordings.files import depth_files, images
from flatcloth.recordings.manifest import Manifest, ViewFiles, read_manifest


class ImageRecording:
    """Views in image files; opening checks everything but the pixels, which are checked when read.

    Parameters
    ----------
    manifest : Manifest
        The files, and the description of the recording.

    Raises
    ------
    RecordingError
        If an image is missing, unreadable, of the wrong kind or of another size than the camera's;
        the message names file, cause and remedy.

    Notes
    -----
    Opening reads the headers of all images (a few milliseconds for 36 views) and decodes none.
    Nothing is cached; the caller keeps the frames it needs.
    """

    def __init__(self, manifest: Manifest) -> None:
        self._manifest = manifest
        for view in manifest.views:
            self._check(view.color, images.check_color)
            self._check_depth(view.depth)
            if view.mask is not None:
                self._check(view.mask, images.check_mask)

    @property
    def name(self) -> str:
        """Short name, for titles and session folders."""
        return self._manifest.name

    @property
    def description(self) -> str:
        """One sentence of free text; may be empty."""
        return self._manifest.description

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks for the operator on how the recording was read."""
        return self._manifest.notes

    @property
    def location(self) -> str:
        """Absolute path of the folder."""
        return str(self._manifest.folder)

    @property
    def intrinsics(self) -> Intrinsics:
        """The camera, after correction of the lens distortion."""
        return self._manifest.intrinsics

    @property
    def rotation_axis(self) -> RotationAxis | None:
        """The turning axis in the camera frame; None if the recording does not give it."""
        return self._manifest.rotation_axis

    @property
    def held_point_m(self) -> Float64 | None:
        """The point (3,) where the item is held, camera frame; None if the recording does not give it."""
        return self._manifest.held_point_m

    @property
    def angles_deg(self) -> tuple[float, ...]:
        """Angle of each view about the axis since view 0."""
        return tuple(v.angle_deg for v in self._manifest.views)

    @property
    def has_masks(self) -> bool:
        """Whether the views have masks of the side of interest: all of them or none."""
        return self._manifest.views[0].mask is not None

    def __len__(self) -> int:
        """Return the number of views."""
        return len(self._manifest.views)

    def __getitem__(self, view_index: int) -> RgbdFrame:
        """Read one view, with lens distortion corrected.

        Raises
        ------
        IndexError
            If there is no such view; negative numbers do not count from the end.
        RecordingError
            If an image is damaged, has changed since opening, or has no depth.
        """
        check_index(self, view_index)
        view = self._manifest.views[view_index]
        self._check(view.color, images.check_color)
        color = self._manifest.lens.undistort(images.decode_color(view.color), blend=True)
        return RgbdFrame(
            view_index=view_index,
            angle_deg=view.angle_deg,
            color=color,
            depth_m=self._read_depth(view),
            mask=self._read_mask(view),
            intrinsics=self.intrinsics,
        )

    def _read_depth(self, view: ViewFiles) -> Float32:
        header = self._check_depth(view.depth)
        depth_m = depth_files.decode_depth_m(view.depth, header, self._manifest.depth_scale_m)
        depth_m = self._manifest.lens.undistort(depth_m, blend=False)
        if not depth_m.any():
            raise RecordingError(f"{view.depth}: no depth, every pixel is 0. Record the view again.")
        return depth_m

    def _read_mask(self, view: ViewFiles) -> Bool | None:
        if view.mask is None:
            return None
        self._check(view.mask, images.check_mask)
        values = self._manifest.lens.undistort(images.decode_raw(view.mask, np.uint8), blend=False)
        mask: Bool = values > 127
        if values.any() and not mask.any():
            raise RecordingError(
                f"{view.mask}: no pixel exceeds 127, the largest value is {values.max()}. "
                "Mark the side of interest with 255."
            )
        return mask  # all False if the side of interest is not visible in this view

    def _check(self, path: Path, check: Callable[[Path, images.ImageHeader], None]) -> None:
        header = images.read_header(path)
        check(path, header)
        images.check_size(path, header, self.intrinsics)

    def _check_depth(self, path: Path) -> images.ImageHeader:
        if self._manifest.any_depth:
            header = depth_files.read_depth_header(path)
        else:
            header = images.read_header(path)
            images.check_depth(path, header)
        images.check_size(path, header, self.intrinsics)
        return header


class FolderRecording(ImageRecording):
    """A recording folder, with its ``recording.json``.

    Parameters
    ----------
    folder : Path
        The folder that holds ``recording.json``.

    Raises
    ------
    RecordingError
        If ``recording.json`` is not valid, or any of its images is not.
    """

    def __init__(self, folder: Path) -> None:
        super().__init__(read_manifest(folder))
