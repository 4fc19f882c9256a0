"""A whole run: what it writes."""

from __future__ import annotations

from pathlib import Path

from scenes import Cylinder

from flatcloth.batch.integrate import integrate
from flatcloth.engine.integration import Integration


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
