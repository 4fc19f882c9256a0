"""The recipe of CONTRIBUTING.md for a method: a toy method is registered and runs from the command line."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from exported_sessions import write_cylinder

from flatcloth.cli import main
from flatcloth.core.errors import ConfigError
from flatcloth.core.types import Progress, Rigid2, no_progress
from flatcloth.export.data import read_shape
from flatcloth.flattening.resampling import place
from flatcloth.methods.answers import Alignment, AlignmentScore, Canonical, Placement, Plan
from flatcloth.methods.base import Method, Views
from flatcloth.methods.registry import METHODS, method_name
from flatcloth.session.document import Document, Side

MOST_VIEWS = 3


class SideBySide(Method):
    """Accepts the first views of a recording where the first one lies, and shows that one alone."""

    name = "side-by-side"

    def __init__(self, views: Views, angles_deg: Sequence[float]) -> None:
        self._views, self.angles_deg = views, angles_deg

    @property
    def accept_score(self) -> float:
        return 0.5

    def start_view(self, progress: Progress = no_progress) -> int | None:
        return 0

    def canonical(self, document: Document) -> Canonical:
        assert document.start_view is not None
        used = (document.start_view, *(a.view_index for a in document.accepted))
        view = place([(self._views.part(document.start_view, 0), Rigid2())])
        return Canonical(view=view, current_from_view=dict.fromkeys(used, Rigid2()))

    def plan(self, document: Document, unusable: set[int]) -> Plan:
        rest = set(range(MOST_VIEWS)) - document.used_views - document.refused_views - unusable
        view = min(rest, default=None)
        reason = "Nothing more to give: enough views." if view is None else "the next one"
        return Plan(view_index=view, reason=reason)

    def propose(
        self, document: Document, view_index: int, side: Side | None, progress: Progress = no_progress
    ) -> Placement:
        score = self.score(document, view_index, 0, Rigid2())
        alignment = Alignment(current_from_new=Rigid2(), initial=Rigid2(), score=score, initial_score=score)
        return Placement(component=0, alignment=alignment)

    def score(self, document: Document, view_index: int, component: int, motion: Rigid2) -> AlignmentScore:
        return AlignmentScore(0.9, {"toy": 1.0})

    def refined(self, document: Document, view_index: int, component: int, motion: Rigid2) -> Rigid2:
        return motion


@pytest.fixture
def toy(monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setitem(METHODS, SideBySide.name, f"{__name__}:SideBySide")
    return SideBySide.name


def test_a_registered_method_runs_from_the_command_line(
    toy: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording = str(write_cylinder(tmp_path / "cylinder"))
    assert main(["run", recording, "--method", toy, "--out", str(tmp_path / "s")]) == 0
    outcome = json.loads((tmp_path / "s" / "outcome.json").read_text())
    assert outcome["method"] == toy
    used = {outcome["start_view"], *(a["view_index"] for a in outcome["accepted"])}
    assert used >= set(range(MOST_VIEWS))
    assert [a["score"] for a in outcome["accepted"]] == [0.9] * (len(used) - 1)
    assert outcome["ended"] == "Nothing more to give: enough views."
    shape = read_shape(tmp_path / "s" / "flattened.npz")
    assert set(np.unique(shape.view_index[shape.valid])) == {outcome["start_view"]}
    assert "side-by-side" not in capsys.readouterr().err


def test_an_unknown_name_tells_which_there_are() -> None:
    with pytest.raises(ConfigError, match="Unknown method 'best'; choose one of: robust, paper"):
        method_name("best")
