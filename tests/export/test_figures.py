"""Figures: drawings as SVG and PNG alike, their scales, and the files of a session."""

from __future__ import annotations

import io
import math
import re
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import FlattenedView
from flatcloth.engine.garment.recognition import KnownGarment
from flatcloth.export.curves import plan_of, side_of
from flatcloth.export.figures import all_figures, garment, maps, of_decision, write_figures
from flatcloth.export.report import report
from flatcloth.export.session import OpenedSession
from flatcloth.methods.answers import Plan
from flatcloth.rendering.charts import Frame, draw_axes, draw_ramp, nice_below
from flatcloth.rendering.drawing import Drawing, text_width
from flatcloth.rendering.pictures import NEW_RGB, OUTLINE_RGB, PlanePicture, cropped, laid_on, widened
from flatcloth.session.machine import Document

SVG = "{http://www.w3.org/2000/svg}"


def pixels(drawing: Drawing, scale: float = 1.0) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(drawing.png(scale))))


# --- drawings -------------------------------------------------------------------------------------


def test_lines_and_areas_are_painted_where_they_are_drawn() -> None:
    drawing = Drawing(40, 30)
    drawing.box(10, 5, 10, 20, "#ff0000")
    drawing.line(np.array([(30.0, 0.0), (30.0, 30.0)]), "#0000ff", 4)
    image = pixels(drawing)
    assert image.shape == (30, 40, 3)
    np.testing.assert_array_equal(image[15, 15], [255, 0, 0])
    np.testing.assert_allclose(image[15, 30], [0, 0, 255], atol=20)
    np.testing.assert_array_equal(image[2, 2], [255, 255, 255])
    assert pixels(drawing, 3.0).shape == (90, 120, 3)


def test_a_line_is_broken_where_a_value_is_missing() -> None:
    drawing = Drawing(40, 10)
    x = np.arange(0.0, 41.0, 4.0)
    y = np.full(x.size, 5.0)
    y[5] = math.nan
    drawing.line(np.stack([x, y], axis=1), "#000000", 2)
    (line,) = [
        p.attrib["d"]
        for p in ElementTree.fromstring(drawing.svg()).iter(f"{SVG}path")
        if "L" in p.attrib["d"]
    ][1:]
    assert line.count("M") == 2
    assert (pixels(drawing)[5, 20] > 200).all()
    assert (pixels(drawing)[5, 4] < 80).all()


def test_a_picture_is_painted_pixel_by_pixel_and_is_transparent_where_it_is() -> None:
    drawing = Drawing(20, 20)
    rgba = np.zeros((2, 2, 4), dtype=np.uint8)
    rgba[0, 0] = (10, 20, 30, 255)
    drawing.picture(rgba, 0, 0, 20, 20)
    image = pixels(drawing)
    np.testing.assert_array_equal(image[5, 5], [10, 20, 30])
    np.testing.assert_array_equal(image[15, 15], [255, 255, 255])


def test_text_is_escaped_and_read_aloud() -> None:
    drawing = Drawing(200, 40, about='shape "<1>"')
    drawing.text(5, 20, "a <b> & c\u00b2 \u2212")
    root = ElementTree.fromstring(drawing.svg())
    assert root.attrib["aria-label"] == 'shape "<1>"'
    assert [text.text for text in root.iter(f"{SVG}text")] == ["a <b> & c\u00b2 \u2212"]


def test_dollar_signs_are_no_formula_and_signs_without_a_glyph_no_warning() -> None:
    drawing = Drawing(200, 40)
    drawing.text(5, 20, "from $a_0$ to \u65e5\u672c")
    assert text_width("\u65e5\u672c", 12) > 0
    assert drawing.png()
    texts = [text.text for text in ElementTree.fromstring(drawing.svg()).iter(f"{SVG}text")]
    assert texts == ["from $a_0$ to \u65e5\u672c"]


def test_drawings_can_be_parts_of_one_page() -> None:
    ids = []
    for about in ("one", "two"):
        drawing = Drawing(200, 120, about)
        frame = Frame(left=30, top=30, width=150, height=50, x_range=(0, 1), y_range=(0, 1))
        draw_axes(drawing, frame, "x", "y").plot([0, 1], [0, 1])
        text = drawing.svg(paper=None)
        assert text.startswith("<svg ")
        assert "<style" not in text
        found = re.findall(r' id="([^"]*)"', text)
        assert set(re.findall(r"url\(#([^)]*)\)", text)) <= set(found)
        ids += found
    assert len(set(ids)) == len(ids)


@pytest.mark.parametrize(
    ("anchor", "low", "high"), [("start", 100, 190), ("middle", 60, 140), ("end", 10, 100)]
)
def test_text_stands_at_its_anchor(anchor: str, low: int, high: int) -> None:
    drawing = Drawing(200, 40)
    drawing.text(100, 25, "12 cm\u00b2 \u2212 3", 14, anchor=anchor)
    columns = np.flatnonzero((pixels(drawing) < 128).all(axis=2).any(axis=0))
    assert low <= columns.min() <= columns.max() <= high


def test_a_text_is_as_wide_as_it_is_painted() -> None:
    drawing = Drawing(200, 40)
    drawing.text(10, 25, "HcmH", 14, bold=True)
    columns = np.flatnonzero((pixels(drawing, 4.0) < 128).all(axis=2).any(axis=0))
    assert (columns.max() - columns.min()) / 4 == pytest.approx(text_width("HcmH", 14, bold=True), abs=3)


# --- scales ---------------------------------------------------------------------------------------


@given(st.floats(1e-9, 1e9))
def test_a_scale_bar_is_round_and_fits(value: float) -> None:
    nice = nice_below(value)
    assert 0.39 * value <= nice <= value * (1 + 1e-9)
    assert f"{nice:.0e}"[0] in "125"


def test_axes_place_values_upwards_and_powers_evenly() -> None:
    drawing = Drawing(200, 100)
    frame = Frame(left=10, top=20, width=100, height=50, x_range=(0, 10), y_range=(1e-4, 1), log_y=True)
    axes = draw_axes(drawing, frame, "", "")
    placed = axes.transData.transform([(0.0, 1e-4), (5.0, 1e-2), (10.0, 1.0)])
    placed[:, 1] = drawing.height - placed[:, 1]
    np.testing.assert_allclose(placed, [[10, 70], [60, 45], [110, 20]], atol=1e-6)


@pytest.mark.parametrize(("low", "high"), [(3.0, 3.0), (math.nan, 1.0), (-1300.0, 0.0), (0.01, 0.03)])
def test_a_ramp_has_the_ticks_of_its_range(low: float, high: float) -> None:
    drawing = Drawing(100, 200)
    draw_ramp(drawing, 10, 10, 170, ["#000000", "#ffffff"], low, high)
    texts = [text.text for text in ElementTree.fromstring(drawing.svg()).iter(f"{SVG}text")]
    found = [float(text.replace("\u2212", "-")) for text in texts]
    if not math.isfinite(low):
        assert found == []
    elif low == high:
        assert found == [low]
    else:
        assert 3 <= len(found) <= 7
        assert low <= min(found) < max(found) <= high
    image = pixels(drawing)
    assert image[170, 15].max() < 20  # the first colour is at the bottom
    assert image[20, 15].min() > 235


def test_a_chart_of_one_value_has_axes_too() -> None:
    drawing = Drawing(200, 100)
    frame = Frame(left=40, top=20, width=100, height=50, x_range=(1, 1), y_range=(2, 2))
    draw_axes(drawing, frame, "x", "y")
    assert drawing.png()


# --- pictures of the plane ------------------------------------------------------------------------


def view_of(valid: np.ndarray, origin_px: tuple[int, int], grey: int) -> FlattenedView:
    shape = valid.shape
    return FlattenedView(
        rgb=np.full((*shape, 3), grey, np.uint8), xyz_m=np.zeros((*shape, 3), np.float32),
        normal=np.zeros((*shape, 3), np.float32), z_angle_deg=np.zeros(shape, np.float32), valid=valid,
        view_index=np.zeros(shape, np.int16), source_rc=np.zeros((*shape, 2), np.float32),
        pixel_size_m=0.002, origin_uv_m=(0.002 * origin_px[0], 0.002 * origin_px[1]),
    )  # fmt: skip


def test_a_proposal_lies_on_the_shape_where_it_belongs() -> None:
    shape = view_of(np.ones((10, 12), bool), (0, 0), 100)
    overlay = view_of(np.ones((6, 8), bool), (-4, 3), 200)  # four columns of it lie beyond the shape
    fresh = np.zeros((6, 8), bool)
    fresh[:, :4] = True
    picture = laid_on(shape, overlay, fresh)
    assert picture.rgba.shape == (10, 16, 4)
    assert picture.origin_uv_m == pytest.approx((-0.008, 0.0))
    np.testing.assert_array_equal(picture.rgba[3, 5, :3], OUTLINE_RGB)
    np.testing.assert_array_equal(picture.rgba[5, 6, :3], [200, 200, 200])  # common to both: as it was seen
    tinted = np.rint(0.55 * 200 + 0.45 * np.array(NEW_RGB)).astype(int)
    np.testing.assert_allclose(picture.rgba[5, 2, :3], tinted, atol=1)  # what it adds
    assert picture.rgba[0, 0, 3] == 0
    assert (picture.rgba[9, 12, :3] > 150).all()  # the shape, pale


def test_a_picture_loses_its_empty_rim() -> None:
    valid = np.zeros((30, 40), bool)
    valid[10:15, 20:30] = True
    picture = cropped(np.zeros((30, 40, 4), np.uint8), view_of(valid, (0, 0), 0), margin_px=2)
    assert picture.rgba.shape == (9, 14, 4)
    assert picture.origin_uv_m == pytest.approx((0.036, 0.016))


# --- the figures of a session ---------------------------------------------------------------------


def test_every_figure_is_written_twice_and_the_same_each_time(session: OpenedSession, tmp_path: Path) -> None:
    files = write_figures(session, tmp_path / "one")
    names = {path.stem for path in files}
    assert {
        f"map-{n}" for n in ("color", "height", "z-angle", "source", "stretch", "incidence", "density")
    } < names
    assert {"curves-view-0", "curves-view-1", "curves-view-2"} < names
    assert {"growth", "energy", "decision-01-view-1-overlay", "decision-03-view-2-plan"} < names
    assert "decision-02-view-1-plan" not in names  # the operator chose that view: no plan is behind it
    assert {path.suffix for path in files} == {".png", ".svg"}
    assert len(files) == 2 * len(names)
    again = write_figures(session, tmp_path / "two")
    assert [p.read_bytes() for p in files] == [p.read_bytes() for p in again]
    for path in files:
        if path.suffix == ".svg":
            assert ElementTree.fromstring(path.read_text()).attrib["aria-label"]
        else:
            with Image.open(path) as image:
                assert image.width > 300


def test_figures_tell_what_happened(session: OpenedSession) -> None:
    made = {figure.name: figure for figure in all_figures(session)}
    refused = made["decision-01-view-1-overlay"].drawing
    assert "rejected, bad depth, score 0." in refused.about
    assert "taken back" in refused.about
    text = "".join(ElementTree.fromstring(made["growth"].drawing.svg()).itertext())
    for step in session.growth.steps:
        assert f"{step.angle_deg:g}\u00b0" in text
    assert f"{1e4 * session.growth.view.area_m2:.0f} cm\u00b2" in made["map-color"].caption
    assert re.search(r"A_0 = .?\d+\u00b0", made["decision-03-view-2-plan"].drawing.svg())


def test_the_garment_is_drawn_with_its_outline_and_told_in_report_and_page(session: OpenedSession) -> None:
    known = session.garment
    assert isinstance(known, KnownGarment)
    (figure,) = garment(session)
    kind = known.found.kind.replace("_", " ")
    seen = sum(point.pixel is not None for point in known.found.points.values())
    assert figure.caption.startswith(f"Garment: {kind}, ")
    assert f"{seen} of {len(known.found.points)} named points seen" in figure.caption
    texts = [text for text in re.findall(r">([^<>]+)<", figure.drawing.svg()) if text.strip()]
    assert set(known.found.points) <= set(texts)
    # The whole outline is on the picture, beyond the cloth that was seen too.
    wide = widened(
        PlanePicture(rgba=np.zeros((10, 20, 4), dtype=np.uint8), pixel_size_m=0.01, origin_uv_m=(0.0, 0.0)),
        np.array([[-0.05, 0.02], [0.31, 0.2]]),
    )
    assert wide.origin_uv_m == pytest.approx((-0.08, -0.01))
    assert wide.rgba.shape[:2] == (10 + 1 + 13, 20 + 8 + 14)


def test_picks_are_marked_on_the_shape(session: OpenedSession) -> None:
    (shape,) = maps(session, ("color",))
    text = [t.text for t in ElementTree.fromstring(shape.drawing.svg()).iter(f"{SVG}text")]
    assert {"1", "2"} <= set(text)
    assert "3" not in text  # it does not lie on the shape


def test_a_decision_by_hand_has_its_picture_only(session: OpenedSession) -> None:
    kinds = [[f.name.rsplit("-", 1)[1] for f in of_decision(session, d)] for d in session.history.decisions]
    assert kinds == [["overlay"], ["overlay"], ["overlay", "plan"]]


def test_a_method_that_plans_without_sides_has_its_pictures_too(session: OpenedSession) -> None:
    class Otherwise:
        """The integration of the session, with plans that know no sides."""

        def __getattr__(self, name: str) -> object:
            return getattr(session.integration, name)

        def plan(self, document: Document) -> Plan:
            return replace(session.integration.plan(document), sides=(), reason="967 cm2 new")

    other = OpenedSession(session.history, Otherwise())  # type: ignore[arg-type]
    assert [f.name for f in of_decision(other, session.history.decisions[2])] == [
        "decision-03-view-2-overlay"
    ]
    text = report(other)
    assert "967 cm² new" in text
    assert "h(u) and A_z(u) of view 2" in text


def test_a_shape_from_which_nothing_can_be_planned_any_more_has_no_plan(session: OpenedSession) -> None:
    class Stuck:
        axis = session.integration.axis

        def plan(self, _document: Document) -> Plan:
            raise FlatclothError("nothing to plan")

    stuck = OpenedSession(session.history, Stuck())  # type: ignore[arg-type]
    assert plan_of(stuck, session.history.decisions[2]) is None
    assert side_of(None, session.history.decisions[2]) is None
