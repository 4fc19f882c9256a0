"""A small, valid input of every kind that flatcloth reads, and the command that reads it."""

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import foreign_folders
import numpy as np
import ros_bags
import trimesh
from exported_sessions import write_cylinder, write_session
from garment_meshes import arc, binary_ply_of, write_glb, write_obj, write_ply
from pcd_files import cloud_points, write_pcd
from realsense_files import stop_and_go, turning, write_realsense
from scenes import views
from tiny_recordings import write_recording

SMALL_CAMERA = ("--size", "64", "64", "--focal", "40", "--step", "90")


@dataclass(frozen=True)
class Sample:
    """``build`` writes it into an empty folder; in ``command``, ``{}`` stands for that folder's path.

    ``files`` are the patterns of the files that are changed. ``heavy`` samples take seconds a case.
    """

    name: str
    build: Callable[[Path], object]
    command: tuple[str, ...]
    files: tuple[str, ...] = ("**/*",)
    heavy: bool = False


def _import(name: str, *given: str) -> tuple[str, ...]:
    return ("import", f"{{}}/{name}", *given, "--out", "{}/imported")


def _jpeg_folder(place: Path) -> None:
    write_recording(place / "in")
    for n in range(3):
        png = place / f"in/color/{n}.png"
        assert cv2.imwrite(str(png.with_suffix(".jpg")), cv2.imread(str(png)))
        png.unlink()
    file = place / "in/recording.json"
    file.write_text(re.sub(r"(color/\d)\.png", r"\1.jpg", file.read_text()))


def _with_truth(place: Path) -> None:
    write_cylinder(place / "in", "cylinder")
    file = place / "in/recording.json"
    content = json.loads(file.read_text())
    content["truth"] = {"garment": "tube", "held_at": "rim", "panel_of_interest": 1}
    for n, view in enumerate(content["views"]):
        mask = cv2.imread(str(place / "in" / view["mask"]), cv2.IMREAD_UNCHANGED)
        rows, cols = np.indices(mask.shape)
        truth: np.ndarray = np.stack(
            [np.full(mask.shape, 17), 25_000 + 20 * rows, 25_000 + 20 * cols], axis=-1
        )
        view["truth"] = f"truth/{n}.png"
        (place / "in/truth").mkdir(exist_ok=True)
        pixels = np.where(mask[..., None] > 0, truth, 0).astype(np.uint16)
        assert cv2.imwrite(str(place / "in" / view["truth"]), pixels)
    file.write_text(json.dumps(content))


def _open3d(suffix: str, dtype: type) -> Callable[[Path], object]:
    return lambda place: foreign_folders.write_open3d(place / "in", suffix=suffix, dtype=dtype)


_GIVEN_CAMERA = _import("in", "--step", "10", "--camera-file", "{}/in/intrinsic.json")


def _multimodal(place: Path) -> None:
    """Write an area of MultimodalClothes: three views, a cloud of each layout."""
    for n, layout in enumerate(("ascii", "binary", "binary_compressed")):
        points, colors = cloud_points()
        write_pcd(place / f"in/x_{n:02d}_pc.pcd", points, colors, layout=layout)
        assert cv2.imwrite(str(place / f"in/x_{n:02d}_rgb.png"), colors)


def _yaml_camera(place: Path) -> None:
    foreign_folders.write_open3d(place / "in")
    matrix = f"{{rows: 3, cols: 3, data: {[20, 0, 7.5, 0, 20, 5.5, 0, 0, 1]}}}"
    text = f"camera_matrix: {matrix}\ndistortion_model: plumb_bob\nd: [-0.1, 0, 0, 0]\n"
    (place / "in/camera.yaml").write_text(text)


def _with_table(place: Path) -> None:
    foreign_folders.write_open3d(place / "in")
    (place / "in/angles.csv").write_text("file,angle_deg\n00000,0\n00001,20\n00002,-40.5\n")


def _ros(suffix: str) -> Callable[[Path], object]:
    return lambda place: ros_bags.write(place / f"in{suffix}", ros_bags.views(3))


def _ros_packed(name: str, filling_bytes: int) -> Callable[[Path], object]:
    """Write a recording of one packed chunk, with room for a bomb."""
    filling = ros_bags.Compressed("png", np.random.default_rng(5).bytes(filling_bytes))
    messages = [*ros_bags.views(3), ros_bags.Message("/other", ros_bags.START_S + 3, filling)]
    return lambda place: ros_bags.write(place / name, messages, packed=True)


def _ros_compressed(place: Path) -> None:
    messages = [m for m in ros_bags.views(3) if m.topic != ros_bags.COLOR and m.topic != ros_bags.DEPTH]
    for n in range(3):
        at = ros_bags.START_S + n
        jpeg = cv2.imencode(".jpg", foreign_folders.rgb(n)[..., ::-1])[1].tobytes()
        units = np.round(1000 * foreign_folders.depth_m(n)).astype(np.uint16)
        png = b"\0" * 12 + cv2.imencode(".png", units)[1].tobytes()
        color = ros_bags.Compressed("rgb8; jpeg compressed bgr8", jpeg)
        depth = ros_bags.Compressed("16UC1; compressedDepth", png)
        messages += [
            ros_bags.Message("/camera/color/image_raw/compressed", at, color),
            ros_bags.Message("/camera/color/depth/compressedDepth", at, depth),
        ]
    ros_bags.write(place / "in.mcap", messages)


def _realsense(place: Path) -> None:
    write_realsense(place / "in.db3", turning(stop_and_go(2, 10.0, 0.7, 0.4), 1.8))
    (place / "angles.csv").write_text("time_s,angle_deg\n0,0\n0.7,0\n1.1,10\n1.8,10\n")


def _mesh(suffix: str) -> Callable[[Path], object]:
    def build(place: Path) -> None:
        vertices, triangles, uv = arc(columns=6, rows=4)
        if suffix in (".stl", ".off"):
            trimesh.Trimesh(vertices, triangles, process=False).export(place / f"in{suffix}")
            return
        if suffix == ".ply":
            write_ply(place / "in.ply", vertices, triangles, np.tile([200, 40, 90], (len(vertices), 1)))
            return
        bgr = np.random.default_rng(3).integers(0, 255, (8, 8, 3)).astype(np.uint8)
        if suffix == ".glb":
            write_glb(place / "in.glb", vertices, triangles, uv, bgr)
            return
        assert cv2.imwrite(str(place / "in.png"), bgr)
        (place / "in.mtl").write_text("newmtl cloth\nmap_Kd in.png\n")
        write_obj(place / "in.obj", vertices, triangles, uv, head="mtllib in.mtl\nusemtl cloth")

    return build


def _binary_ply(place: Path) -> None:
    vertices, triangles, _ = arc(columns=6, rows=4)
    (place / "in.ply").write_bytes(binary_ply_of(vertices, triangles))


def _session(place: Path) -> None:
    # Where the recording lies is in the session, and every case has a place of its own: it is named.
    write_session(place / "session", write_cylinder(place / "recording"))
    (place / "camera.json").write_text(
        json.dumps({"format": "flatcloth-hand-eye/1", "base_from_camera": np.eye(4).tolist()})
    )
    (place / "session/session.lock").unlink(missing_ok=True)


def _finished_run(place: Path) -> None:
    from flatcloth.cli import main

    write_cylinder(place / "recording", "cylinder")
    assert main(["run", str(place / "recording"), "--method", "paper", "--out", str(place / "session")]) == 0
    shutil.rmtree(place / "session/cache", ignore_errors=True)


def _shape(place: Path) -> None:
    from flatcloth.export.data import npz_bytes

    (place / "session").mkdir()
    (place / "session/flattened.npz").write_bytes(npz_bytes(views(0.0)[0]))


_SYNTHESIZE = ("--out", "{}/made", *SMALL_CAMERA)
_EXPORT = ("export", "{}/session", "--recording", "{}/recording", "--grasps", "{}/grasps.json")

_STEPPED = _import("in", "--step", "10")

SAMPLES = (
    Sample("folder", lambda place: write_recording(place / "in"), _import("in")),
    Sample(
        "folder-manifest", lambda place: write_recording(place / "in"), _import("in"), ("in/recording.json",)
    ),
    Sample("folder-jpeg", _jpeg_folder, _import("in"), ("in/color/*",)),
    Sample(
        "truth", _with_truth, ("evaluate", "{}/in", "--method", "paper"), ("in/truth/*", "in/recording.json")
    ),
    Sample("tum", lambda place: foreign_folders.write_tum(place / "in"), _STEPPED),
    Sample(
        "tum-lists",
        lambda place: foreign_folders.write_tum(place / "in", associations=False),
        _STEPPED,
        ("in/*.txt",),
    ),
    Sample("open3d", _open3d(".png", np.uint16), _STEPPED),
    Sample("intrinsic", _open3d(".png", np.uint16), _STEPPED, ("in/intrinsic.json",)),
    Sample("tiff", _open3d(".tiff", np.float32), _STEPPED, ("in/depth/*",)),
    Sample("tiff-16", _open3d(".tif", np.uint16), _STEPPED, ("in/depth/*",)),
    Sample("npy", _open3d(".npy", np.float32), _STEPPED, ("in/depth/*",)),
    Sample("pcd", _multimodal, _import("in", "--turning", "20"), ("in/*.pcd",)),
    Sample("camera-file", _open3d(".png", np.uint16), _GIVEN_CAMERA, ("in/intrinsic.json",)),
    Sample(
        "yaml",
        _yaml_camera,
        _import("in", "--step", "10", "--camera-file", "{}/in/camera.yaml"),
        ("in/*.yaml",),
    ),
    Sample("angles", _with_table, _import("in"), ("in/angles.csv",)),
    Sample("ros1-bag", _ros(".bag"), _import("in.bag", "--step", "10")),
    Sample("ros1-bag-packed", _ros_packed("in.bag", 20_000), _import("in.bag", "--step", "10")),
    Sample("mcap", _ros(".mcap"), _import("in.mcap", "--step", "10")),
    Sample("mcap-packed", _ros_packed("in.mcap", 200_000), _import("in.mcap", "--step", "10")),
    Sample("mcap-compressed-images", _ros_compressed, _import("in.mcap", "--step", "10")),
    Sample("ros2-folder", _ros(""), _STEPPED),
    Sample("ros2-db3", _ros(".db3"), _import("in.db3", "--step", "10")),
    Sample("realsense", _realsense, _import("in.db3"), ("in.db3",), heavy=True),
    Sample(
        "turning", _realsense, _import("in.db3", "--angles", "{}/angles.csv"), ("angles.csv",), heavy=True
    ),
    Sample("obj", _mesh(".obj"), ("synthesize", "{}/in.obj", *_SYNTHESIZE)),
    Sample("ply", _mesh(".ply"), ("synthesize", "{}/in.ply", *_SYNTHESIZE)),
    Sample("ply-binary", _binary_ply, ("synthesize", "{}/in.ply", *_SYNTHESIZE)),
    Sample("stl", _mesh(".stl"), ("synthesize", "{}/in.stl", *_SYNTHESIZE)),
    Sample("off", _mesh(".off"), ("synthesize", "{}/in.off", *_SYNTHESIZE)),
    Sample("glb", _mesh(".glb"), ("synthesize", "{}/in.glb", *_SYNTHESIZE)),
    Sample("journal", _session, _EXPORT, ("session/journal.jsonl",)),
    Sample("session", _session, _EXPORT, ("session/*.json",)),
    Sample("hand-eye", _session, (*_EXPORT, "--hand-eye", "{}/camera.json"), ("camera.json",)),
    Sample("npz", _shape, ("read_shape", "{}/session/flattened.npz"), ("session/flattened.npz",)),
    Sample(
        "resumed",
        _finished_run,
        ("run", "{}/recording", "--method", "paper", "--out", "{}/session"),
        ("session/*.json", "session/*.jsonl"),
        heavy=True,
    ),
)
"""Every kind of input. Cases of light samples take some 20 ms."""
