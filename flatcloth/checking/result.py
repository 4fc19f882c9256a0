"""What a result says about its recording, beside the check: whether it can be trusted.

Views may fit only after corrections that no careful or careless recording needs, or most of the cloth floats.
"""

from __future__ import annotations

import math

import numpy as np

from flatcloth.checking.findings import Check
from flatcloth.registration.pose_prior import PosePrior
from flatcloth.registration.registered import Registered

LEAST_VIEWS = 6
"""Views before which a result says nothing about the recording. Chosen: fewer hardly overlap."""
_MOST_STDS = 4.0
"""Corrections beyond this many of the largest deviations of recordings are none: one in 16,000 is. Chosen."""
_MOST_FLOATING = 0.6
"""Share of the cloth that floats, at most. Chosen: above that of right recordings."""
_HOPELESS = ("sense", "factor", "order", "still", "rotated", "unit")
"""Findings with which no view fits another. By definition."""

WRONG = "Something about this recording is wrong"
"""The state of such a result, in words."""


def wrong_with(check: Check | None, registered: Registered | None, floating_share: float) -> list[str]:
    """Return what says that something about the recording of a result is wrong; empty if nothing does.

    Parameters
    ----------
    check : Check, optional
        The check of the recording, if it was made.
    registered : Registered, optional
        The registration of the integrated views, if the method registers them.
    floating_share : float
        Share of the cloth in floating pieces.
    """
    found = [] if check is None else [finding.text for finding in check.certain]
    if registered is None or len(registered.features) < LEAST_VIEWS:
        return found
    found += _corrections(registered)
    if floating_share > _MOST_FLOATING:
        found.append(f"{floating_share:.0%} of the cloth floats, connected by no view")
    return found


def is_hopeless(check: Check | None, registered: Registered | None) -> bool:
    """Return whether further views cannot help, so that an unattended run ends."""
    if registered is None or len(registered.features) < LEAST_VIEWS:
        return False
    named = check is not None and any(finding.name in _HOPELESS for finding in check.certain)
    return named or bool(_corrections(registered))


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
        found.append(f"views fit only about an axis {1e3 * beside_m:.0f} mm beside the recorded one")
    return found
