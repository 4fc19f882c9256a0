"""The files that a finished (or any) session leaves behind: arrays, picture, cloud, grasp points."""

from __future__ import annotations

import json
import os
import zipfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np

from flatcloth.errors import FlatclothError
from flatcloth.grasping import pixel_of_point
from flatcloth.types import FlattenedView, Float64

FORMAT = "flatcloth-flattened/1"
GRASPS_FORMAT = "flatcloth-grasps/1"


class NamedPoint(Protocol):
    """A pick: a named point of the cloth, held frame."""

    @property
    def id(self) -> int:
        """Number of the pick."""
        ...

    @property
    def name(self) -> str:
        """Name given by the operator."""
        ...

    @property
    def position_held_m(self) -> Any:
        """(3,) metres."""
        ...

    @property
    def normal_held(self) -> Any:
        """(3,) unit, out of the cloth."""
        ...

    @property
    def view_index(self) -> int:
        """View it was measured in."""
        ...

    @property
    def source_rc(self) -> Any:
        """(row, col) in that view's image."""
        ...


def export_shape(view: FlattenedView, picks: Iterable[NamedPoint], folder: Path) -> list[Path]:
    """Write ``flattened.npz``, ``flattened.png``, ``cloud.ply`` and ``grasps.json``.

    Each file is written beside its final name and then moved there, so a crash leaves either the
    old or the new one.

    Raises
    ------
    FlatclothError
        If the folder cannot be written; the message names it.
    """
    files: dict[str, Callable[[Path], object]] = {
        "flattened.npz": lambda path: _write_npz(view, path),
        "flattened.png": lambda path: path.write_bytes(png_bytes(view)),
        "cloud.ply": lambda path: path.write_bytes(ply_bytes(view)),
        "grasps.json": lambda path: path.write_text(
            json.dumps(grasps_document(view, picks), indent=1) + "\n"
        ),
    }
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, write in files.items():
            partial = folder / f".{name}.partial"
            write(partial)
            os.replace(partial, folder / name)
    except OSError as error:
        raise FlatclothError(
            f"{folder}: the export cannot be written ({error}); choose another folder."
        ) from error
    return [folder / name for name in files]


def read_shape(path: Path) -> FlattenedView:
    """Read ``flattened.npz`` back.

    Raises
    ------
    FlatclothError
        If it is missing, damaged or of another format; the message names the file.
    """
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as data:
            if str(data["format"]) != FORMAT:
                raise FlatclothError(f"{path}: format {data['format']} is not {FORMAT}; export it again.")
            origin = data["origin_uv_m"]
            return FlattenedView(
                rgb=data["rgb"],
                xyz_m=data["xyz_m"],
                normal=data["normal"],
                z_angle_deg=data["z_angle_deg"],
                valid=data["valid"],
                view_index=data["view_index"],
                source_rc=data["source_rc"],
                pixel_size_m=float(data["pixel_size_m"]),
                origin_uv_m=(float(origin[0]), float(origin[1])),
            )
    except (OSError, EOFError, KeyError, ValueError, zipfile.BadZipFile) as error:
        raise FlatclothError(f"{path}: not a flattened view ({error}); export it again.") from error


def _write_npz(view: FlattenedView, path: Path) -> None:
    with path.open("wb") as file:
        np.savez_compressed(
            file,
            rgb=view.rgb,
            xyz_m=view.xyz_m,
            normal=view.normal,
            z_angle_deg=view.z_angle_deg,
            valid=view.valid,
            view_index=view.view_index,
            source_rc=view.source_rc,
            pixel_size_m=np.float64(view.pixel_size_m),
            origin_uv_m=np.array(view.origin_uv_m),
            format=np.str_(FORMAT),
        )


def png_bytes(view: FlattenedView) -> bytes:
    """Return the flattened picture as PNG, transparent off the cloth."""
    alpha = np.where(view.valid, 255, 0).astype(np.uint8)
    bgra = np.concatenate([view.rgb[..., ::-1], alpha[..., None]], axis=-1)
    return bytes(cv2.imencode(".png", bgra)[1])


def ply_bytes(view: FlattenedView) -> bytes:
    """Return the valid pixels as a binary PLY cloud: held frame, colors, normals, and u, v on the plane."""
    at = view.valid
    uv = view.uv_from_rc(np.argwhere(at))
    kinds = [(name, "<f4") for name in ("x", "y", "z", "nx", "ny", "nz")]
    kinds += [(name, "u1") for name in ("red", "green", "blue")]
    kinds += [("u", "<f4"), ("v", "<f4")]
    points = np.zeros(int(at.sum()), dtype=kinds)
    columns = [*view.xyz_m[at].T, *view.normal[at].T, *view.rgb[at].T, *uv.T]
    for (name, _), column in zip(kinds, columns, strict=True):
        points[name] = column
    words = {"<f4": "float", "u1": "uchar"}
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment held frame, metres; u, v on the flattened plane",
        f"element vertex {points.size}",
    ]
    header += [f"property {words[kind]} {name}" for name, kind in kinds]
    return ("\n".join([*header, "end_header"]) + "\n").encode() + points.tobytes()


def grasps_document(view: FlattenedView, picks: Iterable[NamedPoint]) -> dict[str, Any]:
    """Return the picks for ``grasps.json``: place in space (held frame) and on the flattened plane."""
    return {
        "format": GRASPS_FORMAT,
        "frame": "held",
        "units": "m",
        "grasps": [_grasp(view, pick) for pick in picks],
    }


def _grasp(view: FlattenedView, pick: NamedPoint) -> dict[str, Any]:
    position: Float64 = np.asarray(pick.position_held_m, dtype=np.float64)
    grasp: dict[str, Any] = {
        "id": pick.id,
        "name": pick.name,
        "position_m": [round(float(x), 6) for x in position],
        "normal": [round(float(x), 6) for x in pick.normal_held],
        "view_index": pick.view_index,
        "source_rc": [round(float(x), 3) for x in pick.source_rc],
    }
    if view.valid.any():
        (row, col), distance_m = pixel_of_point(view, position)
        grasp["flattened"] = {
            "row": row,
            "col": col,
            "uv_m": [round(float(x), 6) for x in view.uv_from_rc(np.array([row, col]))],
            "distance_m": round(distance_m, 6),
        }
    return grasp
