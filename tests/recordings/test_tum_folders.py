"""TUM RGB-D folders: lists of color and depth images with their times."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from foreign_folders import HEIGHT, WIDTH, depth_m, refused, rgb, write, write_tum

from flatcloth.recordings import open_recording


@pytest.mark.parametrize("associations", [True, False])
def test_a_folder_is_read_with_5000_units_per_metre(tmp_path: Path, associations: bool) -> None:
    recording = open_recording(write_tum(tmp_path / "tum", associations=associations), step_deg=-30)
    assert (recording.name, len(recording)) == ("tum", 3)
    assert recording.angles_deg == (0.0, -30.0, -60.0)
    assert (recording.rotation_axis, recording.held_point_m, recording.has_masks) == (None, None, False)
    assert (recording.intrinsics.fx, recording.intrinsics.cx) == (20.0, 7.5)
    for n in range(3):
        frame = recording[n]
        np.testing.assert_array_equal(frame.color, rgb(n))
        np.testing.assert_allclose(frame.depth_m, depth_m(n), atol=1e-4)
        assert (frame.depth_m.dtype, frame.mask) == (np.float32, None)


def test_a_list_of_the_folder_opens_it(tmp_path: Path) -> None:
    folder = write_tum(tmp_path / "tum")
    assert len(open_recording(folder / "associations.txt", step_deg=10)) == 3


def test_associations_may_name_depth_first(tmp_path: Path) -> None:
    folder = write_tum(tmp_path / "tum")
    rows = [line.split() for line in (folder / "associations.txt").read_text().splitlines()]
    (folder / "associations.txt").write_text("\n".join(" ".join(r[2:] + r[:2]) for r in rows))
    np.testing.assert_array_equal(open_recording(folder, step_deg=10)[2].color, rgb(2))


def test_lists_are_paired_by_the_nearest_time_and_what_has_no_partner_is_left_out(tmp_path: Path) -> None:
    folder = write_tum(tmp_path / "tum", associations=False)
    lines = (folder / "depth.txt").read_text().splitlines()
    # Another depth image shortly after the first, none near the second, and the list out of order.
    write(folder / "depth" / "late.png", np.full((HEIGHT, WIDTH), 1, dtype=np.uint16))
    (folder / "depth.txt").write_text("\n".join([lines[3], "1305031102.192 depth/late.png", lines[1]]))
    recording = open_recording(folder, step_deg=10)
    assert [round(float(recording[n].depth_m.max()), 2) for n in range(len(recording))] == [0.80, 0.82]


def test_a_kinect_sized_folder_without_a_camera_says_what_it_assumes(tmp_path: Path) -> None:
    folder = write_tum(tmp_path / "tum", 1)
    for file in (*folder.glob("rgb/*.png"), *folder.glob("depth/*.png")):
        large = cv2.resize(cv2.imread(str(file), cv2.IMREAD_UNCHANGED), (640, 480))
        cv2.imwrite(str(file), large)
    (folder / "calibration.txt").unlink()
    recording = open_recording(folder, step_deg=10)
    assert recording.intrinsics.fx == 525.0
    assert "Kinect" in recording.notes[0]  # type: ignore[attr-defined]


def test_what_is_wrong_is_one_line(tmp_path: Path) -> None:
    folder = write_tum(tmp_path / "tum")
    good = (folder / "associations.txt").read_text()
    for text, cause in (
        ("# nothing\n", "lists no images"),
        ("1.0 rgb/a.png\n", "line 1 has 2 columns"),
        (good.replace("1305031102.175304 ", "now ", 1), "line 1 has the time now"),
        (good.replace("1305031102.175304 ", "nan ", 1), "line 1 has the time nan"),
        (good.replace(" rgb/", " ../rgb/", 1), "inside the folder"),
        (good.replace(" rgb/", " /rgb/", 1), "inside the folder"),
        (good.replace(" rgb/1305031102", " rgb/other", 1), "No such file"),
    ):
        (folder / "associations.txt").write_text(text)
        refused(folder, cause)
    (folder / "associations.txt").write_bytes(b"\xff\xfe\x00")
    refused(folder, "not UTF-8")
    (folder / "associations.txt").write_text(good)
    refused(folder, "the angles of its 3 views are not known", step_deg=None)
    (folder / "calibration.txt").write_text("20 20")
    refused(folder, "not a line of numbers|is not a line of numbers")
    (folder / "calibration.txt").write_text("20 20 7 five")
    refused(folder, "is not a line of numbers")
    (folder / "calibration.txt").write_text("20 20 7 5 9 9 9 9 -9e9")
    refused(folder, "folds the image")
    (folder / "calibration.txt").unlink()
    assert "intrinsic.json" in refused(folder, "camera is not described")
    folder = write_tum(tmp_path / "lists", associations=False)
    lines = (folder / "depth.txt").read_text()
    (folder / "depth.txt").write_text(lines.replace("\n13050311", "\n14050311"))
    refused(folder, "within 0.02 s")
    (folder / "depth.txt").write_text(lines)
    write(next(folder.glob("depth/*.png")), np.ones((HEIGHT, WIDTH + 1), dtype=np.uint16))
    refused(folder, "17x12 px, but the intrinsics are for 16x12")
