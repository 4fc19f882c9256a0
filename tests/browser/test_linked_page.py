"""Both panes linked: picks numbered and seen through cloth, the pointer of one pane shown in the other."""

from __future__ import annotations

import math
import time

import cv2
import numpy as np
import pytest

pytestmark = [pytest.mark.browser, pytest.mark.scene]


def test_picks_are_numbered_the_pointer_is_linked_both_ways_and_else_the_scene_rests(open_tab):
    tab = open_tab().ready()
    first = tab.click_shape(0.5, 0.5)
    tab.click_shape(0.4, 0.6)
    tab.until("flatcloth.sceneMarks.drawn.filter(Boolean).length === 2")
    assert tab.page.evaluate("flatcloth.sceneMarks.drawn.map((mark) => mark.id)") == [1, 2]
    # The pointer on the flattened view is at the same cloth in 3D: at the place where pick 1 is drawn.
    at = tab.page.evaluate("([u, v]) => flatcloth.toScreen(u, v)", first["uv_m"])
    tab.page.mouse.move(at["x"] + 3, at["y"])
    tab.page.mouse.move(at["x"], at["y"])
    tab.until(
        "(({ cursorAt: at, drawn: [mark] }) => at && Math.hypot(at.x - mark.x, at.y - mark.y) < 4)"
        "(flatcloth.sceneMarks)"
    )
    drawn = tab.page.evaluate("flatcloth.sceneMarks.drawn")
    # And the other way round: the pointer there in 3D shows on the plane, at pick 1.
    frame = tab.page.locator("#viser").bounding_box()
    tab.page.mouse.move(frame["x"] + drawn[0]["x"] + 2, frame["y"] + drawn[0]["y"])
    tab.page.mouse.move(frame["x"] + drawn[0]["x"], frame["y"] + drawn[0]["y"])
    tab.until("flatcloth.sceneMarks.plane")
    plane = tab.page.evaluate("flatcloth.sceneMarks.plane")
    assert math.dist(plane, first["uv_m"]) < 0.012
    tab.shoot("linked")
    tab.page.mouse.move(5, 5)
    the_scene_is_drawn_when_something_changes_and_else_rests(tab)
    a_scene_that_was_hidden_is_drawn_again(tab)


WATCH_DRAWING = """() => {
    window.drawnAt = performance.now();
    for (const name of ["drawArrays", "drawElements", "drawArraysInstanced", "drawElementsInstanced"]) {
        const draw = WebGL2RenderingContext.prototype[name];
        WebGL2RenderingContext.prototype[name] = function (...rest) {
            window.drawnAt = performance.now();
            return draw.apply(this, rest);
        };
    }
}"""


def the_scene_is_drawn_when_something_changes_and_else_rests(tab):
    tab.scene.evaluate(WATCH_DRAWING)
    # Once what was begun is drawn; viser by itself would draw each second.
    tab.scene.wait_for_function("performance.now() - drawnAt > 2500", polling=100)
    tab.scene.evaluate("window.rested = drawnAt, window.__viserMutable.requestRender()")
    tab.scene.wait_for_function("drawnAt > rested", polling=100)


def a_scene_that_was_hidden_is_drawn_again(tab):
    def cloth_is_seen():
        frame = tab.page.locator("#viser").bounding_box()
        middle = {"x": frame["x"] + frame["width"] / 3, "y": frame["y"] + frame["height"] / 3}
        png = tab.page.screenshot(clip={**middle, "width": frame["width"] / 3, "height": frame["height"] / 3})
        image = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
        return np.mean(np.ptp(image, axis=2) > 20) > 0.02

    assert cloth_is_seen()
    wide = tab.page.viewport_size
    tab.page.set_viewport_size({"width": 700, "height": 1000})
    tab.page.locator("#viser").wait_for(state="hidden")
    tab.page.set_viewport_size(wide)
    tab.page.locator("#viser").wait_for()
    until = time.monotonic() + 60
    while not cloth_is_seen():
        assert time.monotonic() < until, "the scene stays empty"
        tab.page.wait_for_timeout(200)
