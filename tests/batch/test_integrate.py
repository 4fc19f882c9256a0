"""A whole run: what it writes."""

from __future__ import annotations

import os
import threading
from pathlib import Path
from typing import Any

import pytest
from exported_sessions import write_cylinder
from scenes import Cylinder

from flatcloth.batch.integrate import integrate
from flatcloth.core.processes.forked import Forked
from flatcloth.engine.integration import Integration
from flatcloth.recordings import open_recording


def test_the_files_do_not_depend_on_the_number_of_cores(tmp_path: Path) -> None:
    angles = (-25.0, 0.0, 25.0)
    written = []
    for cores in (1, 2):
        made = Integration(Cylinder(angles_deg=angles, span_deg=(-70.0, 70.0)))
        done = integrate(made, tmp_path / str(cores), cores=cores)
        assert done.files[-1].name == "outcome.json"
        written.append({file.name: file.read_bytes() for file in done.files})
    one, two = written
    assert {"flattened.npz", "cloud.ply", "grasps.json"} <= one.keys()
    assert one == two


@pytest.mark.skipif(not hasattr(os, "memfd_create"), reason="this system shares no memory so")
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")  # other tests may have left idle threads
@pytest.mark.parametrize("dies", [False, True])
def test_a_copy_of_the_process_changes_no_file_not_even_if_it_dies(
    dies: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(threading, "active_count", lambda: 1)
    recording = write_cylinder(tmp_path / "cylinder")
    here, taken = os.getpid(), []
    flatten, take = Integration._flatten, Forked.take

    def deadly(self: Integration, view_index: int) -> Any:
        if dies and os.getpid() != here:
            os._exit(1)
        return flatten(self, view_index)

    def watched(self: Forked[Any], number: int) -> Any:
        taken.append(take(self, number))
        return taken[-1]

    monkeypatch.setattr(Integration, "_flatten", deadly)
    monkeypatch.setattr(Forked, "take", watched)
    written = []
    for cores in (1, 2):
        made = Integration(open_recording(str(recording)))
        done = integrate(made, tmp_path / f"{cores}-{dies}", cores=cores)
        assert not made.is_beside
        written.append({file.name: file.read_bytes() for file in done.files})
    assert written[0] == written[1]
    assert taken  # the copy was asked
