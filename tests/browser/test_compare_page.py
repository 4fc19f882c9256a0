"""Shape and proposal compared on the canvas: each alone, blinking, their difference, both values."""

from __future__ import annotations

from urllib.parse import urljoin

import cv2
import numpy as np
import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser


class Cloth:
    """Where shape and proposal have cloth: places of the plane that only one has, and that both have."""

    def __init__(self, tab, url):
        self._tab, self._url = tab, url.rstrip("/")
        layers = tab.state()["layers"]
        overlay = layers["overlay"]
        self.shape = self.image(f"/layers/{layers['revision']}/color.png")
        self.proposal = self.image(f"/overlay/{overlay['revision']}.png")
        self.origin, self.size = overlay["origin_uv_m"], overlay["pixel_size_m"]
        rows, cols = np.nonzero(cv2.erode(self.proposal[..., 3], np.ones((9, 9), np.uint8)))
        uv = np.array(self.origin) + self.size * np.stack([cols, rows], axis=1)
        known = cv2.dilate(self.shape[..., 3], np.ones((9, 9), np.uint8)) > 0
        inner = cv2.erode(self.shape[..., 3], np.ones((9, 9), np.uint8)) > 0
        at = np.rint((uv - layers["origin_uv_m"]) / layers["pixel_size_m"]).astype(int)
        inside = ((at >= 0) & (at < [layers["cols"], layers["rows"]])).all(axis=1)
        row, col = np.where(inside[:, None], at[:, ::-1], 0).T
        both = uv[inside & inner[row, col]]
        only_proposal = uv[~(inside & known[row, col])]
        self.both, self.only_proposal = both[len(both) // 2], only_proposal[len(only_proposal) // 2]
        free = inner.copy()
        ours = np.rint((uv - layers["origin_uv_m"]) / layers["pixel_size_m"]).astype(int)[inside]
        covered = np.zeros(free.shape, np.uint8)
        covered[ours[:, 1], ours[:, 0]] = 1
        free &= cv2.dilate(covered, np.ones((25, 25), np.uint8)) == 0
        rows, cols = np.nonzero(free)
        only = np.array(layers["origin_uv_m"]) + layers["pixel_size_m"] * np.stack([cols, rows], axis=1)
        self.only_shape = only[len(only) // 2]

    def image(self, path):
        answer = self._tab.page.request.get(urljoin(self._url, path))
        image = cv2.imdecode(np.frombuffer(answer.body(), np.uint8), cv2.IMREAD_UNCHANGED)
        return cv2.cvtColor(image, cv2.COLOR_BGRA2RGBA)

    def seen(self):
        """Tell whether something is drawn where only A is, where only B is, and where both are."""
        return [self._tab.drawn(uv)[0][3] > 0 for uv in (self.only_shape, self.only_proposal, self.both)]


def test_shape_and_proposal_are_compared_by_keys_and_their_difference(open_tab, program):
    tab = open_tab().ready()
    tab.step()
    at = Cloth(tab, program.url)
    each_is_shown_alone_by_its_key(tab, at)
    the_difference_goes_through_color_height_and_position(tab, at)
    both_values_and_their_difference_are_told_under_the_pointer(tab, at)


def each_is_shown_alone_by_its_key(tab, at):
    assert at.seen() == [True, True, True]
    tab.page.keyboard.press(",")
    assert at.seen() == [True, False, True]
    tab.page.keyboard.press(".")
    assert at.seen() == [False, True, True]
    assert tab.page.locator("[data-action=compare_proposal]").get_attribute("aria-pressed") == "true"
    tab.shoot("compare-proposal-alone")
    tab.page.keyboard.press(".")
    assert at.seen() == [True, True, True]


def the_difference_goes_through_color_height_and_position(tab, at):
    legend = tab.page.locator("#legend h3")
    layers = tab.state()["layers"]
    of = f"{layers['revision']}-{layers['overlay']['revision']}"
    for kind, title in (
        ("color", "Color, difference"),
        ("height", "Height, B − A (mm)"),
        ("position", "Distance in 3D (mm)"),
    ):
        tab.page.keyboard.press("d")
        expect(legend).to_have_text(title)
        expected = at.image(f"/difference/{of}/{kind}.png")
        col, row = np.rint((at.both - at.origin) / at.size).astype(int)
        # The canvas averages what is smaller than its own pixels.
        averaged = [cv2.blur(expected[..., :3], (size, size)) for size in (1, 2, 3, 4, 5)]
        around = np.stack([image[row - 2 : row + 3, col - 2 : col + 3] for image in averaged])
        around = around.reshape(-1, 3).astype(int)
        tab.until(f"flatcloth.comparison.shownKind === '{kind}'")
        off = np.abs(around - np.array(tab.drawn(at.both)[0][:3])).max(axis=1)
        assert off.min() <= 40, (kind, around.tolist(), tab.drawn(at.both))
        tab.shoot(f"compare-difference-{kind}")
    tab.page.keyboard.press("d")
    expect(legend).to_be_hidden()


def both_values_and_their_difference_are_told_under_the_pointer(tab, at):
    stage = tab.page.locator("#stage").bounding_box()
    tab.page.mouse.move(*tab.at(at.both))
    table = tab.page.locator("#readout-both")
    expect(table).to_be_visible()
    rows = [
        [float(cell.replace("\u2212", "-").rstrip("°")) for cell in row.locator("td").all_inner_texts()[1:3]]
        for row in table.locator("tbody tr").all()
    ]
    shape, proposal, apart = rows
    assert apart[0] == pytest.approx(proposal[0] - shape[0], abs=0.11)
    assert apart[1] == pytest.approx(proposal[1] - shape[1], abs=0.11)
    expect(tab.page.locator("#readout")).not_to_be_visible()
    tab.shoot("compare-values")
    assert tab.page.locator("#stage").bounding_box() == stage  # nothing moves under the pointer
    assert table.evaluate("t => t.offsetWidth <= t.parentElement.clientWidth")
    tab.page.mouse.move(*tab.at(at.only_shape))
    expect(table).not_to_be_visible()
    expect(tab.page.locator("#readout")).to_be_visible()
    # Under a pointer that rests, what is decided is no longer compared.
    tab.page.mouse.move(*tab.at(at.both))
    expect(table).to_be_visible()
    tab.accept()
    expect(table).not_to_be_visible()
