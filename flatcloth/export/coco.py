"""The named points of garments as COCO keypoints, with the images: one data set of many results.

Each view of a recording is an image with one annotation; the keypoints are the named points of the result,
projected by the recorded camera, axis and angle. Their names are those of the aRTF clothes data sets
(docs/garments.md).
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np

from flatcloth.core.errors import FlatclothError
from flatcloth.core.geometry import window_of
from flatcloth.core.types import Float64, RgbdFrame, RotationAxis
from flatcloth.export.data import GARMENT, GRASPS
from flatcloth.export.files import write_file
from flatcloth.garments.kinds import known_kinds
from flatcloth.grasping.visibility import Visibility, project, visibility_in
from flatcloth.recordings import SourceOptions, open_recording
from flatcloth.rendering.pictures import jpeg
from flatcloth.session.header import HEADER, read_header
from flatcloth.session.kept import read_kept

ANNOTATIONS = "annotations.json"
NOT_LABELLED, HIDDEN, VISIBLE = 0, 1, 2
"""Flags of a keypoint, by definition of the format."""


_XYZ = tuple[float | None, float | None, float | None]


class _Point(msgspec.Struct, frozen=True):
    xyz_m: _XYZ | None = None
    normal: _XYZ | None = None


class _Garment(msgspec.Struct, frozen=True):
    """What is read of ``garment.json``."""

    kind: str | None
    points: dict[str, _Point]


class _Axis(msgspec.Struct, frozen=True):
    point_m: _XYZ
    direction: _XYZ


class _Grasps(msgspec.Struct, frozen=True):
    """What is read of ``grasps.json``."""

    rotation_axis: _Axis


def write_coco(folders: Iterable[Path], out: Path) -> tuple[int, int]:
    """Write ``annotations.json`` and the images of results whose garment is known; return their counts.

    Returns
    -------
    (int, int)
        The number of results and of images in the data set.

    Raises
    ------
    FlatclothError
        If no result has a known garment, a recording cannot be opened, or a file cannot be written.
    """
    categories = [
        {
            "id": n,
            "name": kind.name,
            "supercategory": "garment",
            "keypoints": list(kind.named(kind.mean[:, None])),
            "skeleton": [],
        }
        for n, kind in enumerate(known_kinds(), start=1)
    ]
    by_kind = {category["name"]: category for category in categories}
    images: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    results = 0
    for folder in folders:
        garment = read_kept(folder / GARMENT, _Garment, "Export it again.")
        grasps = read_kept(folder / GRASPS, _Grasps, "Export it again.")
        if garment is None or grasps is None or garment.kind not in by_kind or not (folder / HEADER).exists():
            continue
        results += 1
        axis = RotationAxis(
            point_m=_numbers(grasps.rotation_axis.point_m), direction=_numbers(grasps.rotation_axis.direction)
        )
        for image, annotation in _views(folder, garment, axis, by_kind[garment.kind], out):
            number = len(images) + 1
            images.append({"id": number, **image})
            annotations.append({"id": number, "image_id": number, **annotation})
    if not images:
        raise FlatclothError(f"{out}: no result has a known garment, so there are no keypoints to write.")
    document = {
        "info": {"description": "named points of garments, found by flatcloth", "version": "1"},
        "licenses": [],
        "images": images,
        "annotations": annotations,
        "categories": categories,
    }
    write_file(out / ANNOTATIONS, (json.dumps(document) + "\n").encode())
    return results, len(images)


def _views(
    folder: Path, garment: _Garment, axis: RotationAxis, category: dict[str, Any], out: Path
) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
    header = read_header(folder)
    options = SourceOptions.from_dict(header.recording.options, str(folder / HEADER))
    recording = open_recording(header.recording.location, options)
    for index in range(len(recording)):
        frame = recording[index]
        name = f"images/{folder.name}/{index:04d}.jpg"
        write_file(out / name, jpeg(frame.color))
        image = {
            "file_name": name,
            "width": frame.intrinsics.width,
            "height": frame.intrinsics.height,
            "recording": header.recording.name,
            "view_index": index,
            "angle_deg": frame.angle_deg,
        }
        keypoints: list[float] = []
        for point in category["keypoints"]:
            keypoints += _keypoint(garment.points.get(point), axis, frame)
        yield image, {"category_id": category["id"], "iscrowd": 0, **_annotation(keypoints, frame)}


def _annotation(keypoints: list[float], frame: RgbdFrame) -> dict[str, Any]:
    item = frame.mask if frame.mask is not None and frame.mask.any() else frame.depth_m > 0
    rows, cols = window_of(item) or np.s_[0:0, 0:0]
    box = [cols.start, rows.start, cols.stop - cols.start, rows.stop - rows.start]
    outlines, _ = cv2.findContours(item.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    polygons = [outline.ravel().astype(float).tolist() for outline in outlines if len(outline) >= 3]
    return {
        "keypoints": keypoints,
        "num_keypoints": sum(flag > NOT_LABELLED for flag in keypoints[2::3]),
        "bbox": [float(number) for number in box],
        "area": float(item.sum() if frame.mask is not None else box[2] * box[3]),
        "segmentation": [] if frame.mask is None else polygons,
    }


def _keypoint(point: _Point | None, axis: RotationAxis, frame: RgbdFrame) -> list[float]:
    """Return x, y and flag; x and y count pixels from the middle of the first one, as COCO's tools do."""
    if point is None or point.xyz_m is None or point.normal is None:
        return [0, 0, NOT_LABELLED]
    place = project(_numbers(point.xyz_m), _numbers(point.normal), axis, frame.angle_deg, frame.intrinsics)
    visibility = visibility_in(frame, place)
    if visibility is Visibility.OUTSIDE:
        return [0, 0, NOT_LABELLED]
    flag = VISIBLE if visibility is Visibility.SEEN else HIDDEN
    return [round(place.col, 2), round(place.row, 2), flag]


def _numbers(values: tuple[float | None, ...]) -> Float64:
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)
