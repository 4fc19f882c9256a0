"""Folders with ``color/``, ``depth/`` and ``intrinsic.json``, with depth in every kind of file."""

import shutil
import struct
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from foreign_folders import HEIGHT, WIDTH, depth_m, read, refused, rgb, write, write_open3d


@pytest.mark.parametrize(
    ("suffix", "dtype"),
    [
        (".png", np.uint16),
        (".tiff", np.uint16),
        (".tif", np.float32),
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


def test_images_that_do_not_pair_are_told(tmp_path: Path) -> None:
    folder = write_open3d(tmp_path / "scan")
    write(folder / "depth" / "extra.npy", np.ones((HEIGHT, WIDTH), dtype=np.uint16))
    assert len(read(folder)) == 3  # all color images have a partner by name
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
    for name, pixels in (("a.npy", units), ("a.tif", units), ("a.png", units)):
        whole = saved(name, pixels)
        put(f"00000{Path(name).suffix}", whole[:-20], "truncated|damaged")
        put(f"00000{Path(name).suffix}", whole[:40], "truncated|damaged|not a readable")
    put("00000.npy", saved("a.npy", np.ones((HEIGHT, WIDTH, 3))), r"the shape \(12, 16, 3\)")
    put("00000.npy", saved("a.npy", np.array([{"a": 1}], dtype=object)), "not supported")
    put("00000.npy", saved("a.npy", units[:5]), "16x5 px, but the intrinsics are for 16x12")
    put("00000.npy", saved("a.npy", 0 * units), "no depth, every pixel is 0")
    put("00000.npy", b"\x93NUMPY\x01\x00", "damaged")
    put("00000.tif", saved("a.tif", np.ones((HEIGHT, WIDTH, 3), dtype=np.uint16)), "with 3 channels")
    put("00000.png", saved("a.png", units.astype(np.uint8)), "8-bit PNG")
    put("00000.tif", b"II*\0\xff\xff\xff\x7f", "damaged")
    put("00000.png", saved("a.jpg", rgb(0)), "JPEG")
    (depth / "00000.png").mkdir()
    refused(folder, "not a file")


def test_a_damaged_tiff_whose_directory_comes_first_is_not_taken_for_whole(tmp_path: Path) -> None:
    units = np.full((HEIGHT, WIDTH), 800, dtype=np.uint16)
    strip = units.tobytes()
    values = {256: WIDTH, 257: HEIGHT, 258: 16, 259: 1, 262: 1, 273: 122, 277: 1, 278: HEIGHT}
    values[279] = len(strip)
    directory = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in values.items())
    data = b"II*\0\x08\0\0\0" + struct.pack("<H", len(values)) + directory + bytes(4) + strip
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


def test_the_opencv_writer_of_tiff_compresses_and_is_read(tmp_path: Path) -> None:
    folder = write_open3d(tmp_path / "scan", 1, suffix=".tif")
    noise = np.random.default_rng(0).integers(1, 60_000, (HEIGHT, WIDTH)).astype(np.uint16)
    path = str(folder / "depth" / "00000.tif")
    assert cv2.imwrite(path, noise, [cv2.IMWRITE_TIFF_COMPRESSION, 8])
    np.testing.assert_allclose(read(folder)[0].depth_m, noise * np.float32(0.001), rtol=1e-6)
