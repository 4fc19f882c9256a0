"""Figures: drawings as SVG and PNG alike, their scales, and the files of a session."""

import base64
import io
import re
import zipfile
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from garment_evidence import blank_view
from matplotlib.figure import Figure as Drawing
from PIL import Image

from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import FlattenedView
from flatcloth.engine.garment import KnownGarment
from flatcloth.export.by_name import made
from flatcloth.export.figures import all_figures, garment, maps, plan_of, side_of
from flatcloth.export.report import report
from flatcloth.export.session import OpenedSession
from flatcloth.methods.answers import Plan
from flatcloth.rendering.drawing import drawn, painted, show_picture, svg_of
from flatcloth.rendering.pictures import NEW_RGB, OUTLINE_RGB, PlanePicture, laid_on
from flatcloth.session.document import Document

SVG = "{http://www.w3.org/2000/svg}"


def pixels(figure: Drawing) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(painted(figure))))[..., :3]


def texts_of(figure: Drawing) -> list[str | None]:
    return [text.text for text in ElementTree.fromstring(svg_of(figure, "")).iter(f"{SVG}text")]


# --- drawings -------------------------------------------------------------------------------------


def test_a_picture_is_painted_pixel_by_pixel_and_is_transparent_where_it_is() -> None:
    rgba = np.zeros((2, 2, 4), dtype=np.uint8)
    rgba[0, 0] = (10, 20, 30, 255)
    drawing, (axes,) = drawn(20, 20, "")
    show_picture(axes, PlanePicture(rgba=rgba, pixel_size_m=0.1, origin_uv_m=(0.0, 0.0)), most=0.5)
    colors, count = np.unique(pixels(drawing).reshape(-1, 3), axis=0, return_counts=True)
    assert (
        count[(colors == (10, 20, 30)).all(axis=1)] == 20 * 20
    )  # a quarter of the picture, two pixels a point
    held = re.search(r'xlink:href="data:image/png;base64,([^"]+)"', svg_of(drawing, ""))
    np.testing.assert_array_equal(np.asarray(Image.open(io.BytesIO(base64.b64decode(held[1])))), rgba)


def test_text_is_escaped_and_read_aloud_and_dollar_signs_are_no_formula() -> None:
    for said in ("a <b> & c\u00b2 \u2212", "from $a_0$ to \u65e5\u672c"):  # the font has no such signs
        drawing, _ = drawn(200, 40, said)
        assert painted(drawing)
        root = ElementTree.fromstring(svg_of(drawing, 'shape "<1>"'))
        assert root.findtext(f"{SVG}title") == 'shape "<1>"'
        assert said in texts_of(drawing)


# --- pictures of the plane ------------------------------------------------------------------------


def view_of(valid: np.ndarray, origin_px: tuple[int, int], grey: int) -> FlattenedView:
    origin_uv_m = (0.002 * origin_px[0], 0.002 * origin_px[1])
    return blank_view(valid, rgb=np.full((*valid.shape, 3), grey, np.uint8), origin_uv_m=origin_uv_m)


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


# --- the figures of a session ---------------------------------------------------------------------


def test_every_figure_has_two_files(figures: dict[str, bytes]) -> None:
    names = {Path(file).stem for file in figures}
    assert {
        f"map-{n}" for n in ("color", "height", "z-angle", "source", "stretch", "incidence", "density")
    } < names
    assert {"curves-view-0", "curves-view-1", "curves-view-2"} < names
    assert {"growth", "energy", "decision-01-view-1-overlay", "decision-03-view-2-plan"} < names
    assert "decision-02-view-1-plan" not in names  # the operator chose that view: no plan is behind it
    assert set(figures) == {name + suffix for name in names for suffix in (".png", ".svg")}
    for file, content in figures.items():
        if file.endswith(".svg"):
            drawn = ElementTree.fromstring(content)
            assert drawn.findtext(f"{SVG}title")
            assert not {element.tag for element in drawn.iter()} & {SVG + "script", SVG + "foreignObject"}
        else:
            with Image.open(io.BytesIO(content)) as image:
                assert image.width > 300


def test_all_figures_come_in_one_archive_that_no_name_leads_out_of(
    session: OpenedSession, figures: dict[str, bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("flatcloth.export.figures.figure_files", lambda _: figures.items())
    with zipfile.ZipFile(io.BytesIO(made(session, "figures.zip"))) as archive:
        assert {name: archive.read(name) for name in archive.namelist()} == figures
    # The recording's name is a script.
    assert all(re.fullmatch(r"[a-z0-9-]+\.(png|svg)", name) for name in figures)


def test_figures_tell_what_happened(session: OpenedSession) -> None:
    drawn = {figure.name: figure for figure in all_figures(session)}
    refused = drawn["decision-01-view-1-overlay"].caption
    assert "rejected, bad depth, score 0." in refused
    assert "taken back" in refused
    text = "".join(ElementTree.fromstring(drawn["growth"].svg()).itertext())
    for step in session.growth.steps:
        assert f"{step.angle_deg:g}\u00b0" in text
    assert f"{1e4 * session.growth.view.area_m2:.0f} cm\u00b2" in drawn["map-color"].caption
    assert re.search(r"A_0 = .?\d+\u00b0", drawn["decision-03-view-2-plan"].svg())


def test_the_garment_is_drawn_with_its_outline_and_told_in_report_and_page(session: OpenedSession) -> None:
    known = session.data.garment
    assert isinstance(known, KnownGarment)
    (figure,) = garment(session)
    kind = known.found.kind.replace("_", " ")
    seen = sum(point.pixel is not None for point in known.found.points.values())
    assert figure.caption.startswith(f"Garment: {kind}, ")
    assert f"{seen} of {len(known.found.points)} named points seen" in figure.caption
    assert set(known.found.points) <= set(texts_of(figure.drawing))


def test_picks_are_marked_on_the_shape(session: OpenedSession) -> None:
    (shape,) = maps(session, ("color",))
    text = texts_of(shape.drawing)
    assert {"1", "2"} <= set(text)
    assert "3" not in text  # it does not lie on the shape


def test_a_method_that_plans_without_sides_has_its_pictures_too(session: OpenedSession) -> None:
    class Otherwise:
        """The integration of the session, with plans that know no sides."""

        def __getattr__(self, name: str) -> object:
            return getattr(session.integration, name)

        def plan(self, document: Document) -> Plan:
            return replace(session.integration.plan(document), sides=(), reason="967 cm2 new")

    other = OpenedSession(session.history, Otherwise())  # type: ignore[arg-type]
    assert [f.name for f in all_figures(other) if f.name.startswith("decision-03")] == [
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
