"""Whether a result can be trusted, by the result itself, in addition to the check of the recording.

Views may fit only after corrections that no careful or careless recording needs, they may contradict each
other by more than their deviations allow, or most of the cloth floats.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.special import chdtri

from flatcloth.checking.findings import Check
from flatcloth.registration.pose_prior import PosePrior
from flatcloth.registration.registered import Registered
from flatcloth.registration.view_features import UNKNOWNS

LEAST_VIEWS = 6
"""Fewest views by which a result is judged. Chosen: fewer hardly overlap."""
_MOST_STDS = 4.0
"""Corrections beyond this many of the largest deviations of recordings are none: one in 16,000 is. Chosen."""
_MOST_FLOATING = 0.75
"""Share of the cloth that floats, at most: of right recordings of garments seen from behind up to 0.71 does.
Measured: ``python -m benchmarks accuracy``."""
_MOST_SURPRISE, _MOST_OF_NO_KIND = (float(chdtri(UNKNOWNS, chance)) for chance in (1e-7, 1e-6))
"""Two views that contradict the registered poses by more do not fit: one in ten million does if the stated
deviations are right. Of the views of the 34 recordings, half of their pairs reach 32 at most, and 64 and more
where results of wrong recordings were wrong. A shape that is no known kind is ten times as likely of a wrong
recording. Measured: one of the 34 is none, and of wrong recordings about a third."""
_HOPELESS = ("sense", "factor", "order", "still", "rotated", "unit")
"""Findings with which no view fits another. By definition."""

WRONG = "Something about this recording is wrong"
"""The state of such a result, in words."""


def wrong_with(
    check: Check | None, registered: Registered | None, floating_share: float, *, fits_none: bool = False
) -> list[str]:
    """Return the reasons why something about the recording of a result is wrong; empty if there are none.

    Parameters
    ----------
    check : Check, optional
        The check of the recording, if it was made.
    registered : Registered, optional
        The registration of the integrated views, if the method registers them.
    floating_share : float
        Share of the cloth in floating pieces.
    fits_none : bool
        Whether no known kind of garment fits. Alone it is no doubt: others exist.
    """
    found = [] if check is None else [finding.text for finding in check.certain]
    if registered is None or len(registered.features) < LEAST_VIEWS:
        return found
    found += _corrections(registered)
    contradicting = contradicting_views(registered, _MOST_OF_NO_KIND if fits_none else _MOST_SURPRISE)
    if contradicting:
        which = f"View {contradicting[0]} contradicts"
        if len(contradicting) > 1:
            which = f"{len(contradicting)} of {len(registered.features)} views contradict"
        found.append(f"{which} the others by more than the noise of the sensor")
    if floating_share > _MOST_FLOATING:
        found.append(f"{floating_share:.0%} of the cloth floats, connected by no view")
    if fits_none and found:
        found.append("no known kind of garment fits")
    return found


def told(wrong: Sequence[str]) -> str:
    """Return what :func:`wrong_with` found, if anything, as a sentence."""
    return f"{WRONG}: {'; '.join(wrong)}. Nothing of the result is reliable."


def is_hopeless(check: Check | None, registered: Registered | None) -> bool:
    """Return whether further views cannot help, so that an unattended run ends.

    A single view that contradicts may be left out, unless the check doubts the recording, too. If several do,
    nothing is reliable whatever is added, and to lay out cloth that contradicts takes ever longer.
    """
    if registered is None or len(registered.features) < LEAST_VIEWS:
        return False
    named = check is not None and any(finding.name in _HOPELESS for finding in check.certain)
    doubted = check is not None and any(finding.stops for finding in check.findings)
    return named or bool(_corrections(registered)) or len(contradicting_views(registered)) > 1 - doubted


def _corrections(registered: Registered) -> list[str]:
    """Return which corrections by the registration are larger than those of any recording."""
    prior, own = PosePrior(), np.degrees(registered.own)
    turned = float(np.abs(own[:, 0]).max())
    swung = float(np.hypot(own[:, 1], own[:, 2]).max())
    beside_m = registered.axis_moved_m
    found = []
    if turned > _MOST_STDS * prior.turn_stds_deg[-1]:
        found.append(f"views fit only after turns by up to {turned:.1f} degrees against their angles")
    if swung > _MOST_STDS * math.sqrt(2.0) * prior.swing_stds_deg[-1]:
        found.append(f"views fit only after swings by up to {swung:.1f} degrees")
    if beside_m > _MOST_STDS * prior.axis_stds_m[-1]:
        found.append(f"views fit only about an axis {1e3 * beside_m:.0f} mm off the recorded one")
    return found


def contradicting_views(registered: Registered, most: float = _MOST_SURPRISE) -> list[int]:
    """Return the views that do not fit most of the views that they were compared with, by their numbers.

    At least half of a view's pairs must contradict, and two: a single one may be of cloth that moved.
    """
    wrong = registered.surprises > most
    ends = np.array([(pair.first, pair.second) for pair in registered.pairs], np.intp).reshape(-1, 2)
    count = len(registered.features)
    of, bad = (np.bincount(ends[kept].ravel(), minlength=count) for kept in (slice(None), wrong))
    return sorted(registered.features[n].view_index for n in np.flatnonzero((bad >= 2) & (2 * bad >= of)))
