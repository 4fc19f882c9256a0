"""What was decided about seams, found again among the sets of places."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from flatcloth.flattening.borders import SPACING_M
from flatcloth.methods.robust.seams.links import Matches, SeamLink
from flatcloth.session.garment import DecidedSeam

CUT = "cut by the operator"


def with_decisions(
    links: Sequence[SeamLink], matches: Matches, decided: Sequence[DecidedSeam]
) -> list[SeamLink]:
    """Return the sets as they were decided: those cut join nothing, those kept come first.

    The places of a decision are those of a set if at least half of them are within two spacings of it: the
    shape may have changed since. Of several decisions about a set, the last one counts.
    """
    found = list(links)
    trees = [cKDTree(matches.xyz_m[link.members]) for link in found]
    for seam in decided if found else ():
        off_m = np.array([tree.query(np.array(seam.points_m))[0] for tree in trees])
        near = (off_m < 2 * SPACING_M).mean(axis=1)
        best = int(near.argmax())
        if near[best] >= 0.5:
            found[best] = replace(found[best], is_kept=seam.kept, why="" if seam.kept else CUT)
    return sorted(found, key=lambda link: not link.is_kept)
