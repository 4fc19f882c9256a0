"""A sheet round a cylinder that is turned in steps, integrated step by step."""

from functools import cache

import numpy as np
from scenes import Cylinder

from flatcloth.core.config import Config
from flatcloth.core.types import FlattenedView, Float64
from flatcloth.engine.integration import Integration
from flatcloth.session.machine import Command, SessionState, apply

STEPS = tuple(float(a) for a in range(0, 360, 20))
# Around the front half and more: both sides of the first view have an occluding edge.
SHEET = {"angles_deg": STEPS, "span_deg": (-100.0, 100.0)}


def integration(method: str, config: Config | None = None, **options: object) -> Integration:
    return Integration(Cylinder(**{**SHEET, **options}), config, method)  # type: ignore[arg-type]


@cache
def shared(method: str) -> Integration:
    """Return one integration for all tests that leave it as it is: what they ask again is in its memory."""
    return integration(method)


def done(made: Integration, state: SessionState, *commands: Command) -> SessionState:
    """Give commands, and do all the work that they ask for."""
    for command in commands:
        state = apply(state, command)
        while state.request is not None:
            state = apply(state, made.answer(state.document, state.request))
    return state


def errors_m(view: FlattenedView) -> Float64:
    """Errors of the distances between random pixels of the result, against the cylinder unrolled."""
    flat = Cylinder().flat_uv_m(view.xyz_m[view.valid].astype(float))
    uv = view.uv_from_rc(np.argwhere(view.valid))
    pair = np.random.default_rng(0).integers(0, len(uv), (2, 4000))
    error: Float64 = np.linalg.norm(uv[pair[0]] - uv[pair[1]], axis=1)
    error -= np.linalg.norm(flat[pair[0]] - flat[pair[1]], axis=1)
    return np.abs(error)
