"""What Auto does next: it goes on, waits or ends by the choice of how far it runs."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

from flatcloth.session.document import Document
from flatcloth.session.machine import SessionState
from flatcloth.viewer import auto
from flatcloth.viewer.protocol.sent import AutoInfo
from flatcloth.viewer.protocol.settings import Settings

RUNS = AutoInfo(running=True)
BEGUN = Document(start_view=0)


def next_step(document=BEGUN, settings=None, *, auto_now=RUNS, floating_m2=0.0):
    sheet = SimpleNamespace(floating_m2=floating_m2, shape_m2=0.1)
    picture = SimpleNamespace(document=document, sheet=sheet)
    state = SessionState(12, document)
    return auto.next_step(state, auto_now, settings or Settings(), picture)


def test_an_end_with_much_floating_cloth_is_no_success():
    ended = replace(BEGUN, finished="No view is left.")
    good, bad = next_step(ended), next_step(ended, floating_m2=0.1)
    assert (good.level, bad.level) == ("info", "warning")
    assert good.text == "Auto has finished. No view is left."
    assert "50 % of the cloth floats" in bad.text
