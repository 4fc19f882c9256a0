"""Camera files as other programs write them (``cameras/``): each word is used, or named."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

from flatcloth.cli import main
from flatcloth.recordings.files.libraries import load_realsense

CAMERAS = Path(__file__).with_name("cameras")
WORDS = yaml.safe_load(Path(__file__).with_name("words.yaml").read_text(encoding="utf-8"))


def maps(model: str, k: dict[str, Any], numbers: list[float]) -> tuple[Any, Any]:
    """Return where a model sees the pixels of a pinhole camera: by OpenCV, librealsense, or as defined."""
    size, lens = (k["width"], k["height"]), np.array(numbers)
    m = np.array([[k["fx"], 0, k["cx"]], [0, k["fy"], k["cy"]], [0, 0, 1.0]])
    if model == "opencv":
        return cv2.initUndistortRectifyMap(m, lens, np.eye(3), m, size, cv2.CV_32FC1)
    if model == "fisheye":
        return cv2.fisheye.initUndistortRectifyMap(m, lens, np.eye(3), m, size, cv2.CV_32FC1)
    rows, cols = np.mgrid[: k["height"], : k["width"]].astype(float)
    x, y = (cols - k["cx"]) / k["fx"], (rows - k["cy"]) / k["fy"]
    if model == "skew":
        cols, rows = cols + numbers[0] * y, rows
    elif model == "inverse":  # the polynomial leads from the image to the ray
        u, v, (a, b, p, q, c) = x, y, numbers
        for _ in range(40):
            r = u * u + v * v
            f, w = r * (a + r * (b + r * c)), 2 * u * v
            u, v = (
                x - u * f - p * w - q * (r + 2 * u * u),
                y - v * f - q * w - p * (r + 2 * v * v),
            )
        cols, rows = u * k["fx"] + k["cx"], v * k["fy"] + k["cy"]
    else:
        library = load_realsense()
        camera = library.intrinsics()
        camera.width, camera.height, camera.fx, camera.fy = *size, k["fx"], k["fy"]
        camera.ppx, camera.ppy, camera.coeffs = k["cx"], k["cy"], (numbers + [0.0] * 5)[:5]
        camera.model = getattr(library.distortion, model)
        rays = np.stack([x, y, np.ones(x.shape)], -1).reshape(-1, 3).tolist()
        pixels = np.array([library.rs2_project_point_to_pixel(camera, ray) for ray in rays])
        cols, rows = pixels.reshape(*x.shape, 2).transpose(2, 0, 1)
    return cols.astype(np.float32), rows.astype(np.float32)


def check_depth(depths: list[Any], small_views: Any, model: str, lens: str) -> None:
    """Compare depth (m) with the stored one, seen through the model."""
    x, y = maps(model, small_views[0], WORDS["lenses"][lens])
    for depth_m, (_, stored_mm) in zip(depths, small_views[1], strict=True):
        off_m = np.abs(depth_m - cv2.remap(stored_mm, x, y, cv2.INTER_NEAREST) * np.float32(0.001))
        assert (off_m > 0.001).mean() < 0.001


@pytest.mark.parametrize("file", WORDS["read"])
def test_the_lens_that_a_file_describes_is_corrected(plain_folder, imported, small_views, file):
    model, lens = WORDS["read"][file]
    given = ("--step", "10", "--camera-file", str(CAMERAS / file))
    header, depths, said = imported(plain_folder(), *given)
    camera = small_views[0]
    assert [header["intrinsics"][name] for name in camera] == pytest.approx(list(camera.values()), rel=1e-6)
    check_depth(depths, small_views, model, lens)
    assert ("corrected for a lens" in said) == (lens != "none")
    named = "not understood, and not used: projection_matrix (of rectified images)."
    assert ("not understood" in said) == (named in said) == (file == "ros_calibration.yaml")


@pytest.mark.parametrize("name", ["ost.yaml", "camera_info.yaml", "calibration.yml", "intrinsics.yaml"])
def test_a_file_of_the_folder_is_found(plain_folder, imported, small_views, name):
    folder = plain_folder((CAMERAS / "ros_message.yaml").read_text(), file=name)
    check_depth(imported(folder)[1], small_views, "opencv", "brown")


def test_a_recording_names_its_model_and_what_is_not_understood(
    plain_folder, imported, small_views, tmp_path
):
    header = imported(plain_folder())[0]
    numbers = WORDS["lenses"]["rational"]
    header["intrinsics"] |= {"distortion_model": "rational", "distortion": numbers, "dist_coeffs": [1]}
    header["views"][1]["exposure_ms"] = 8
    header["depth_units"] = 1
    (tmp_path / "imported").rename(tmp_path / "bent")
    (tmp_path / "bent/recording.json").write_text(json.dumps(header))
    _, depths, said = imported(tmp_path / "bent", "--without-masks")
    check_depth(depths, small_views, "opencv", "rational")
    assert "not used: intrinsics.dist_coeffs, views[1].exposure_ms, depth_units." in said


@pytest.mark.parametrize(("more", "words"), WORDS["named"])
def test_what_is_not_used_is_named(plain_folder, imported, more, words):
    said = imported(plain_folder(more))[2]
    assert "intrinsic.json: " in said
    assert words in said


@pytest.mark.parametrize(("more", "units_per_m"), WORDS["units_per_m"])
def test_units_of_depth_are_per_metre_or_metres(plain_folder, imported, small_views, more, units_per_m):
    depth_m = imported(plain_folder(more))[1][0]
    np.testing.assert_allclose(depth_m, small_views[1][0][1] / units_per_m, atol=6e-5)


@pytest.mark.parametrize(("more", "words"), WORDS["refused"])
def test_what_contradicts_or_is_impossible_is_one_line(plain_folder, refused, more, words):
    said = refused("check", str(plain_folder(more)), "--step", "10")
    assert "intrinsic.json: " in said
    assert words in said


@pytest.mark.parametrize(("file", "text", "words"), WORDS["kinds"])
def test_a_file_of_another_kind_is_one_line(plain_folder, refused, file, text, words):
    folder = plain_folder(text, file=file)
    said = refused("check", str(folder), "--step", "10", "--camera-file", str(folder / file))
    assert f"{file}: {words}" in said


def test_of_two_camera_files_the_one_that_is_not_used_is_named(plain_folder, capsys):
    folder = plain_folder()
    (folder / "camera.yaml").write_text("fx: 1\n")
    main(["check", str(folder), "--step", "10"])
    assert "the camera is that of intrinsic.json; camera.yaml is not used." in capsys.readouterr().out
