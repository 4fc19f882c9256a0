"""The operator page as axe-core sees it: no serious or critical finding, in light and in dark."""

from __future__ import annotations

import pytest

pytestmark = pytest.mark.browser


@pytest.mark.parametrize("scheme", ["light", pytest.param("dark", marks=pytest.mark.thorough)])
def test_no_serious_finding_in_what_an_operator_sees(open_tab, scheme):
    tab = open_tab(scheme=scheme).ready()
    keys = tab.page.keyboard
    found = {"ready": tab.findings()}
    tab.step()
    tab.accept()
    tab.click_shape()
    found["accepted, with a pick"] = tab.findings()
    tab.page.locator(".view.accepted").press("Enter")
    tab.page.locator("#palette").wait_for()
    found["card of a view"] = tab.findings()
    keys.press("Escape")
    keys.press("Shift+E")
    keys.press("Shift+R")
    tab.until("flatcloth.result.found && flatcloth.state.views.some((v) => v.added_cm2 > 0)")
    found["list and result"] = tab.findings()
    tab.shoot(f"axe-review-{scheme}")
    keys.press("Escape")
    keys.press("Shift+E")
    tab.step()
    keys.press("p")
    found["proposal with pairs"] = tab.findings()
    keys.press("p")
    keys.press("d")
    keys.press("i")
    keys.press("Shift+L")
    tab.until("flatcloth.diagnostics.known !== null && flatcloth.comparison.shownKind !== null")
    found["difference, why, looking"] = tab.findings()
    keys.press("2")
    keys.press("0")
    keys.press("z")
    found["height, turned, with the ruler"] = tab.findings()
    tab.shoot(f"axe-looking-{scheme}")
    keys.press("Escape")
    keys.press("i")
    keys.press("e")
    found["reasons"] = tab.findings()
    keys.press("Escape")
    keys.press("k")
    tab.until("flatcloth.phase === 'ready'")
    keys.press("k")  # nothing to skip: told
    tab.page.locator(".toast").first.wait_for()
    found["skipped, with a notice"] = tab.findings()
    for dialog, action in (("#settings", "settings"), ("#palette", "help")):
        tab.page.locator(f"[data-action={action}]").click()
        tab.page.locator(dialog).wait_for()
        found[dialog] = tab.findings()
        tab.shoot(f"axe-{dialog.strip('#')}-{scheme}")
        keys.press("Escape")
        tab.page.locator(dialog).wait_for(state="hidden")
    assert {where: what for where, what in found.items() if what} == {}
    # And the checker sees the page.
    tab.page.evaluate("document.querySelector('.status').append(document.createElement('button'))")
    assert any("critical: button-name" in finding for finding in tab.findings())
