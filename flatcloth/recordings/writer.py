"""Writes a recording folder (``flatcloth-recording/1``) view by view, safe against crashes.

A view is part of the recording when ``recording.json`` lists it. Its images are on disk by then, and
the header is replaced atomically. Images left over from a crash are overwritten on resuming.
"""

from __future__ import annotations

import fcntl
import itertools
import json
import math
import os
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flatcloth.core.decoding import fitted, parse_json
from flatcloth.core.errors import RecordingError, os_errors_as
from flatcloth.core.plain_files import read_plain, replace_file, sync_folder
from flatcloth.core.types import Bool, Float32, Intrinsics, Progress, RotationAxis, Uint8, no_progress
from flatcloth.recordings.base import Recording, check_distinct
from flatcloth.recordings.folder import HEADER, HEADER_FORMAT, OTHER_SIDE, RecordingHeader, open_folder

Uint16 = NDArray[np.uint16]

_SAME_CAMERA_PX = 1e-3
"""Intrinsics that differ by less are the same. Chosen: rounding of a file."""


class RecordingWriter:
    """Creates or resumes a recording folder; a context manager.

    Parameters
    ----------
    folder : Path
        Created if missing. It must be empty, or contain a recording if ``resume`` is set.
    name, description : str
        A title of a few words, and a sentence.
    intrinsics : Intrinsics
        Camera of the images, which are registered and free of distortion.
    depth_scale_m : float
        Metres per unit of the depth images.
    rotation_axis : RotationAxis, optional
        Camera frame; without it readers estimate the axis.
    held_point_m : array (3,), optional
        Where the item is held, camera frame.
    truth_header : dict, optional
        ``garment``, ``held_at``, ``panel_of_interest`` of a synthetic recording.
    resume : bool
        Append to the existing recording and keep its header.

    Raises
    ------
    RecordingError
        If the folder is not empty (or, on resuming, holds something else or a recording of another
        camera), is being written by another process, or cannot be written.

    Notes
    -----
    A view of 480x848 px takes about 60 ms. Not thread-safe.
    """

    def __init__(
        self,
        folder: str | os.PathLike[str],
        *,
        name: str,
        intrinsics: Intrinsics,
        depth_scale_m: float,
        description: str = "",
        rotation_axis: RotationAxis | None = None,
        held_point_m: Any = None,
        truth_header: dict[str, Any] | None = None,
        resume: bool = False,
    ) -> None:
        self.folder = Path(folder)
        self._intrinsics = intrinsics
        self._header: dict[str, Any] = {
            "format": HEADER_FORMAT,
            "name": name,
            "description": description,
            "intrinsics": {**asdict(intrinsics), "distortion_model": "none", "distortion": []},
            "depth_scale_m": depth_scale_m,
        }
        if rotation_axis is not None:
            self._header["rotation_axis"] = {
                "point_m": np.asarray(rotation_axis.point_m, dtype=float).tolist(),
                "direction": np.asarray(rotation_axis.direction, dtype=float).tolist(),
            }
        if held_point_m is not None:
            self._header["held_point_m"] = np.asarray(held_point_m, dtype=float).tolist()
        if truth_header is not None:
            self._header["truth"] = truth_header
        self._views: list[dict[str, Any]] = []
        self._lock_fd: int | None = None
        try:
            with os_errors_as(RecordingError, f"{folder}: cannot be written", "Choose a writable folder."):
                self._open(resume)
        except BaseException:
            self.close()
            raise

    def __len__(self) -> int:
        """Return the number of views that are on disk."""
        return len(self._views)

    def __enter__(self) -> RecordingWriter:
        """Return the writer itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Release the folder."""
        self.close()

    @property
    def angles_deg(self) -> tuple[float, ...]:
        """Angles of the views that are on disk."""
        return tuple(float(view["angle_deg"]) for view in self._views)

    def add(
        self,
        angle_deg: float,
        color_rgb: Uint8,
        depth_units: Uint16,
        mask: Bool | Uint8 | None = None,
        truth_bgr: Uint16 | None = None,
    ) -> int:
        """Write one view and return its number; it is then safe against a crash.

        Parameters
        ----------
        angle_deg : float
            About the axis (right-hand rule), since view 0.
        color_rgb : array (H, W, 3) uint8
            RGB.
        depth_units : array (H, W) uint16
            In units of ``depth_scale_m``; 0 where nothing was measured.
        mask : array (H, W) bool or uint8, optional
            True or 255 on the side of interest. All views have one, or none.
        truth_bgr : array (H, W, 3) uint16, optional
            As the format describes, channels B, G, R. All views have one, or none.

        Raises
        ------
        RecordingError
            If the angle exists already, an image has the wrong shape or type or no depth, or the
            view cannot be written; the recording then stays unchanged.
        """
        index = len(self._views)
        if mask is not None:
            mask = np.where(mask, 255, 0).astype(np.uint8) if np.asarray(mask).dtype == np.bool_ else mask
        given = {"color": color_rgb, "depth": depth_units, "mask": mask, "truth": truth_bgr}
        images = self._checked(angle_deg, {kind: np.asarray(g) for kind, g in given.items() if g is not None})
        images["color"] = images["color"][..., ::-1]
        view: dict[str, Any] = {"angle_deg": round(float(angle_deg), 6) + 0.0}
        # A recording that was edited by hand may use any file name for any view.
        used = {Path(str(file)).stem for view in self._views for file in view.values()}
        stem = next(stem for n in itertools.count(index) if (stem := f"{n:03d}") not in used)
        with os_errors_as(
            RecordingError,
            f"{self.folder}: view {index} cannot be written",
            "Earlier views are saved; free disk space and repeat it.",
        ):
            for kind, pixels in images.items():
                view[kind] = f"{kind}/{stem}.png"
                if not (self.folder / kind).is_dir():
                    (self.folder / kind).mkdir()
                    sync_folder(self.folder)
                replace_file(self.folder / view[kind], _png(pixels))
            self._write_header([*self._views, view])
        self._views.append(view)
        return index

    def close(self) -> None:
        """Release the folder for other processes; may be called repeatedly."""
        if self._lock_fd is not None:
            os.close(self._lock_fd)
            self._lock_fd = None

    # --- the folder --------------------------------------------------------------------------

    def _open(self, resume: bool) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        self._lock_fd = os.open(self.folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            fcntl.flock(self._lock_fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise RecordingError(
                f"{self.folder}: another flatcloth is writing to it. End that one, or choose another folder."
            ) from error
        path = self.folder / HEADER
        if path.exists():
            if not resume:
                raise RecordingError(
                    f"{self.folder}: contains a recording. Choose another folder, or "
                    "continue it with record --resume."
                )
            self._take_up(path)
            return
        if any(self.folder.iterdir()):
            raise RecordingError(f"{self.folder}: not empty. Choose a new or an empty folder.")
        self._write_header([])  # claims the folder before the first view

    def _take_up(self, path: Path) -> None:
        try:
            # Only the types are checked here; reading the recording checks the rest.
            header: dict[str, Any] = fitted(parse_json(read_plain(path)), dict[str, Any])
            kept = fitted({"views": [], **header}, RecordingHeader)
            if kept.views:
                open_folder(self.folder)  # raises the error
        except ValueError as error:
            raise RecordingError(
                f"{path}: not a recording that can be resumed ({error}). Choose another folder."
            ) from error
        camera, own = kept.intrinsics, self._header["intrinsics"]
        same = header.get("format") == HEADER_FORMAT and not any(camera.distortion)
        same &= math.isclose(kept.depth_scale_m, self._header["depth_scale_m"], rel_tol=1e-6)
        names = ("width", "height", "fx", "fy", "cx", "cy")
        if not same or any(abs(getattr(camera, name) - own[name]) >= _SAME_CAMERA_PX for name in names):
            raise RecordingError(
                f"{path}: was recorded with another camera or other settings. Choose another folder."
            )
        self._views = list(header.pop("views", []))
        self._header = header

    def _write_header(self, views: list[dict[str, Any]]) -> None:
        text = json.dumps({**self._header, "views": views}, indent=1, allow_nan=False) + "\n"
        replace_file(self.folder / HEADER, text.encode())

    def _checked(self, angle_deg: float, images: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
        """Return the images of the next view if they and its angle fit."""
        where, size = f"{self.folder}: view {len(self)}", (self._intrinsics.height, self._intrinsics.width)
        if self._lock_fd is None:
            raise RecordingError(f"{self.folder}: the recording is closed. Open it again with resume=True.")
        if not math.isfinite(angle_deg) or abs(angle_deg) > 3600:
            raise RecordingError(f"{where} has the angle {angle_deg}. Give degrees since view 0.")
        names = [f"view {n}" for n in range(len(self) + 1)]
        check_distinct([*self.angles_deg, angle_deg], f"{self.folder}:", names)
        for kind, (dtype, channels) in _IMAGES.items():
            image, wanted = images.get(kind), (*size, *channels)
            if image is not None and (image.dtype != dtype or image.shape != wanted):
                what = f"is {image.dtype} {image.shape}, not {np.dtype(dtype)} {wanted}"
                raise RecordingError(f"{self.folder}: the {kind} image of view {len(self)} {what}.")
            if self._views and (kind in self._views[0]) != (image is not None):
                which = "no" if image is None else "a"
                raise RecordingError(
                    f"{where} has {which} {kind}, unlike view 0. Give all views one, or none."
                )
        if not images["depth"].any():
            raise RecordingError(f"{where} has no depth, every pixel is 0. Record it again.")
        return images


_IMAGES: dict[str, tuple[type[np.generic], tuple[int, ...]]] = {
    "color": (np.uint8, (3,)), "depth": (np.uint16, ()), "mask": (np.uint8, ()), "truth": (np.uint16, (3,)),
}  # fmt: skip
"""The type and the channels of each image of a view."""


def _png(pixels: Any) -> bytes:
    import cv2

    # Of noisy pictures smaller and in half the time of the search for what repeats.
    how = [cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE]
    return cv2.imencode(".png", np.ascontiguousarray(pixels), how)[1].tobytes()


# --- a recording that grows -----------------------------------------------------------------------


class GrowingRecording(Recording):
    """The recording that a writer writes; from its first view on it can be integrated.

    Parameters
    ----------
    writer : RecordingWriter
        It owns the folder.
    """

    is_growing = True

    def __init__(self, writer: RecordingWriter) -> None:
        self._writer = writer
        self.angles_deg = ()
        if len(writer):
            self._open()

    def _open(self) -> None:
        vars(self).update(vars(open_folder(self._writer.folder)))

    def add(self, angle_deg: float, color: Uint8, depth_units: Uint16, mask: Bool | None = None) -> int:
        """Write a view, and return its number; see :meth:`RecordingWriter.add`."""
        number = self._writer.add(angle_deg, color, depth_units, mask)
        self._open()
        return number

    def close(self) -> None:
        """Release the folder."""
        self._writer.close()


# --- copies ---------------------------------------------------------------------------------------

DEPTH_SCALE_M = 0.0001
"""Averaged depth has fractions of a millimetre; 16 bits of this reach 6.5 m."""
_REPORT = "segmentation.json"


def copy_recording(
    recording: Recording,
    folder: str | os.PathLike[str],
    name: str | None = None,
    progress: Progress = no_progress,
) -> int:
    """Write all views of a recording to a folder, and return how many.

    Parameters
    ----------
    recording : Recording
        Any kind; its axis, held point and masks are copied if it has them.
    folder : path
        New or empty.
    name : str, optional
        Replaces the recording's own name.
    progress : callable
        Called with the share of the work done.

    Raises
    ------
    RecordingError
        If a view cannot be read or the folder cannot be written; earlier views are kept.
    """
    first = recording[0]  # read before the folder is created, in case the recording cannot be read
    with RecordingWriter(
        folder,
        name=name or recording.name,
        description=recording.description,
        intrinsics=recording.intrinsics,
        depth_scale_m=DEPTH_SCALE_M,
        rotation_axis=recording.rotation_axis,
        held_point_m=recording.held_point_m,
    ) as writer:
        for n in range(len(recording)):
            progress(n / len(recording), f"writing view {n}")
            frame = recording[n] if n else first
            mask: Bool | Uint8 | None = frame.mask
            if mask is not None and frame.other_mask is not None:  # it names both sides
                mask = np.where(mask, 255, np.where(frame.other_mask, OTHER_SIDE, 0)).astype(np.uint8)
            writer.add(frame.angle_deg, frame.color, depth_units(frame.depth_m), mask)
        return len(writer)


def write_masks(
    recording: Recording, folder: Path, report: Mapping[str, Any], progress: Progress = no_progress
) -> int:
    """Write the mask of each view as ``000.png`` and so on, 255 on the side of interest, with a report.

    Parameters
    ----------
    recording : Recording
        Its views have masks.
    folder : Path
        New or empty. Moved into a recording as its folder ``mask``, the files can be named in its
        ``recording.json``: ``"mask": "mask/000.png"``.
    report : mapping
        Written into the same folder as ``segmentation.json``.
    progress : callable
        Called with the share of the work done.

    Raises
    ------
    RecordingError
        If the folder cannot be written.
    """
    with os_errors_as(RecordingError, f"{folder}: cannot be written", "Choose a writable folder."):
        folder.mkdir(parents=True, exist_ok=True)
        for n in range(len(recording)):
            progress(n / len(recording), f"writing mask {n}")
            mask = np.asarray(recording[n].mask)
            (folder / f"{n:03d}.png").write_bytes(_png(np.where(mask, 255, 0).astype(np.uint8)))
        (folder / _REPORT).write_text(json.dumps(dict(report), indent=1) + "\n")
    return len(recording)


def depth_units(depth_m: Float32) -> Uint16:
    """Return depth (H, W) in units of ``DEPTH_SCALE_M``, 0 for depth too large for 16 bits."""
    units = np.round(depth_m.astype(np.float64) / DEPTH_SCALE_M)
    fits = np.isfinite(units) & (units > 0) & (units <= np.iinfo(np.uint16).max)
    return np.where(fits, units, 0).astype(np.uint16)
