"""Exports of a session with both sides: figures, report, animation, outline, offline page and picks."""

import json
import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from exported_sessions import cylinder_session

from flatcloth.core.types import MIRROR
from flatcloth.engine.garment import GarmentService
from flatcloth.engine.outcome import other_side_lines
from flatcloth.export.animation import frames
from flatcloth.export.figures import both_sides
from flatcloth.export.growth import Kept
from flatcloth.export.outline import drawing, outline_text, signed_area
from flatcloth.export.page import page
from flatcloth.export.report import report
from flatcloth.export.session import OpenedSession
from flatcloth.methods.answers import Canonical, JoinedSides, Seam
from flatcloth.rendering.pictures import BESIDE_M, side_by_side


class Both(GarmentService):
    """The shape's own mirror image as the other side, joined along its left and right borders.

    The garment is recognised by this side: the other has no views.
    """

    def __init__(self, session: OpenedSession) -> None:
        super().__init__(session.integration)
        view = session.view
        right_m = view.origin_uv_m[0] + view.pixel_size_m * (view.shape[1] - 1)
        self.view = replace(
            view,
            **{name: getattr(view, name)[:, ::-1].copy() for name in (
                "rgb", "xyz_m", "normal", "z_angle_deg", "valid", "view_index", "source_rc",
            )},
            quality=None,
            origin_uv_m=(-right_m, view.origin_uv_m[1]),
        )  # fmt: skip
        rows = np.flatnonzero(view.valid.any(axis=1))
        rc = np.stack([rows, view.valid[rows].argmax(axis=1)], axis=1)
        at = view.uv_from_rc(rc)
        seam = Seam(
            this_piece=0,
            other_piece=0,
            this_uv_m=at,
            other_uv_m=at * MIRROR,
            xyz_m=view.xyz_m[rc[:, 0], rc[:, 1]].astype(float),
            views=np.zeros((len(at), 2), dtype=np.int16),
            residual_m=np.full(len(at), 0.002),
            why="",
        )
        other = Canonical(view=self.view, current_from_view={})
        self.mirrored = JoinedSides(other=other, seams=(seam,), is_related=True)

    def joined(self, *_: object) -> JoinedSides:  # type: ignore[override]
        return self.mirrored


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    made = cylinder_session(tmp_path_factory.mktemp("both"))
    return OpenedSession(made.history, made.integration, kept=Kept(Both(made), lambda: True))


def test_a_session_of_one_side_stays_one(cylinder, text) -> None:
    assert not cylinder.has_both
    assert cylinder.data.sides is None
    assert list(both_sides(cylinder)) == []
    assert "Both sides" not in text
    assert history_of(page(cylinder))["other"] is None


def history_of(text: str) -> dict:
    found = re.search(r'id="history"[^>]*>(.*?)</script>', text, re.DOTALL)
    return json.loads(found[1])


def test_both_sides_lie_as_an_opened_book_at_equal_heights(session) -> None:
    this, other = session.view, session.data.sides.other.view
    picture, shift_m = side_by_side(this, other)
    rows, cols = np.nonzero(picture.rgba[..., 3])
    own = np.argwhere(this.valid)
    assert np.ptp(rows) == np.ptp(own[:, 0])
    gap_px = round(BESIDE_M / this.pixel_size_m)
    assert np.ptp(cols) + 1 >= 2 * (np.ptp(own[:, 1]) + 1) + gap_px
    # A pixel of the other side is where its place, moved by the shift, is on the picture.
    row, col = np.argwhere(other.valid)[len(own) // 2]
    u_m, v_m = other.uv_from_rc(np.array([row, col])).tolist()
    at = np.rint((np.array([v_m, u_m + shift_m]) - picture.origin_uv_m[::-1]) / picture.pixel_size_m).astype(
        int
    )
    assert picture.rgba[at[0], at[1], :3].tolist() == other.rgb[row, col].tolist()


def test_figure_and_report_show_the_seams(session) -> None:
    (figure,) = both_sides(session)
    assert figure.name == "both-sides"
    assert "joined along" in figure.caption
    text = report(session)
    assert "<h2>Both sides</h2>" in text
    assert "<td>joins</td>" in text


def test_the_animation_ends_with_both_sides(session, cylinder) -> None:
    assert len(list(frames(session))) == len(list(frames(cylinder))) + 1


def test_svg_and_dxf_have_both_sides_beside_one_another_and_none_mirrored(session) -> None:
    view, other = session.view, session.data.sides.other.view
    drawn = drawing(view, "both", other=other)
    root = ElementTree.fromstring(outline_text(view, "both", ".svg", other=other))
    groups = {group.get("id"): len(list(group)) for group in root.iter("{http://www.w3.org/2000/svg}g")}
    assert groups == {"outline": len(drawn.pieces), "other-side": len(drawn.other.pieces)}
    assert float(root.get("width", "0").removesuffix("mm")) > 2 * drawn.size_mm[0]
    layers = set(re.findall(r"\n8\n(\w+)\n", outline_text(view, "both", ".dxf", other=other)))
    assert {"OUTLINE", "OTHER_OUTLINE"} <= layers
    document = json.loads(outline_text(view, "both", ".json", other=other))
    outer = np.array(document["other_side"]["pieces"][0]["outer"])
    assert signed_area(outer) > 0  # as seen from outside
    u_mm = outer[:, 0] + document["other_side"]["origin_uv_mm"][0]
    own = np.array(document["pieces"][0]["outer"])[:, 0] + document["origin_uv_mm"][0]
    assert u_mm.max() == pytest.approx(-own.min(), abs=drawn.pixel_size_mm)


def test_the_offline_page_has_the_cloth_of_the_other_side(session) -> None:
    other = history_of(page(session))["other"]
    assert other["is_related"]
    assert other["count"] == int(session.view_of("other").valid.sum())
    assert [layer["name"] for layer in other["layers"]][:2] == ["color", "height"]


def test_the_report_says_how_many_seams_are_kept_by_decisions() -> None:
    seam = {"joins": True, "decided": None, "length_mm": 200, "probability": 0.985}
    kept, cut = {**seam, "decided": "keep", "probability": 1.0}, {**seam, "joins": False, "decided": "cut"}
    entry = {"area_cm2": 900.0, "is_related": True, "floating": [], "seams": [seam, kept, kept, cut]}
    line, doubt = other_side_lines(entry | {"joints": [{"area_cm2": 90.0, "share": 0.1, "probability": 0.9}]})
    assert doubt.startswith("90 cm2, 10% of the other side, hang on one joint that is right")
    along = "Other side: 900 cm2, joined along {} cm of seams, the surest right with a probability of {}"
    assert line.startswith(f"{along.format(60, '100.0%')}. 2 of its seams are kept")
    (line,) = other_side_lines({**entry, "joints": [], "seams": [seam]})
    assert line == f"{along.format(20, '98.5%')}."
