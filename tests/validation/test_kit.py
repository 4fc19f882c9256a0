"""A kit: its cells, its file, its pages measured in pixels, and the commands that make and print it."""

import json
import re
from pathlib import Path

import cv2
import numpy as np
import pypdfium2
import pytest
from garment_meshes import arc, write_obj

from flatcloth.cli import main
from flatcloth.core.errors import FlatclothError
from flatcloth.recordings import open_recording
from flatcloth.recordings.truth import Truth
from flatcloth.validation.kit import (
    KitError,
    dictionary_codes,
    grid_kit,
    printed_cloth,
    read_kit,
    write_kit,
    write_pages,
)
from flatcloth.validation.markers import found_markers

PX_PER_MM = 8.0


@pytest.mark.parametrize(
    ("size_m", "cell_m", "sides", "fit"),
    [
        ((1.2, 0.8), 0.03, 2, 1950),
        ((0.04, 0.8), 0.03, 1, 0),
        ((5.1, 0.8), 0.18, 1, 112),
        ((4.0, 4.0), 0.2, 1, 361),
    ],
)
def test_what_cannot_be_printed_is_refused_with_what_can(size_m, cell_m, sides, fit):
    with pytest.raises(KitError, match=rf"^{fit} cells fit\. Choose 6 to 1000: --size up to 5 m, --cell"):
        grid_kit(size_m, cell_m, sides)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda kit: kit["markers"].clear(), "markers is a list of 0"),
        (lambda kit: kit.update(dictionary="DICT_4X4_50"), "dictionary"),
        (lambda kit: kit["markers"][1].update(id=0), "an id is there twice"),
        (lambda kit: kit["markers"][1].update(id=1000), "an id is there twice or unknown"),
        (lambda kit: kit["markers"][1]["corners_mm"].reverse(), "an id is there twice or unknown"),
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


def painted(file: Path, page: int = 0) -> np.ndarray:
    """A page of a PDF in gray, ``PX_PER_MM``."""
    bitmap = pypdfium2.PdfDocument(file)[page].render(scale=PX_PER_MM * 25.4 / 72 * (1 - 1e-6))
    return np.asarray(bitmap.to_numpy()[..., 0], dtype=np.uint8)


def measured_mm(page: np.ndarray, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Left, top, width, height in mm of the largest black parts of a page, and of the longest of lines."""
    found = cv2.connectedComponentsWithStats((page < 128).astype(np.uint8))[2][1:, :5] / PX_PER_MM
    area = found[:, 2] * found[:, 3]
    return found[np.argsort(-area)[:number], :4], found[found[:, 2].argmax(), :4]


def test_a_whole_page_measures_as_the_kit_says_to_a_tenth_of_a_millimetre(tmp_path):
    kit = grid_kit((0.2, 0.15), 0.03, 2)
    write_pages(kit, tmp_path / "kit")
    assert len(pypdfium2.PdfDocument(tmp_path / "kit" / "kit-whole.pdf")) == 2
    assert (printed_cloth(kit)(np.mgrid[0.12:1.2:0.01, -0.07:0.07:0.01].reshape(2, -1).T, 1) > 0.5).all()
    page = painted(tmp_path / "kit" / "kit-whole.pdf", 1)
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
    svg = (tmp_path / "kit" / "kit-sheet-2.svg").read_text()
    assert re.search(r'width="566\.92\d*pt" height="425\.19\d*pt" viewBox="0 0 566\.92\d* 425\.19', svg)
    boxes = max(re.findall(r'd="([^"]+)"', svg), key=len)
    corners = np.array(re.findall(r"M ([\d.]+) ([\d.]+)", boxes), dtype=float) * 25.4 / 72
    assert len(corners) == codes.sum()
    np.testing.assert_allclose(corners[0], expected[0, :2], atol=1e-3)


def test_a4_pages_show_each_cell_whole_once(tmp_path):
    write_pages(grid_kit((0.45, 0.3), 0.03, 1), tmp_path / "kit")
    pages = pypdfium2.PdfDocument(tmp_path / "kit" / "kit-a4.pdf")
    assert "page 5, row 2 of 2, column 2 of 3" in pages[4].get_textpage().get_text_range()
    found = [painted(tmp_path / "kit" / "kit-a4.pdf", n) for n in range(len(pages))]
    assert found[0].shape == (297 * PX_PER_MM, 210 * PX_PER_MM)
    for page, count in zip(found, (48, 48, 16, 6, 6, 2), strict=True):
        markers, bar = measured_mm(page, count)
        np.testing.assert_allclose(markers[:, 2:], 24.0, atol=0.1)
        np.testing.assert_allclose(bar[2], 100.25, atol=0.1)


def test_the_command_writes_a_kit_and_refuses_in_one_line(tmp_path, capsys):
    out = tmp_path / "kit"
    assert main(["kit", "--out", str(out), "--size", "0.3x0.2", "--sides", "2", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert {path.name for path in out.iterdir()} == set(said["written"])
    assert said["markers"] == len(read_kit(out / "kit.json").corners_m) == 90
    assert main(["kit", "--out", str(out), "--size", "0.3x0.2"]) == 2
    assert "Name a new folder" in capsys.readouterr().err
    assert main(["kit", "--out", str(out), "--cell", "nan"]) == 2
    assert "--cell 5 to 180" in capsys.readouterr().err
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
    off_m: dict[int, list[np.ndarray]] = {1: [], 2: []}
    for n in range(4):
        for i, corners in found_markers(recording[n].color, kit).items():
            col, row = np.rint(corners.mean(axis=0)).astype(int)
            assert truth[n].panel[row, col] == kit.sheet[i]
            off_m[kit.sheet[i]].append(truth[n].flat_uv_m[row, col] - kit.corners_m[i].mean(axis=0))
    for found in off_m.values():
        assert len(found) > 10
        # The same shift for all, to a pixel of 1.2 mm seen obliquely: nothing is scaled or mirrored.
        np.testing.assert_allclose(np.median(found, axis=0), np.array(kit.size_mm) / -2e3, atol=0.0005)
        assert np.abs(found + np.array(kit.size_mm) / 2e3).max() < 0.005
