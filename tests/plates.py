"""A thin plate of two layers that turns about the vertical, in closed form: front and back are known.

In the object frame the front lies at z = axis depth - half the thickness and looks at the camera of
view 0; the back lies behind it.
"""

from dataclasses import dataclass

import numpy as np
from scenes import AXIS, CAMERA, frame, rays

from flatcloth.core.geometry import rotation_about
from flatcloth.core.types import Bool, Float64, RgbdFrame

HALF_WIDTH_M, HALF_HEIGHT_M, THICKNESS_M = 0.07, 0.10, 0.002
TOP_M = np.array([0.0, -HALF_HEIGHT_M, 0.85])
EVERY_20 = tuple(20.0 * n for n in range(18))


@dataclass(frozen=True)
class View:
    """A frame, and where it shows front and back (H, W)."""

    frame: RgbdFrame
    front: Bool
    back: Bool


def plate(
    angles_deg: tuple[float, ...] = EVERY_20,
    noise_m: float = 0.0,
    still_box: bool = False,
    gripper: bool = False,
    beside_m: float | None = None,
) -> list[View]:
    """Views of the plate.

    ``still_box`` stands beside it and does not turn; ``gripper`` is a bar above it; ``beside_m`` puts
    another such plate, which does not turn, so far to the right.
    """
    random = np.random.default_rng(0)
    views = []
    for n, angle in enumerate(angles_deg):
        depth, side = _faces(angle)
        x, y = rays()
        color = np.full((*depth.shape, 3), (40.0, 60.0, 150.0))
        if still_box:
            _add(depth, side, (np.abs(x + 0.14) < 0.012) & (np.abs(y) < 0.1), 0.84)
        if gripper:
            bar = (np.abs(x) < 0.03) & (y < -(HALF_HEIGHT_M + 0.009) / 0.85) & (y > -0.17)
            _add(depth, side, bar, 0.85)
            color[bar] = (200.0, 200.0, 60.0)
        if beside_m is not None:
            other = (np.abs(x * 0.85 - beside_m) < HALF_WIDTH_M) & (np.abs(y * 0.85) < HALF_HEIGHT_M)
            _add(depth, side, other, 0.85)
        shown = np.isfinite(depth)
        depth = depth + noise_m * random.standard_normal(depth.shape)
        made = frame(np.where(shown, depth, np.nan), None, color, n, angle)
        views.append(View(made, side == 1, side == -1))
    return views


def _faces(angle_deg: float) -> tuple[Float64, np.ndarray]:
    """Depth (H, W), NaN beside the plate, and which face is seen: 1 front, -1 back, 0 none."""
    turn = rotation_about(AXIS.direction, np.radians(angle_deg))
    x, y = rays()
    ray = np.stack([x, y, np.ones_like(x)], axis=-1)
    depth = np.full((CAMERA.height, CAMERA.width), np.nan)
    side = np.zeros(depth.shape, dtype=int)
    for sign in (1, -1):
        normal = turn @ np.array([0.0, 0.0, -float(sign)])
        middle = AXIS.point_m + 0.5 * THICKNESS_M * normal
        facing = ray @ normal
        with np.errstate(divide="ignore", invalid="ignore"):
            found = (middle @ normal) / facing
        local = (ray * found[..., None] - AXIS.point_m) @ turn
        hit = (
            (facing < -1e-6)
            & (np.abs(local[..., 0]) < HALF_WIDTH_M)
            & (np.abs(local[..., 1]) < HALF_HEIGHT_M)
        )
        depth[hit], side[hit] = found[hit], sign
    return depth, side


def _add(depth: Float64, side: np.ndarray, where: Bool, depth_m: float) -> None:
    free = where & ~(depth < depth_m)
    depth[free], side[free] = depth_m, 0
