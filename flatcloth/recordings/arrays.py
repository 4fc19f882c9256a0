"""Recordings that are arrays in memory."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flatcloth.core.types import Bool, Float32, Float64, Intrinsics, RotationAxis, Uint8
from flatcloth.recordings.base import MAX_VIEWS, Recording, ViewImages, check_distinct
from flatcloth.recordings.files.camera import checked_direction, checked_intrinsics
from flatcloth.recordings.files.images import FARTHEST_M
from flatcloth.recordings.files.text import failing


def recording_from_arrays(
    color: Iterable[ArrayLike],
    depth: Iterable[ArrayLike],
    intrinsics: Intrinsics | ArrayLike,
    angles_deg: ArrayLike,
    masks: Iterable[ArrayLike] | None = None,
    *,
    rotation_axis: RotationAxis | tuple[ArrayLike, ArrayLike] | None = None,
    held_point_m: ArrayLike | None = None,
    depth_scale_m: float | None = None,
    name: str = "arrays",
) -> Recording:
    """Make a recording from arrays; images without lens distortion.

    Parameters
    ----------
    color : (N, H, W, 3) uint8
        The images of the N views, RGB; also a sequence of images.
    depth : (N, H, W) float or integer
        Depth along the optical axis, aligned to ``color``. Floating-point values are metres unless
        ``depth_scale_m`` is given; 0 and values that are not finite mean that nothing was measured.
    intrinsics : Intrinsics or (3, 3) float
        The camera, or its matrix K, in pixels; pixel centres have integer coordinates.
    angles_deg : (N,) float
        Rotation of the item about the axis since the first view. A positive rotation moves a surface that
        faces the camera to the right of the image.
    masks : (N, H, W) bool or integer, optional
        True (not 0) on the side of interest of the cloth. Without masks it is found from the views.
    rotation_axis : RotationAxis or ((3,), (3,)), optional
        Point (metres) and unit direction (upwards: negative y) of the turning axis, camera frame. Without it
        the axis is estimated.
    held_point_m : (3,) float, optional
        Where the item is held, camera frame; by default the top of the item.
    depth_scale_m : float, optional
        Metres per unit of ``depth``: by default 0.001 for integers and 1 for floating-point values.
    name : str
        For titles and reports.

    Returns
    -------
    Recording
        Reads like any other recording. Arrays of the right type are not copied; do not modify them.

    Raises
    ------
    RecordingError
        If a shape, type or value does not fit; the message names the argument and the remedy.
    """
    angles = _numbers("angles_deg", angles_deg)
    if angles.ndim != 1 or not 1 <= len(angles) <= MAX_VIEWS:
        failing("angles_deg")(f"has the shape {angles.shape}", f"Give 1 to {MAX_VIEWS} angles, one per view.")
    check_distinct(angles.tolist(), "angles_deg:", [f"view {n}" for n in range(len(angles))])
    count, whole = len(angles), ("u1", "u2", "u4", "u8", "i1", "i2", "i4", "i8")
    colors: list[Uint8] = _images("color", color, count, ("u1",), (3,), "Give uint8 (H, W, 3), RGB.")
    size = colors[0].shape[:2]
    units = _images("depth", depth, count, (*whole, "f2", "f4", "f8"), (), "Give numbers (H, W).", size)
    depths = [_metres(f"depth[{n}]", image, depth_scale_m) for n, image in enumerate(units)]
    found: list[Bool | None] = [None] * count
    if masks is not None:
        bools = ("b1", *whole)
        found = [image != 0 for image in _images("masks", masks, count, bools, (), "Give bool (H, W).", size)]
    axis = None
    if rotation_axis is not None:
        given, fail = rotation_axis, failing("rotation_axis direction")
        point, up = (given.point_m, given.direction) if isinstance(given, RotationAxis) else tuple(given)
        unit = checked_direction(_vector("rotation_axis direction", up), fail)
        if unit[1] > 0:
            fail("does not point up", "Give a direction with negative y; negate the angles with it.")
        axis = RotationAxis(point_m=_vector("rotation_axis point", point), direction=unit)
    return Recording(
        name=name,
        location="arrays",
        intrinsics=_camera(intrinsics, size),
        rotation_axis=axis,
        held_point_m=None if held_point_m is None else _vector("held_point_m", held_point_m),
        angles_deg=tuple(angles.tolist()),
        has_masks=masks is not None,
        read=lambda n: ViewImages(colors[n], depths[n], found[n]),
    )


def _array(where: str, values: ArrayLike) -> NDArray[Any]:
    try:
        return np.asarray(values)
    except ValueError:
        failing(where)("has rows of different lengths", "Give an array.")


def _numbers(where: str, values: ArrayLike) -> Float64:
    array = _array(where, values)
    if array.dtype.kind not in "iuf" or not np.isfinite(array).all():
        failing(where)("is not made of finite numbers", "Give numbers.")
    return array.astype(np.float64)


def _vector(where: str, values: ArrayLike) -> Float64:
    vector = _numbers(where, values)
    if vector.shape != (3,) or np.abs(vector).max() > FARTHEST_M:
        failing(where)("is no point near the camera", "Give three numbers, in metres.")
    return vector


def _images(
    where: str,
    given: Iterable[ArrayLike],
    count: int,
    kinds: Sequence[str],
    channels: tuple[int, ...],
    give: str,
    size: tuple[int, ...] | None = None,
) -> list[NDArray[Any]]:
    images = [_array(f"{where}[{n}]", image) for n, image in enumerate(given)]
    if len(images) != count:
        failing(where)(f"has {len(images)} images for {count} angles", "Give one image per angle.")
    for n, image in enumerate(images):
        is_image = image.ndim >= 2 and image.size and image.shape[2:] == channels
        if not is_image or image.dtype.str[1:] not in kinds:
            failing(f"{where}[{n}]")(f"has the type {image.dtype} and the shape {image.shape}", give)
        rows, cols = size or images[0].shape[:2]
        if image.shape[:2] != (rows, cols):
            pixels = f"Give {rows} x {cols} pixels, as in color[0]."
            failing(f"{where}[{n}]")(f"has the shape {image.shape}", pixels)
    return images


def _metres(where: str, image: NDArray[Any], scale_m: float | None) -> Float32:
    if scale_m is not None and not 1e-6 <= scale_m <= 1.0:
        failing("depth_scale_m")(f"is {scale_m:g}", "Give metres per unit of depth, 0.001 for millimetres.")
    scale = scale_m or (1.0 if image.dtype.kind == "f" else 1e-3)
    metres: Float32 = np.multiply(image, np.float32(scale), dtype=np.float32)
    metres[~np.isfinite(metres)] = 0.0
    if (metres < 0).any():
        failing(where)("has negative values", "Depth is measured along the optical axis, from 0.")
    if not metres.any():
        failing(where)("has no depth, every pixel is 0", "Leave the view out.")
    if np.median(metres[metres > 0]) > FARTHEST_M:
        failing(where)(f"is mostly beyond {FARTHEST_M:g} m", "Give depth_scale_m, 0.001 for millimetres.")
    metres[metres > FARTHEST_M] = 0.0
    return metres


def _camera(given: Intrinsics | ArrayLike, size: tuple[int, ...]) -> Intrinsics:
    height, width = size
    if isinstance(given, Intrinsics):
        if (given.height, given.width) != size:
            failing("intrinsics")(
                f"are of {given.width}x{given.height} px", f"The images are {width}x{height}."
            )
    else:
        k = _numbers("intrinsics", given)
        if k.shape != (3, 3) or k[[0, 1, 2, 2], [1, 0, 0, 1]].any() or k[2, 2] != 1:
            failing("intrinsics")("is no camera matrix", "Give [[fx, 0, cx], [0, fy, cy], [0, 0, 1]].")
        fx, fy, cx, cy = k[[0, 1, 0, 1], [0, 1, 2, 2]].tolist()
        given = Intrinsics(width=width, height=height, fx=fx, fy=fy, cx=cx, cy=cy)
    return checked_intrinsics(given, failing("intrinsics"))
