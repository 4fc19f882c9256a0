"""Folders with ``color/``, ``depth/`` and ``intrinsic.json``, with depth in every kind of file."""

from __future__ import annotations

import json
import os
import shutil
import struct
import sys
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from foreign_folders import HEIGHT, MATRIX, WIDTH, depth_m, rgb, write, write_exr, write_open3d

from flatcloth.core.errors import RecordingError
from flatcloth.recordings import open_recording
from flatcloth.recordings.files import exr


def read(folder: Path, **options: Any) -> Any:
    recording = open_recording(folder, **({"step_deg": 10.0} | options))
    return [recording[n] for n in range(len(recording))]


def refused(folder: Path, cause: str, **options: Any) -> str:
    with pytest.raises(RecordingError, match=cause) as caught:
        read(folder, **options)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(
    ("suffix", "dtype"),
    [
        (".png", np.uint16),
        (".tiff", np.uint16),
        (".tif", np.float32),
        (".exr", np.float32),
        (".npy", np.uint16),
        (".npy", np.int32),
        (".npy", np.float64),
        (".npy", np.float16),
        (".npy", ">f4"),
    ],
)
def test_depth_is_read_in_metres_from_every_kind_of_file(tmp_path: Path, suffix: str, dtype: Any) -> None:
    frames = read(write_open3d(tmp_path / "scan", suffix=suffix, dtype=np.dtype(dtype)))
    assert len(frames) == 3
    for n, frame in enumerate(frames):
        np.testing.assert_array_equal(frame.color, rgb(n))
        assert frame.depth_m.dtype == np.float32
        np.testing.assert_allclose(frame.depth_m, depth_m(n), atol=6e-4)


def test_color_may_be_jpeg_and_folders_may_have_other_names(tmp_path: Path) -> None:
    folder = write_open3d(tmp_path / "scan")
    for n, file in enumerate(sorted(folder.glob("color/*.png"))):
        file.unlink()
        write(file.with_suffix(".jpg"), rgb(n))
    (folder / "color").rename(folder / "image")
    frame = read(folder)[1]
    assert np.abs(frame.color.astype(int) - rgb(1)).mean() < 20


def test_names_are_counted_as_people_count(tmp_path: Path) -> None:
    folder = tmp_path / "scan"
    for n in range(12):
        write(folder / "color" / f"{n}.png", rgb(n))
        write(folder / "depth" / f"frame{n}.png", (1000 * depth_m(n)).round().astype(np.uint16))
    (folder / "intrinsic.json").write_text(json.dumps({"intrinsic_matrix": MATRIX}))
    frames = read(folder)
    assert [int(frame.color[5, 5, 2]) for frame in frames] == [10 * n for n in range(12)]
    assert [round(100 * float(frame.depth_m[5, 5])) for frame in frames] == list(range(80, 92))


def test_masks_beside_the_images_are_used(tmp_path: Path) -> None:
    folder = write_open3d(tmp_path / "scan")
    mask = np.zeros((HEIGHT, WIDTH), dtype=np.uint8)
    mask[4:] = 255
    for n in range(3):
        write(folder / "mask" / f"{n:05d}.png", mask)
    recording = open_recording(folder, step_deg=10)
    assert recording.has_masks
    np.testing.assert_array_equal(recording[2].mask, mask > 0)
    (folder / "mask" / "00001.png").unlink()
    refused(folder, "00001.png: missing")


@pytest.mark.parametrize(
    "camera",
    [
        {"intrinsic_matrix": MATRIX},
        {"width": WIDTH, "height": HEIGHT, "intrinsic_matrix": [20, 0, 7.5, 0, 20, 5.5, 0, 0, 1]},
        {"intrinsic_matrix": [[20, 0, 7.5], [0, 20, 5.5], [0, 0, 1]]},
        {"fx": 20, "fy": 20.0, "cx": 7.5, "cy": 5.5},
    ],
)
def test_the_camera_is_understood_by_columns_by_rows_and_by_names(tmp_path: Path, camera: Any) -> None:
    found = open_recording(write_open3d(tmp_path / "scan", camera=camera), step_deg=10).intrinsics
    assert (found.width, found.height, found.fx, found.fy, found.cx, found.cy) == (16, 12, 20, 20, 7.5, 5.5)


def test_depth_scale_and_distortion_of_the_camera_file_are_used(tmp_path: Path) -> None:
    camera = {"intrinsic_matrix": MATRIX, "depth_scale": 500, "distortion": [-0.3, 0.05, 0.001, 0.0]}
    frame = read(write_open3d(tmp_path / "scan", camera=camera))[0]
    assert frame.depth_m[5, 5] == pytest.approx(1.6)
    assert not np.array_equal(frame.color, rgb(0))


@pytest.mark.parametrize(
    ("camera", "cause"),
    [
        ([1], "not a JSON object"),
        ({"fx": 20}, "fy is null"),
        ({"intrinsic_matrix": [1, 2]}, "not a camera matrix"),
        ({"intrinsic_matrix": 5}, "not a camera matrix"),
        ({"intrinsic_matrix": [*MATRIX[:8], 2]}, "not a camera matrix"),
        ({"intrinsic_matrix": ["x"] * 9}, "intrinsic_matrix is x"),
        ({"width": 32, "height": 12, "intrinsic_matrix": MATRIX}, "32x12 px, but they have 16x12"),
        ({"intrinsic_matrix": MATRIX, "depth_scale": 1}, "depth_scale is 1"),
        ({"intrinsic_matrix": MATRIX, "distortion": [1]}, "4, 5 or 8 numbers"),
        ({"intrinsic_matrix": MATRIX, "distortion": [9, -90, 0, 0]}, "folds"),
        ({"fx": 1e6, "fy": 20, "cx": 8, "cy": 6}, "Give pixels of a 16x12 image"),
        ({"fx": float("nan"), "fy": 20, "cx": 8, "cy": 6}, "fx is NaN"),
    ],
)
def test_a_camera_file_that_is_wrong_is_one_line(tmp_path: Path, camera: Any, cause: str) -> None:
    assert "intrinsic.json" in refused(write_open3d(tmp_path / "scan", camera=camera), cause)


def test_images_that_do_not_pair_are_told(tmp_path: Path) -> None:
    folder = write_open3d(tmp_path / "scan")
    write(folder / "depth" / "extra.npy", np.ones((HEIGHT, WIDTH), dtype=np.uint16))
    assert len(read(folder)) == 3  # all color images have a partner by name
    shutil.copy(folder / "color" / "00000.png", folder / "color" / "more.png")
    shutil.copy(folder / "color" / "00000.png", folder / "color" / "others.png")
    refused(folder, "has 5 images, but depth has 4, with other names")
    shutil.copy(folder / "depth" / "00000.png", folder / "depth" / "00000.tif")
    refused(folder, "depth: has one image in two file formats")
    (folder / "depth" / "00000.tif").unlink()
    shutil.copy(folder / "color" / "00000.png", folder / "color" / "00000.jpg")
    refused(folder, "color: has one image in two file formats")
    shutil.rmtree(folder / "depth")
    (folder / "depth").mkdir()
    refused(folder, "depth: has no images")


def test_a_link_that_leaves_the_folder_is_refused(tmp_path: Path) -> None:
    folder = write_open3d(tmp_path / "scan")
    elsewhere = tmp_path / "elsewhere.png"
    (folder / "color" / "00001.png").rename(elsewhere)
    (folder / "color" / "00001.png").symlink_to(elsewhere)
    refused(folder, "leads outside the folder")


def test_infinity_not_a_number_and_the_far_plane_are_not_measured(tmp_path: Path) -> None:
    folder = write_open3d(tmp_path / "scan", 1, suffix=".npy", dtype=np.float32)
    depth = depth_m(0).astype(np.float32)
    depth[1, :4] = np.inf, np.nan, -1.0, 1e10
    np.save(folder / "depth" / "00000.npy", depth)
    found = read(folder)[0].depth_m
    assert not found[1, :4].any()
    assert found[1, 4] == np.float32(0.8)


def test_floating_depth_in_millimetres_is_refused_but_a_far_background_is_not(tmp_path: Path) -> None:
    folder = write_open3d(tmp_path / "scan", 1, suffix=".npy", dtype=np.float32)
    np.save(folder / "depth" / "00000.npy", 1000 * depth_m(0))
    refused(folder, "floating-point values exceed 100 m")
    rendered = np.full((HEIGHT, WIDTH), 1e10, dtype=np.float32)
    rendered[2, 2] = 0.8
    np.save(folder / "depth" / "00000.npy", rendered)
    assert np.count_nonzero(read(folder)[0].depth_m) == 1


@pytest.mark.parametrize(
    "channels",
    [
        {"V": 1.0},
        {"View.Depth.Z": 1.0, "View.Combined.G": 0.0},
        {"R": 1.0, "G": 1.0, "B": 1.0},
        {"A": 0.0, "Y": 1.0},
    ],
)
def test_the_depth_channel_of_an_exr_is_found(tmp_path: Path, channels: dict[str, float]) -> None:
    folder = write_open3d(tmp_path / "scan", 1, suffix=".exr", dtype=np.float32)
    filled = {name: np.full((HEIGHT, WIDTH), value, dtype=np.float32) for name, value in channels.items()}
    write_exr(folder / "depth" / "00000.exr", filled)
    assert (read(folder)[0].depth_m == 1.0).all()


def test_depth_files_that_are_wrong_are_one_line(tmp_path: Path) -> None:
    folder = write_open3d(tmp_path / "scan", 1)
    depth = folder / "depth"
    (depth / "00000.png").unlink()

    def put(name: str, data: bytes, cause: str) -> None:
        (depth / name).write_bytes(data)
        message = refused(folder, cause)
        assert message.startswith(str(depth / name))
        (depth / name).unlink()

    def saved(name: str, pixels: Any) -> bytes:
        write(tmp_path / name, pixels)
        return (tmp_path / name).read_bytes()

    units = (1000 * depth_m(0)).astype(np.uint16)
    for name, pixels in (("a.npy", units), ("a.tif", units), ("a.exr", depth_m(0)), ("a.png", units)):
        whole = saved(name, pixels)
        put(f"00000{Path(name).suffix}", whole[:-20], "truncated|damaged")
        put(f"00000{Path(name).suffix}", whole[:40], "truncated|damaged|not a readable")
    put("00000.npy", saved("a.npy", np.ones((HEIGHT, WIDTH, 3))), "not supported")
    put("00000.npy", saved("a.npy", np.asfortranarray(units)), "not supported")
    put("00000.npy", saved("a.npy", np.array([{"a": 1}], dtype=object)), "not supported")
    put("00000.npy", saved("a.npy", units[:5]), "16x5 px, but the intrinsics are for 16x12")
    put("00000.npy", saved("a.npy", 0 * units), "no depth, every pixel is 0")
    put("00000.npy", b"\x93NUMPY\x01\x00", "damaged")
    put("00000.tif", saved("a.tif", np.ones((HEIGHT, WIDTH, 3), dtype=np.uint16)), "with 3 channels")
    put("00000.png", saved("a.png", units.astype(np.uint8)), "8-bit PNG")
    put("00000.tif", b"II*\0\xff\xff\xff\x7f", "damaged")
    put("00000.exr", b"v/1\x01", "damaged")
    put("00000.png", saved("a.jpg", rgb(0)), "JPEG")
    write_exr(tmp_path / "b.exr", {n: np.ones((HEIGHT, WIDTH), dtype=np.float32) for n in ("A", "M")})
    put("00000.exr", (tmp_path / "b.exr").read_bytes(), "with 2 channels")
    (depth / "00000.png").mkdir()
    refused(folder, "not a file")


def test_a_damaged_tiff_whose_directory_comes_first_is_not_taken_for_whole(tmp_path: Path) -> None:
    units = np.full((HEIGHT, WIDTH), 800, dtype=np.uint16)
    strip = units.tobytes()
    entries = [
        (256, WIDTH),
        (257, HEIGHT),
        (258, 16),
        (259, 1),
        (262, 1),
        (273, 122),
        (277, 1),
        (278, HEIGHT),
    ]
    entries.append((279, len(strip)))
    directory = b"".join(
        tag.to_bytes(2, "little") + b"\x04\0" + (1).to_bytes(4, "little") + value.to_bytes(4, "little")
        for tag, value in entries
    )
    data = b"II*\0\x08\0\0\0" + len(entries).to_bytes(2, "little") + directory + b"\0\0\0\0" + strip
    assert len(data) == 122 + len(strip)
    folder = write_open3d(tmp_path / "scan", 1, suffix=".tif")
    (folder / "depth" / "00000.tif").write_bytes(data)
    assert (read(folder)[0].depth_m == np.float32(0.8)).all()
    (folder / "depth" / "00000.tif").write_bytes(data[:-30])
    refused(folder, "truncated")


@pytest.mark.parametrize("step", [0, 1])
def test_a_tiff_of_thousands_of_long_tags_is_refused_at_once(tmp_path: Path, step: int) -> None:
    """2 MB of them took 3 GB and 20 s."""
    count = 4000
    tags = [struct.pack("<HHII", 273 + step * (1000 + n), 3, 2**20, 0) for n in range(count)]
    data = b"II*\0\x08\0\0\0" + struct.pack("<H", count) + b"".join(tags) + bytes(2 * 2**20)
    folder = write_open3d(tmp_path / "scan", 1, suffix=".tif")
    (folder / "depth" / "00000.tif").write_bytes(data)
    begun_s = time.process_time()
    refused(folder, "truncated, damaged or not supported")
    assert time.process_time() - begun_s < 5.0


def test_without_the_exr_library_it_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = write_open3d(tmp_path / "scan", 1, suffix=".exr", dtype=np.float32)
    monkeypatch.setitem(sys.modules, "OpenEXR", None)
    refused(folder, "pip install OpenEXR")


def test_the_opencv_writer_of_tiff_compresses_and_is_read(tmp_path: Path) -> None:
    folder = write_open3d(tmp_path / "scan", 1, suffix=".tif")
    noise = np.random.default_rng(0).integers(1, 60_000, (HEIGHT, WIDTH)).astype(np.uint16)
    path = str(folder / "depth" / "00000.tif")
    assert cv2.imwrite(path, noise, [cv2.IMWRITE_TIFF_COMPRESSION, 8])
    np.testing.assert_allclose(read(folder)[0].depth_m, noise * np.float32(0.001), rtol=1e-6)


def test_an_exr_that_announces_more_than_an_image_is_never_decoded(tmp_path: Path) -> None:
    """2.5 MB of it took 5 GB and 26 s."""
    folder = write_open3d(tmp_path / "scan", 1, suffix=".exr", dtype=np.float32)
    file = folder / "depth" / "00000.exr"
    plane = np.zeros((HEIGHT, WIDTH), dtype=np.float32)
    write_exr(file, {"Z": plane, **{f"c{n:03d}": plane for n in range(60)}})
    refused(folder, "61 channels, more than 32. Export the depth alone")
    large = np.zeros((2400, 2400), dtype=np.float32)
    write_exr(file, {"Z": large, "M": large, "N": large})
    assert file.stat().st_size < 1_000_000
    refused(folder, "2400x2400 px in 3 channels, more than 16 million values")
    # The reader of the refused file reads the next one.
    write_exr(file, {"Z": depth_m(0).astype(np.float32), "M": plane})
    assert read(folder)[0].depth_m.shape == (HEIGHT, WIDTH)


def test_exr_files_are_read_in_another_process(tmp_path: Path) -> None:
    folder = write_open3d(tmp_path / "scan", 1, suffix=".exr", dtype=np.float32)
    assert read(folder)[0].depth_m.any()
    (child,) = exr._kept
    assert child._process.pid != os.getpid()
    child.close()  # as if it had crashed
    refused(folder, r"00000\.exr: .*Copy or export")
    assert read(folder)[0].depth_m.any()
