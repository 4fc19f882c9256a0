"""The outline of simple shapes, and its files, read back."""

import json
import math
import re
from dataclasses import replace

import ezdxf.filemanagement
import ezdxf.units
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from viewer_fakes import cylinder_view

from flatcloth.core.errors import FlatclothError
from flatcloth.export.outline import area_of, drawing, outline, outline_text, signed_area

SIZE_M = 0.002


def cloth(valid):
    """A view with this cloth; its other attributes do not matter here."""
    view = cylinder_view({0: 0.0})
    return replace(view, valid=np.asarray(valid, dtype=bool), pixel_size_m=SIZE_M, origin_uv_m=(0.5, -0.25))


def disc(radius_px, size=300):
    row, col = np.indices((size, size)) - (size - 1) / 2
    return np.hypot(row, col) <= radius_px


def test_a_rectangle_is_as_large_as_its_pixels():
    valid = np.zeros((60, 90), bool)
    valid[10:50, 20:80] = True
    ((outer,),) = outline(cloth(valid))
    assert signed_area(outer) == pytest.approx(40 * 60 * SIZE_M**2, rel=0.002)
    low, high = outer.min(axis=0), outer.max(axis=0)
    np.testing.assert_allclose(low, [0.5 + 19.5 * SIZE_M, -0.25 + 9.5 * SIZE_M], atol=1e-9)
    np.testing.assert_allclose(high, [0.5 + 79.5 * SIZE_M, -0.25 + 49.5 * SIZE_M], atol=1e-9)
    assert len(outer) <= 8


def test_a_discs_rim_is_as_long_and_as_round_as_it_should_be():
    ((outer,),) = outline(cloth(disc(120)))
    radius_m = 120 * SIZE_M
    assert signed_area(outer) == pytest.approx(math.pi * radius_m**2, rel=0.005)
    around = np.linalg.norm(outer - np.roll(outer, 1, axis=0), axis=1).sum()
    assert around == pytest.approx(2 * math.pi * radius_m, rel=0.01)
    center = np.array([0.5, -0.25]) + 149.5 * SIZE_M
    off = np.linalg.norm(outer - center, axis=1) - radius_m
    assert np.abs(off).max() < SIZE_M


def test_holes_go_the_other_way_and_small_ones_are_left_out():
    valid = disc(120)
    valid[140:160, 140:160] = False
    valid[80:82, 150] = False
    ((outer, hole),) = outline(cloth(valid))
    assert signed_area(outer) > 0 > signed_area(hole)
    assert signed_area(hole) == pytest.approx(-400 * SIZE_M**2, rel=0.01)


def test_pieces_come_by_size_each_with_its_own_holes():
    valid = np.zeros((100, 200), bool)
    valid[10:40, 10:40] = True
    valid[10:90, 60:160] = True
    valid[30:50, 80:100] = False
    large, small = outline(cloth(valid))
    assert (len(large), len(small)) == (2, 1)
    assert area_of(large) == pytest.approx((80 * 100 - 400) * SIZE_M**2, rel=0.01)


def test_pixels_that_touch_by_a_corner_are_pieces_of_their_own():
    valid = np.zeros((40, 40), bool)
    valid[5:15, 5:15] = valid[15:25, 15:25] = True
    assert len(outline(cloth(valid))) == 2


def test_without_cloth_there_is_no_outline():
    with pytest.raises(FlatclothError, match="no cloth with an outline"):
        outline(cloth(np.zeros((20, 20))))


@given(st.integers(0, 2**32 - 1))
def test_any_cloth_gives_closed_outlines_of_the_area_of_its_pixels(seed):
    valid = np.random.default_rng(seed).random((12, 15)) < 0.6
    pieces = outline(replace(cloth(valid), pixel_size_m=1.0, origin_uv_m=(0.0, 0.0)))
    assert all(np.isfinite(p[0]).all() and area_of(p) > -1e-9 for p in pieces)
    rim = sum(len(rim) for p in pieces for rim in p)
    # Each corner that is cut takes at most half a pixel, and thinning as much again.
    assert abs(sum(map(area_of, pieces)) - valid.sum()) <= rim + valid.sum() * 0.5


def test_the_svg_is_one_to_one():
    valid = np.zeros((200, 300), bool)
    valid[20:120, 30:280] = True
    text = outline_text(cloth(valid), "Tom & <Ann>", ".svg")
    width, height = map(float, re.search(r'width="([\d.]+)mm" height="([\d.]+)mm"', text).groups())
    assert re.search(rf'viewBox="0 0 {width:.2f} {height:.2f}"', text)
    path = re.search(r'<path d="M([^Z]+)Z"', text)[1]
    points = np.array([[float(x) for x in p.split()] for p in path.split("L")])
    np.testing.assert_allclose(np.ptp(points, axis=0), [500.0, 200.0], atol=0.02)
    assert points.min() == pytest.approx(10.0, abs=0.01)
    assert "Tom &amp; &lt;Ann&gt;" in text
    assert "h100v" in text  # the rule to check a print by


def test_a_cad_library_finds_closed_outlines_in_mm_on_their_layers_and_not_mirrored(tmp_path):
    valid = np.zeros((100, 100), bool)
    valid[10:90, 10:50] = True  # an L: its foot is to the right, below
    valid[70:90, 50:90] = True
    valid[30:50, 20:40] = False
    path = tmp_path / "l.dxf"
    path.write_text(outline_text(cloth(valid), "l", ".DXF"))
    document = ezdxf.filemanagement.readfile(path)
    assert not document.audit().errors
    assert document.units == ezdxf.units.MM
    assert {"OUTLINE", "HOLES"} <= {layer.dxf.name for layer in document.layers}
    drawn = drawing(cloth(valid), "l")
    (outer,), (hole,) = (
        list(document.modelspace().query(f'*[layer=="{name}"]')) for name in ("OUTLINE", "HOLES")
    )
    assert outer.is_closed
    assert hole.is_closed
    found = np.array([vertex.dxf.location.vec2 for vertex in outer.vertices])
    expected = drawn.pieces[0][0] * (1, -1) + (0, drawn.size_mm[1])
    np.testing.assert_allclose(found, expected, atol=0.001)
    np.testing.assert_allclose(np.ptp(found, axis=0), [160.0, 160.0], atol=0.02)
    foot = found[:, 0] > 90.0
    assert found[foot, 1].max() == pytest.approx(40.0, abs=1.3)  # y goes up: the foot is at the bottom


@pytest.mark.parametrize("suffix", [".svg", ".dxf"])
def test_drawings_are_upright_and_their_lengths_stay(suffix):
    valid = np.zeros((200, 300), bool)
    valid[20:120, 30:280] = True  # lies on its side
    turned = outline_text(cloth(valid), "shirt", suffix, upright_rad=np.pi / 2)
    if suffix == ".svg":
        path = re.search(r'<path d="M([^Z]+)Z"', turned)[1]
        points = np.array([[float(x) for x in p.split()] for p in path.split("L")])
    else:
        lines = turned.splitlines()
        pairs = list(zip(lines[::2], lines[1::2], strict=True))
        points = np.array([[float(v) for c, v in pairs if c == code] for code in ("10", "20")]).T
    np.testing.assert_allclose(np.ptp(points, axis=0), [200.0, 500.0], atol=0.02)
    plane = outline_text(cloth(valid), "shirt", ".json", upright_rad=np.pi / 2)
    assert plane == outline_text(cloth(valid), "shirt", ".json")


def test_the_json_leads_back_to_the_plane():
    valid = disc(100)
    valid[140:160, 140:160] = False
    view = cloth(valid)
    document = json.loads(outline_text(view, "disc", ".json"))
    (piece,), drawn = document["pieces"], drawing(view, "disc")
    assert document["format"] == "flatcloth-outline/1"
    assert document["unit"] == "mm"
    back = (np.array(piece["outer"]) + document["origin_uv_mm"]) / 1000
    np.testing.assert_allclose(back, outline(view)[0][0], atol=1e-6)
    assert len(piece["holes"]) == 1
    assert document["area_cm2"] == pytest.approx(drawn.area_cm2, abs=0.01)
    assert document["size"] == pytest.approx(drawn.size_mm, abs=1e-3)
