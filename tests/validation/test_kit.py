"""A kit: its cells, its file, its pages measured in pixels, and the commands that make and print it."""

from __future__ import annotations

import json
import re

import cv2
import numpy as np
import pypdfium2
import pytest
from garment_meshes import arc, write_obj

from flatcloth.cli import main
from flatcloth.core.errors import FlatclothError
from flatcloth.recordings import open_recording
from flatcloth.recordings.truth import Truth
from flatcloth.validation.kit import HEM_M, KitError, dictionary_codes, grid_kit, read_kit, write_kit
from flatcloth.validation.markers import found_markers
from flatcloth.validation.printing import pdf_of, svg_of, tiles, whole_pages

PX_PER_MM = 8.0


def test_a_kit_reads_as_it_was_written(tmp_path):
    kit = grid_kit((0.5, 0.4), 0.03, 2)
    write_kit(kit, tmp_path / "kit.json")
    read = read_kit(tmp_path / "kit.json")
    assert (read.name, read.dictionary, read.size_m) == (kit.name, kit.dictionary, kit.size_m)
    assert (read.sheet, read.is_measured) == (kit.sheet, True)
    for i, places in kit.corners_m.items():
        np.testing.assert_allclose(read.corners_m[i], places, atol=1e-6)


def test_sheets_share_no_id_and_cells_lie_within_the_hem():
    kit = grid_kit((0.8, 0.6), 0.03, 2)
    assert list(kit.corners_m) == list(range(950))
    assert [list(kit.sheet.values()).count(n) for n in (1, 2)] == [475, 475]
    corners = np.stack(list(kit.corners_m.values()))
    assert corners.min() >= HEM_M
    assert (corners.reshape(-1, 2).max(axis=0) <= np.array(kit.size_m) - HEM_M).all()
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    np.testing.assert_allclose(sides, 0.024)


def test_too_many_cells_are_refused_with_a_cell_that_fits():
    with pytest.raises(KitError, match="1950 cells") as error:
        grid_kit((1.2, 0.8), 0.03, 2)
    cell = re.search(r"--cell (\d+), or", str(error.value))
    assert cell is not None
    assert len(grid_kit((1.2, 0.8), int(cell[1]) / 1e3, 2).corners_m) > 900
    with pytest.raises(KitError, match=r"0 cells fit.*larger --size"):
        grid_kit((0.04, 0.8), 0.03, 1)
    for size_m, cell_m, stickers in (((9, 9), 0.03, None), ((1, 1), 0.0, None), ((1, 1), 0.03, 0)):
        with pytest.raises(KitError, match="choose cells of 5 to 180 mm"):
            grid_kit(size_m, cell_m, 1, stickers)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda kit: kit.pop("size_mm"), "size_mm is missing"),
        (lambda kit: kit.update(format="flatcloth-kit/9"), "format is 'flatcloth-kit/9'"),
        (lambda kit: kit.update(dictionary="DICT_ROMAN"), "DICT_ROMAN is no dictionary of OpenCV"),
        (lambda kit: kit["markers"].clear(), "markers is a list of 0"),
        (lambda kit: kit["markers"][1].update(id=0), "marker 0 is there twice"),
        (lambda kit: kit["markers"][1].update(id=900), "marker 900 is not one of DICT_APRILTAG_36h11"),
        (lambda kit: kit["markers"][1]["corners_mm"].reverse(), "marker 1 has corners that do not go around"),
        (lambda kit: kit["markers"][1].update(sheet=3), "markers[1].sheet is 3"),
        (lambda kit: kit["markers"][1]["corners_mm"][0].append(0), "markers[1].corners_mm[0] is a list of 3"),
        (lambda kit: kit["size_mm"].__setitem__(0, float("nan")), "size_mm[0] is not a finite number"),
    ],
)  # fmt: skip
def test_a_wrong_file_is_named_in_one_line_with_a_remedy(tmp_path, change, said):
    kit_file = tmp_path / "kit.json"
    write_kit(grid_kit((0.1, 0.07), 0.02, 1), kit_file)
    document = json.loads(kit_file.read_text())
    change(document)
    kit_file.write_text(json.dumps(document))
    with pytest.raises(FlatclothError) as error:
        read_kit(kit_file)
    line = str(error.value)
    assert line.startswith(f"{kit_file}: {said}"), line
    assert line.endswith("flatcloth kit.")
    assert "\n" not in line


def painted(data: bytes, page: int = 0) -> np.ndarray:
    """A page of a PDF in gray, ``PX_PER_MM``."""
    bitmap = pypdfium2.PdfDocument(data)[page].render(scale=PX_PER_MM * 25.4 / 72 * (1 - 1e-6))
    return np.asarray(bitmap.to_numpy()[..., 0], dtype=np.uint8)


def measured_mm(page: np.ndarray, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Left, top, width, height in mm of the largest black parts of a page, and of the longest of lines."""
    found = cv2.connectedComponentsWithStats((page < 128).astype(np.uint8))[2][1:, :5] / PX_PER_MM
    area = found[:, 2] * found[:, 3]
    return found[np.argsort(-area)[:number], :4], found[found[:, 2].argmax(), :4]


def test_a_whole_page_measures_as_the_kit_says_to_a_tenth_of_a_millimetre():
    kit = grid_kit((0.2, 0.15), 0.03, 2)
    data = pdf_of(whole_pages(kit))
    assert len(pypdfium2.PdfDocument(data)) == 2
    page = painted(data, 1)
    assert page.shape == (150 * PX_PER_MM, 200 * PX_PER_MM)
    second = [i for i in kit.sheet if kit.sheet[i] == 2]
    markers, bar = measured_mm(page, len(second))
    expected = np.array([[*kit.corners_m[i][0], 0.024, 0.024] for i in second]) * 1e3
    order = np.lexsort((markers[:, 0].round(), markers[:, 1].round()))
    np.testing.assert_allclose(markers[order], expected, atol=0.1)
    np.testing.assert_allclose(bar[2], 100.25, atol=0.1)
    codes = dictionary_codes(kit.dictionary)[second]
    modules = 3 * np.stack(np.meshgrid(np.arange(8), np.arange(8)), axis=-1).reshape(-1, 2) + 1.5
    middle = ((expected[:, None, :2] + modules) * PX_PER_MM).astype(int)
    assert ((page[middle[..., 1], middle[..., 0]] < 128) == codes.reshape(len(second), -1)).all()


def test_a4_pages_show_each_cell_whole_once_and_overlap():
    kit = grid_kit((0.45, 0.3), 0.03, 1)
    pages = tiles(kit)
    assert pages[4].axes[0].texts[0].get_text().endswith("page 5, row 2 of 2, column 2 of 3")
    assert len(pages) == 6
    first, second = (painted(pdf_of(pages), n) for n in (0, 1))
    assert first.shape == (297 * PX_PER_MM, 210 * PX_PER_MM)
    markers, bar = measured_mm(first, 48)
    np.testing.assert_allclose(markers[:, 2:], 24.0, atol=0.1)
    np.testing.assert_allclose(bar[2], 100.25, atol=0.1)
    # The last 5 mm of a page's own cells, and 5 mm beyond, are on the next page 180 mm to the left.
    rows, shift = slice(round(30 * PX_PER_MM), round(260 * PX_PER_MM)), round(180 * PX_PER_MM)
    strip = slice(round(191 * PX_PER_MM), round(199.5 * PX_PER_MM))
    left = slice(strip.start - shift, strip.stop - shift)
    assert (np.abs(first[rows, strip].astype(int) - second[rows, left]) < 128).mean() > 0.999


def test_the_svg_has_the_squares_of_the_codes():
    kit = grid_kit((0.15, 0.1), 0.03, 1)
    svg = svg_of(whole_pages(kit)[0]).decode()
    assert re.search(r'width="425\.19\d*pt" height="283\.46\d*pt" viewBox="0 0 425\.19\d* 283\.46', svg)
    boxes = max(re.findall(r'd="([^"]+)"', svg), key=len)
    corners = np.array(re.findall(r"M ([\d.]+) ([\d.]+)", boxes), dtype=float) * 25.4 / 72
    assert len(corners) == dictionary_codes(kit.dictionary)[: len(kit.corners_m)].sum()
    np.testing.assert_allclose(corners[0], 1e3 * kit.corners_m[0][0], atol=1e-3)


def test_the_command_writes_a_kit_and_refuses_in_one_line(tmp_path, capsys):
    out = tmp_path / "kit"
    assert main(["kit", "--out", str(out), "--size", "0.3x0.2", "--sides", "2", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert {path.name for path in out.iterdir()} == set(said["written"])
    assert said["markers"] == len(read_kit(out / "kit.json").corners_m) == 90
    kept = (out / "kit.json").read_bytes()
    assert main(["kit", "--out", str(out)]) == 2
    assert "has a kit already" in capsys.readouterr().err
    assert (out / "kit.json").read_bytes() == kept
    assert main(["kit", "--out", str(out), "--sides", "2"]) == 2
    with pytest.raises(SystemExit, match="2"):
        main(["kit", "--out", str(out), "--size", "1,2"])
    assert "as 1.2x0.8" in capsys.readouterr().err


def test_a_printed_recording_keeps_its_kit_and_reads_right_on_both_panels(tmp_path):
    front, back = arc(160.0), arc(160.0, start_deg=100.0)
    mesh = write_obj(
        tmp_path / "tube.obj",
        np.concatenate([front[0], back[0]]),
        np.concatenate([front[1], back[1] + len(front[0])]),
        groups={"front": np.arange(len(front[1])), "back": np.arange(len(back[1])) + len(front[1])},
    )
    file, out = tmp_path / "kit.json", tmp_path / "made"
    write_kit(kit := grid_kit((0.25, 0.28), 0.04, 2), file)
    camera = ["--size", "240", "360", "--focal", "500", "--distance", "0.6", "--step", "90"]
    assert main(["synthesize", str(mesh), "--texture", str(file), "--out", str(out), *camera]) == 0
    assert read_kit(out / "kit.json").name == kit.name
    recording, truth = open_recording(out), Truth(out)
    for sheet in (1, 2):
        off_m = []
        for n in range(4):
            seen = found_markers(recording[n].color, kit)
            for i, corners in seen.items():
                col, row = np.rint(corners.mean(axis=0)).astype(int)
                if kit.sheet[i] == sheet:
                    assert truth[n].panel[row, col] == sheet
                    off_m.append(truth[n].flat_uv_m[row, col] - kit.corners_m[i].mean(axis=0))
        assert len(off_m) > 10
        # The same shift for all, to a pixel of 1.2 mm seen obliquely: nothing is scaled or mirrored.
        np.testing.assert_allclose(np.median(off_m, axis=0), np.array(kit.size_m) / -2, atol=0.0005)
        assert np.abs(off_m + np.array(kit.size_m) / 2).max() < 0.005
