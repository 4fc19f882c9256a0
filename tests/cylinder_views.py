"""An exact cylinder as the views of a recording, and a session that is asked about one of them."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
from viewer_fakes import CylinderRecording, cylinder_view

from flatcloth.core.config import Config
from flatcloth.core.types import Rigid2
from flatcloth.methods.paper.merging import begin
from flatcloth.methods.paper.method import PaperMethod
from flatcloth.session.document import Document, Pending

RECORDING = CylinderRecording()
LIMIT_DEG = Config().planning.z_angle_limit_deg


class _Fronts(PaperMethod):
    """The paper's method on views that are laid already."""

    def canonical(self, document):
        return cast("CylinderViews", self._views).canonical(document)


class CylinderViews:
    """What reasons ask of an integration; view 1 is turned by 30 deg, view 4 by 120 deg."""

    def __init__(self):
        self.views = self
        self.recording, self.axis, self.config = RECORDING, RECORDING.rotation_axis, Config()
        self.planning = replace(self.config.planning, overlap_area_m2=0.03)
        self.algorithm = _Fronts(self, RECORDING.angles_deg)
        self.moved = Rigid2(0.0, 0.012, -0.004)

    def view(self, index):
        return cylinder_view({index: (-RECORDING.angles_deg[index] + 180.0) % 360.0 - 180.0})

    def canonical(self, document):
        return begin(self.view(document.start_view), document.start_view)

    def part(self, view_index, component):
        assert component == 0
        return self.view(view_index)

    def flattening(self, view_index):
        """Two points 0.1 m apart on the cloth, and 20 % too far apart on the plane; a third, exact."""
        samples = np.array([[0.0, 0.0, 0.8], [0.1, 0.0, 0.8], [0.0, 0.1, 0.8]])
        level = SimpleNamespace(
            points_rc=np.zeros((3, 2), np.int32),
            points_m=samples + np.array([0.0, 0.0, 0.001 * view_index]),
            uv_m=np.array([[0.0, 0.0], [0.12, 0.0], [0.0, 0.1]]),
            edges=np.array([[0, 1], [0, 2]], np.int32),
            edge_length_m=np.array([0.1, 0.1]),
        )
        return SimpleNamespace(levels=(level,), components=(SimpleNamespace(members=np.arange(3)),))


def proposed(view_index, side=None, start=0, placed=None):
    placed = Rigid2(0.0, 0.012, -0.004) if placed is None else placed
    return Document(start_view=start, pending=Pending(view_index, placed, side))
