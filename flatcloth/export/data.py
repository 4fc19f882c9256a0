"""The data files of a session: arrays, picture, cloud, grasp points, garment, outcome."""

from __future__ import annotations

import contextlib
import io
import json
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from flatcloth.core.errors import FlatclothError, os_errors_as
from flatcloth.core.geometry import Rigid3
from flatcloth.core.plain_files import open_plain, replace_file
from flatcloth.core.types import MIRROR, Bool, FlattenedView, Float64, RotationAxis, Uint8
from flatcloth.engine.garment import GarmentService, KnownGarment
from flatcloth.engine.outcome import FILE as OUTCOME
from flatcloth.engine.outcome import outcome_of, outcome_text, sides_entry
from flatcloth.engine.sheet import OTHER_FILE, floating_file, other_floating_file, with_placed_pieces
from flatcloth.export.garment import garment_document, named_points, number, numbers, outcome_entry
from flatcloth.garments.deciding import decided_pieces
from flatcloth.grasping.grasps import (
    BASE_FROM_CAMERA,
    GraspPose,
    Grip,
    grasp_pose,
    nearest_pixel,
    quaternion_wxyz,
)
from flatcloth.methods.answers import Canonical, JoinedSides
from flatcloth.recordings.files.text import shortened
from flatcloth.session.document import Document
from flatcloth.session.journal import Pick, SheetSide

if TYPE_CHECKING:
    from flatcloth.engine.integration import Integration

GARMENT, GRASPS = "garment.json", "grasps.json"
FORMAT = "flatcloth-flattened/1"
GRASPS_FORMAT = "flatcloth-grasps/1"
_WRITERS = 2
"""Files written at the same time. Chosen: two take nearly all of the time, the arrays and the grasp poses."""
_OF_OTHER_SIDE = (OTHER_FILE, "flattened-other.png", "cloud-other.ply")


@dataclass(frozen=True, kw_only=True)
class GraspFrames:
    """The information for grasp poses, and their frames.

    ``axis`` is the turning axis (object frame), ``rotation_deg`` the rotation of the item for the
    camera's and the robot's frame, ``grips`` the operator's choices by the number of the pick,
    ``base_from_camera`` the hand-eye transform, or None.
    """

    axis: RotationAxis
    rotation_deg: float
    grips: Mapping[int, Grip] = field(default_factory=dict)
    base_from_camera: Rigid3 | None = None


Files = dict[str, Callable[[], bytes]]
"""Files to be written: each name with the function that makes its content."""


def side_files(
    side: SheetSide,
    view: FlattenedView,
    floating: Sequence[FlattenedView] = (),
    this: FlattenedView | None = None,
) -> Files:
    """Return the arrays, the picture and the cloud of a side, as seen from its own outside.

    Each floating piece is in a file of arrays of its own, on a plane of its own. If seams relate the side to
    ``this``, the arrays have ``this_from_other`` (:func:`this_from_other`).
    """

    def arrays(own: FlattenedView) -> bytes:
        return npz_bytes(own, **({} if this is None else {"this_from_other": this_from_other(own, this)}))

    names = ("flattened.npz", "flattened.png", "cloud.ply") if side == "this" else _OF_OTHER_SIDE
    makes = (lambda: arrays(view), lambda: png_bytes(view.rgb, view.valid), lambda: ply_bytes(view))
    piece_file = floating_file if side == "this" else other_floating_file
    pieces = {piece_file(n): partial(arrays, piece) for n, piece in enumerate(floating, start=1)}
    return {**dict(zip(names, makes, strict=True)), **pieces}


def this_from_other(other: FlattenedView, this: FlattenedView) -> Float64:
    """Return the mirror motion (3, 3) from the raster of the other side to that of this one, metres.

    It maps (column, row, 1), each times its pixel size, to the same of this side's raster.
    """
    motion = np.diag([*MIRROR, 1.0])
    own, its = np.array(this.origin_uv_m), np.array(other.origin_uv_m)
    motion[:2, 2] = its * MIRROR - own
    return motion


def write_files(files: Files, folder: Path) -> list[Path]:
    """Write files to a folder, each replaced atomically, so a crash leaves either the old or the new one.

    They are written in the given order; the last one, the report, after the others.

    Raises
    ------
    FlatclothError
        If the folder cannot be written; the message names it.
    """
    *names, report = files
    with os_errors_as(FlatclothError, f"{folder}: the export cannot be written", "Choose another folder."):
        folder.mkdir(parents=True, exist_ok=True)
        with ThreadPoolExecutor(_WRITERS) as pool:
            told = pool.submit(files[report])
            list(pool.map(lambda name: replace_file(folder / name, files[name]()), names))
            replace_file(folder / report, told.result())
    return [folder / name for name in files]


def remove_stale(written: Collection[str], folder: Path) -> None:
    """Remove floating pieces, the other side and garment of an earlier export, unless written now."""
    for path in folder.iterdir():
        is_of_export = path.name in (GARMENT, *_OF_OTHER_SIDE) or is_floating_file(path.name)
        if is_of_export and path.name not in written:
            with contextlib.suppress(OSError):
                path.unlink()


def is_floating_file(name: str) -> bool:
    """Return whether a name is that of a floating piece's file, of either side."""
    return re.fullmatch(r"floating-(other-)?[1-9][0-9]{0,2}\.npz", name) is not None


_MOST_BYTES = 1_000_000_000
"""Limit of an array file that is read back. Chosen: it bounds memory."""
_ARRAYS: dict[str, tuple[Any, ...]] = {
    "rgb": (np.uint8, 3),
    "xyz_m": (np.float32, 3),
    "normal": (np.float32, 3),
    "z_angle_deg": (np.float32,),
    "valid": (np.bool_,),
    "view_index": (np.int16,),
    "source_rc": (np.float32, 2),
    "placement_std_m": (np.float32,),
}
"""Type of each array of ``flattened.npz``, and its channels."""


def read_shape(path: Path) -> FlattenedView:
    """Read a file ``flattened.npz``.

    Raises
    ------
    FlatclothError
        If it is missing, damaged or has another format; the message names the file.
    """
    try:
        with open_plain(path) as file, np.load(file, allow_pickle=False) as data:
            return _shape_of(data)
    except Exception as error:  # zipfile and numpy raise many things of a damaged file
        cause = (
            error.strerror if isinstance(error, OSError) and error.strerror else shortened(str(error), 120)
        )
        raise FlatclothError(f"{path}: not a flattened view ({cause}); export it again.") from error


def _shape_of(data: Any) -> FlattenedView:
    """Return the view of an archive; raises ``ValueError`` or what numpy raises if it is not valid."""
    if sum(part.file_size for part in data.zip.infolist()) > _MOST_BYTES:
        raise ValueError(f"it unpacks to more than {_MOST_BYTES / 1e9:g} GB")
    if str(data["format"]) != FORMAT:
        raise ValueError(f"its format is {shortened(str(data['format']))}, not {FORMAT}")
    size = data["valid"].shape
    arrays: dict[str, Any] = {}
    for name, (dtype, *channels) in _ARRAYS.items():
        if name in data or name != "placement_std_m":
            arrays[name] = data[name]
            if arrays[name].dtype != dtype or len(size) != 2 or arrays[name].shape != (*size, *channels):
                raise ValueError(f"{name} has another type or size")
    pixel_size_m, origin = float(data["pixel_size_m"]), data["origin_uv_m"]
    if not (pixel_size_m > 0 and origin.shape == (2,) and np.isfinite([pixel_size_m, *origin]).all()):
        raise ValueError("it has no pixel size or no origin")
    return FlattenedView(
        **arrays, pixel_size_m=pixel_size_m, origin_uv_m=(float(origin[0]), float(origin[1]))
    )


def npz_bytes(view: FlattenedView, **more: Any) -> bytes:
    """Return a flattened view as ``flattened.npz`` is, with ``more`` arrays by name."""
    arrays = {name: array for name in _ARRAYS if (array := getattr(view, name)) is not None}
    file = io.BytesIO()
    np.savez_compressed(
        file,
        pixel_size_m=np.float64(view.pixel_size_m),
        origin_uv_m=np.array(view.origin_uv_m),
        format=np.str_(FORMAT),
        **arrays,
        **more,
    )
    return file.getvalue()


def png_bytes(rgb: Uint8, shown: Bool) -> bytes:
    """Return a flattened picture (H, W, 3) as PNG, transparent off the shown pixels (H, W)."""
    alpha = np.where(shown, 255, 0).astype(np.uint8)
    return bytes(cv2.imencode(".png", np.concatenate([rgb[..., ::-1], alpha[..., None]], axis=-1))[1])


def ply_bytes(view: FlattenedView) -> bytes:
    """Return the valid pixels as a binary PLY cloud: object frame, colors, normals, and u, v on the plane."""
    at = view.valid
    uv = view.uv_from_rc(np.argwhere(at))
    kinds = [(name, "<f4") for name in ("x", "y", "z", "nx", "ny", "nz")]
    kinds += [(name, "u1") for name in ("red", "green", "blue")]
    kinds += [("u", "<f4"), ("v", "<f4")]
    columns = [*view.xyz_m[at].T, *view.normal[at].T, *view.rgb[at].T, *uv.T]
    points = np.rec.fromarrays(columns, dtype=kinds)
    words = {"<f4": "float", "u1": "uchar"}
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment object frame, metres; u, v on the flattened plane",
        f"element vertex {points.size}",
    ]
    header += [f"property {words[kind]} {name}" for name, kind in kinds]
    return ("\n".join([*header, "end_header"]) + "\n").encode() + points.tobytes()


def json_bytes(document: Mapping[str, Any]) -> bytes:
    """Return a document as the content of its file."""
    return (json.dumps(document, indent=1, allow_nan=False) + "\n").encode()


def grasps_document(
    view: FlattenedView,
    picks: Iterable[Pick],
    frames: GraspFrames,
    named: Sequence[Pick] = (),
    floating: Sequence[FlattenedView] = (),
    other: Sequence[FlattenedView] = (),
) -> dict[str, Any]:
    """Return the picks for ``grasps.json`` (docs/grasps.md): points, and poses in each frame.

    A pick on a floating piece has its pixel and its pose there; ``file`` of its pixel names the piece.
    ``other`` is the other side with its floating pieces, for picks there; empty if it is not known.
    """
    axis, base = frames.axis, frames.base_from_camera
    files = ["flattened.npz", *map(floating_file, range(1, len(floating) + 1))]
    its = [OTHER_FILE, *map(other_floating_file, range(1, len(other)))]
    of_side = {
        "this": list(zip(files, (view, *floating), strict=True)),
        "other": list(zip(its, other, strict=False)),
    }
    return {
        "format": GRASPS_FORMAT,
        "frame": "held",
        "units": "m",
        "rotation_deg": number(frames.rotation_deg),
        "rotation_axis": {"point_m": numbers(axis.point_m), "direction": numbers(axis.direction)},
        BASE_FROM_CAMERA: None if base is None else _matrix(base),
        "grasps": [_grasp(of_side[pick.side], pick, frames) for pick in picks],
        "garment_points": [_grasp(of_side[point.side], point, frames) for point in named],
    }


def _grasp(files: Sequence[tuple[str, FlattenedView]], pick: Pick, frames: GraspFrames) -> dict[str, Any]:
    """Return a pick; ``files`` are its side and the floating pieces there, each with its file."""
    views = [view for _, view in files]
    position, normal = pick.position_held_m, pick.normal_held
    grasp: dict[str, Any] = {
        "id": pick.id,
        "name": pick.name,
        "side": pick.side,
        "position_m": numbers(position),
        "normal": numbers(normal),
        "view_index": pick.view_index,
        "source_rc": numbers(np.array(pick.source_rc), 3),
    }
    if not views:
        return {**grasp, "grip": None, "poses": None}
    found = nearest_pixel(views, position)
    view, pixel = views[0], None
    if found is not None:
        place, (row, col), distance_m = found
        view, pixel = views[place], ((row, col), distance_m)
        grasp["flattened"] = {
            "file": files[place][0],
            "row": row,
            "col": col,
            "uv_m": numbers(view.uv_from_rc(np.array([row, col]))),
            "distance_m": number(distance_m),
        }
    pose = grasp_pose(view, position, normal, frames.axis, frames.grips.get(pick.id), pixel)
    return {**grasp, **({"grip": None, "poses": None} if pose is None else _posed(pose, frames))}


def _posed(pose: GraspPose, frames: GraspFrames) -> dict[str, Any]:
    turn = pose.object_from_grasp.rotation
    camera = pose.camera_from_grasp(frames.axis, frames.rotation_deg)
    poses = {"held": pose.object_from_grasp, "camera": camera}
    if frames.base_from_camera is not None:
        poses["base"] = frames.base_from_camera @ camera
    about, outline_m = pose.uncertainty, pose.outline_distance_m
    return {
        "grip": {
            "approach": numbers(turn[:, 2]),
            "axis": numbers(turn[:, 0]),
            "axis_from": pose.axis_from,
            "opening_m": number(pose.opening_m),
            "outline_distance_m": number(outline_m),
        },
        "uncertainty": {
            "position_m": number(about.position_m),
            "normal_deg": number(about.normal_deg, 2),
            "axis_deg": number(about.axis_deg, 2),
            "placement_m": number(about.placement_m),
        },
        "poses": {
            name: {
                "position_m": numbers(motion.translation_m),
                "quaternion_wxyz": [number(x, 9) for x in quaternion_wxyz(motion.rotation)],
                "matrix": _matrix(motion),
            }
            for name, motion in poses.items()
        },
    }


def _matrix(motion: Rigid3) -> list[list[float | None]]:
    """Return the four rows of a rigid motion's matrix."""
    rows = [
        [*numbers(turn, 9), number(float(shift))]
        for turn, shift in zip(motion.rotation, motion.translation_m, strict=True)
    ]
    return [*rows, [0.0, 0.0, 0.0, 1.0]]


# --- all files of a session -----------------------------------------------------------------------


@dataclass(frozen=True)
class SessionData:
    """What a session leaves behind as data; each part is computed on first use.

    ``garments`` recognises the garment, a new service by default. ``both`` joins the other side to a
    document's shape, if that belongs to it.
    ``is_growing``: views are still being added, and no garment is recognised for the deviations of the shape.
    Grasp poses are at ``rotation_deg`` of the item, by default that of the last viewed view.
    """

    integration: Integration
    document: Document
    picks: tuple[Pick, ...] = ()
    grips: Mapping[int, Grip] = field(default_factory=dict)
    garments: GarmentService | None = None
    both: Callable[[Document], JoinedSides | str] | None = None
    is_growing: bool = False
    rotation_deg: float | None = None
    base_from_camera: Rigid3 | None = None

    @property
    def frames(self) -> GraspFrames:
        """The frames of grasp poses."""
        standing = self.integration.recording.angles_deg[self.document.present_view or 0]
        return GraspFrames(
            axis=self.integration.axis,
            rotation_deg=standing if self.rotation_deg is None else self.rotation_deg,
            grips=self.grips,
            base_from_camera=self.base_from_camera,
        )

    @cached_property
    def canonical(self) -> Canonical:
        """The shape, with the pieces that have a place on it, and its floating pieces.

        Raises
        ------
        FlatclothError
            If nothing is flattened yet.
        """
        if not self.is_growing:
            _ = self.garment  # recognised first: the deviations of the shape depend on it
        canonical = self.integration.canonical(self.document)
        pieces = decided_pieces(self.document.garment, canonical.view, canonical.floating)
        laid = () if self.joined is None else self.joined.laid
        return with_placed_pieces(canonical, pieces.with_laid(laid))

    @cached_property
    def sides(self) -> JoinedSides | str | None:
        """The other side, joined to the shape, or why there is none; None if it was not asked for."""
        if self.both is not None and not self.is_growing:
            _ = self.garment  # recognised first: their deviations depend on it
        return None if self.both is None else self.both(self.document)

    @property
    def joined(self) -> JoinedSides | None:
        """The other side; None if there is none, or it was not asked for."""
        return self.sides if isinstance(self.sides, JoinedSides) else None

    @cached_property
    def garment(self) -> KnownGarment | str:
        """What is known of the garment, or why nothing is."""
        if self.both is not None:
            self.both(self.document)  # the garment is recognised by both sides once they are joined
        return (self.garments or GarmentService(self.integration)).known(self.document)

    @cached_property
    def outcome(self) -> dict[str, Any]:
        """The content of ``outcome.json``."""
        outcome = outcome_of(self.integration, self.document, self.canonical.view)
        outcome["garment"] = outcome_entry(self.garment)
        if self.sides is not None:
            outcome["other_side"] = sides_entry(self.sides)
            if outcome["wrong"] and "firm_share" in outcome["other_side"]:
                outcome["other_side"]["firm_share"] = 0.0
        return outcome

    def files(self) -> Files:
        """Return all files, each with the function that makes it; the report comes last."""
        shape, sides, garment = self.canonical, self.joined, self.garment
        files = side_files("this", shape.view, shape.floating)
        other: tuple[FlattenedView, ...] = ()
        if sides is not None:
            view, floating = sides.other.view, sides.other.floating
            other = (view, *floating)
            files |= side_files("other", view, floating, shape.view if sides.is_related else None)

        def grasps() -> bytes:
            named = named_points(garment, sides)
            told = grasps_document(shape.view, self.picks, self.frames, named, shape.floating, other)
            return json_bytes(told)

        files[GRASPS] = grasps
        if not isinstance(garment, str):
            files[GARMENT] = lambda: json_bytes(garment_document(garment, sides))
        files[OUTCOME] = lambda: outcome_text(self.outcome).encode()
        return files

    def write(self, folder: Path) -> list[Path]:
        """Write all files to a folder, and remove files of an earlier, larger export.

        Raises
        ------
        FlatclothError
            If the folder cannot be written; the message names it.
        """
        files = self.files()
        written = write_files(files, folder)
        remove_stale(files, folder)
        return written
