"""Names and numbers of other places: digits of all scripts, decimal commas, clocks, poor streams."""

import io
import json
import os
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from flatcloth.cli import main

WORDS = yaml.safe_load(Path(__file__).with_name("words.yaml").read_text(encoding="utf-8"))


@pytest.mark.parametrize(("text", "angles_deg"), WORDS["tables"])
def test_a_table_of_another_country_is_read(plain_folder, imported, tmp_path, text, angles_deg):
    (tmp_path / "turns.csv").write_text(text)
    header = imported(plain_folder(), "--angles", str(tmp_path / "turns.csv"))[0]
    assert [view["angle_deg"] for view in header["views"]] == angles_deg


def test_columns_that_are_not_understood_are_named(plain_folder, imported):
    folder = plain_folder()
    (folder / "angles.csv").write_text("view,angle_deg,tilt_deg,Height\n0,0,5,1\n1,10,5,1\n2,20,5,1\n")
    said = imported(folder, "--format", "color_and_depth")[2]
    assert "angles.csv: not understood, and not used: tilt_deg, Height." in said


def test_commas_that_may_be_decimal_or_not_are_told(plain_folder, refused):
    folder = plain_folder()
    (folder / "angles.csv").write_text("0,0\n10,5\n21,0\n")
    assert "separate the columns by semicolons" in refused("check", str(folder))


CLOCKS = {"s": "{}.{:03d}", "ms": "{}{:03d}", "us": "{}{:03d}000", "ns": "{}{:03d}000000"}


@pytest.mark.parametrize("lists", ["associations.txt", "rgb.txt"])
@pytest.mark.parametrize("clock", CLOCKS.values(), ids=CLOCKS)
def test_times_in_any_unit_pair_and_find_views(plain_folder, imported, small_views, tmp_path, clock, lists):
    folder = plain_folder({"depth_scale": 1000}, file="camera.json")
    color, depth = (
        [f"{clock.format(1305031100 + n, ms)} {kind}/{n:03d}.png" for n in range(3)]
        for kind, ms in (("color", 10), ("depth", 22))
    )
    (folder / lists).write_text(
        "\n".join([*map(" ".join, zip(color, depth, strict=True))] if lists[0] == "a" else color)
    )
    if lists == "rgb.txt":
        (folder / "depth.txt").write_text("\n".join(depth[::-1]))
    (tmp_path / "turns.csv").write_text("time_s,angle_deg\n0,0\n2,30\n")
    header, depths, said = imported(folder, "--angles", str(tmp_path / "turns.csv"))
    assert [view["angle_deg"] for view in header["views"]] == [0, 30]
    np.testing.assert_allclose(depths[1], small_views[1][2][1] * 0.001, atol=1e-4)
    assert "read as seconds" not in said


def test_whole_numbers_far_apart_are_doubted(plain_folder, imported):
    folder = plain_folder({"depth_scale": 1000}, file="camera.json")
    lines = [f"{33 * n} color/{n:03d}.png {33 * n} depth/{n:03d}.png" for n in range(3)]
    (folder / "associations.txt").write_text("\n".join(lines))
    assert "its times are read as seconds, 33 apart. Divide milliseconds by 1000." in imported(folder)[2]


ARRAYS: dict[str, Callable[[Any], Any]] = {
    "by columns": np.asfortranarray,
    "a list of one": lambda depth: depth[None],
    "one channel": lambda depth: depth[..., None],
    "one channel, by columns": lambda depth: np.asfortranarray(depth[..., None]),
    "metres, big-endian": lambda depth: (depth * 0.001).astype(">f8"),
}


@pytest.mark.parametrize("stored", ARRAYS.values(), ids=ARRAYS)
def test_an_array_in_any_order_is_read(plain_folder, imported, small_views, stored):
    folder = plain_folder()
    for n, (_, depth) in enumerate(small_views[1]):
        (folder / f"depth/{n:03d}.png").unlink()
        np.save(folder / f"depth/{n:03d}.npy", stored(depth))
    for depth_m, (_, depth) in zip(imported(folder)[1], small_views[1], strict=True):
        np.testing.assert_allclose(depth_m, depth * 0.001, atol=1e-4)


def test_an_orientation_that_is_not_followed_is_named(plain_folder, imported):
    from PIL import Image

    folder = plain_folder()
    for file in sorted((folder / "color").iterdir()):
        about = Image.Exif()
        about[0x0112] = 6
        Image.open(file).save(file.with_suffix(".jpg"), exif=about, quality=95)
        file.unlink()
    assert "000.jpg: not turned as its EXIF orientation says" in imported(folder)[2]


@pytest.mark.parametrize("names", WORDS["digits"])
def test_digits_of_all_scripts_count(plain_folder, imported, small_views, names):
    depths = imported(plain_folder(name=names.__getitem__))[1]
    for depth_m, (_, depth) in zip(depths, small_views[1], strict=True):
        np.testing.assert_allclose(depth_m, depth * 0.001, atol=1e-4)


@pytest.mark.parametrize("encoding", ["ascii", "koi8-r", "utf-8"])
def test_a_stream_that_lacks_a_character_gets_an_escape(plain_folder, tmp_path, monkeypatch, encoding):
    folder = plain_folder(folder="Hemd №1 シャツ")
    out, err = (io.TextIOWrapper(io.BytesIO(), encoding, write_through=True) for _ in range(2))
    monkeypatch.setattr(sys, "stdout", out)
    monkeypatch.setattr(sys, "stderr", err)
    assert main(["import", str(folder), "--step", "10", "--out", str(tmp_path / "Kopie ①")]) == 0
    assert main(["check", str(tmp_path / "nothing ①")]) == 2
    said, told = (stream.buffer.getvalue().decode(encoding) for stream in (out, err))
    assert said.count("\n") == 2
    circled = "①" if encoding == "utf-8" else "\\u2460"
    assert f"3 views, 0 to 20 degrees, written to {tmp_path}/Kopie {circled}" in said
    assert f"nothing {circled}: no such file" in told


@pytest.mark.parametrize("option", ["", "--out", "--log-file", "--angles", "--camera-file"])
def test_a_name_that_is_not_text_is_one_line_before_any_work(plain_folder, refused, tmp_path, option):
    source = str(plain_folder(folder="take" if option else "take\udcff"))
    given = ["--step", "10", "--out", str(tmp_path / "out")]
    more = [option, str(tmp_path / "o\udcff")] if option else []
    said = refused("import", source, *given, *more)
    assert "\\udcff': not a name in the encoding utf-8. Rename the file or folder." in said
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "name", ["take\n1", "take\x1b[31m", "take\u00a01", "take\u30001", "tak\u0301e", "ta\u200dke"]
)
def test_a_folder_of_any_name_is_read(plain_folder, imported, name):
    said = imported(plain_folder({"unknown": 1}, folder=name))[2]
    assert all(character.isprintable() or character in "\n\u00a0\u3000" for character in said)
    assert "intrinsic.json: not understood" in said


@pytest.mark.parametrize("name", ["a\n", "\x07", "\udcfe"])
def test_an_image_whose_name_cannot_be_printed_is_one_line(plain_folder, refused, name):
    said = refused("check", str(plain_folder(name=lambda n: f"{name}{n}")), "--step", "10")
    assert "Use printable characters only." in said


@pytest.mark.parametrize("name", ["out\n1", "out\x1b[2J"])
def test_nothing_is_lost_where_a_result_has_a_name_that_cannot_be_printed(
    plain_folder, tmp_path, capsys, name
):
    out = tmp_path / name
    log = tmp_path / f"{name}.log"
    given = ["import", str(plain_folder()), "--step", "10", "--out", str(out), "--log-file", str(log)]
    assert main(given) == 0
    said = capsys.readouterr()
    assert "Traceback" not in said.err
    assert ascii(name)[1:-1] in said.out
    assert len(json.loads((out / "recording.json").read_text())["views"]) == 3
    assert "3 views" in log.read_text()
    shutil.rmtree(os.fsencode(out))
