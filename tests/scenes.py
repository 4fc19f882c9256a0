"""Computed scenes with closed-form truth: what the numerics are tested on."""

from dataclasses import dataclass, field

import numpy as np

from flatcloth.core.config import FlatteningConfig, SurfaceConfig
from flatcloth.core.geometry import object_from_camera
from flatcloth.core.types import Bool, FlattenedView, Float64, Intrinsics, RgbdFrame, Rigid2, RotationAxis
from flatcloth.flattening.flatten import Flattening, flatten
from flatcloth.flattening.surface import observe_surface
from flatcloth.methods.answers import Alignment
from flatcloth.methods.paper.alignment import align_from, correspond, from_lines
from flatcloth.methods.paper.matching import Matcher
from flatcloth.shape.observations import PlacedView

CAMERA = Intrinsics(width=240, height=240, fx=425.0, fy=425.0, cx=119.5, cy=119.5)
AXIS = RotationAxis(point_m=np.array([0.0, 0.0, 0.85]), direction=np.array([0.0, -1.0, 0.0]))
FLATTENING = FlatteningConfig()


def rays() -> tuple[Float64, Float64]:
    rows, cols = np.mgrid[0 : CAMERA.height, 0 : CAMERA.width]
    return (cols - CAMERA.cx) / CAMERA.fx, (rows - CAMERA.cy) / CAMERA.fy


def frame(
    depth_m: Float64,
    mask: Bool | None,
    color: Float64 | None = None,
    view_index: int = 0,
    angle_deg: float = 0.0,
) -> RgbdFrame:
    shown = np.full((*depth_m.shape, 3), 128.0) if color is None else color
    return RgbdFrame(
        view_index=view_index,
        angle_deg=angle_deg,
        color=shown.astype(np.uint8),
        depth_m=np.nan_to_num(depth_m).astype(np.float32),
        mask=mask,
        intrinsics=CAMERA,
    )


def plane(slope_x: float = 0.0, slope_y: float = 0.0, depth_m: float = 0.85) -> Float64:
    """Depth of the plane z = depth + slope_x x + slope_y y."""
    x, y = rays()
    return depth_m / (1.0 - slope_x * x - slope_y * y)


def box(half_m: float, depth_m: Float64) -> Bool:
    """Pixels within a square of the given half width about the optical axis."""
    x, y = rays()
    return (np.abs(x * depth_m) < half_m) & (np.abs(y * depth_m) < half_m)


@dataclass
class Cylinder:
    """A checkered vertical cylinder about the axis, seen over a range of angles in each view.

    ``span_deg`` is the part of it that is cloth, measured about the axis in the object frame.
    """

    angles_deg: tuple[float, ...] = (0.0,)
    radius_m: float = 0.12
    span_deg: tuple[float, float] = (-180.0, 180.0)
    half_height_m: float = 0.10
    square_m: float = 0.025
    masks: bool = True
    is_growing: bool = False
    name: str = "cylinder"
    description: str = ""
    location: str = "computed"
    intrinsics: Intrinsics = CAMERA
    rotation_axis: RotationAxis | None = AXIS
    held_point_m: Float64 | None = field(default_factory=lambda: np.array([0.0, -0.1, 0.85]))

    @property
    def has_masks(self) -> bool:
        return self.masks

    def __len__(self) -> int:
        return len(self.angles_deg)

    def __getitem__(self, view_index: int) -> RgbdFrame:
        depth, around_deg = self.surface(view_index)
        _, y = rays()
        height = y * depth
        low, high = self.span_deg
        mask = np.isfinite(depth) & (np.abs(height) < self.half_height_m)
        mask &= (around_deg > low) & (around_deg < high)
        arc = np.radians(around_deg) * self.radius_m
        # Every square has its own grey, so that no shift by a square looks the same.
        cell = np.floor(arc / self.square_m) * 7 + np.floor(height / self.square_m) * 13
        grey = 40.0 + 180.0 * np.mod(np.sin(np.nan_to_num(cell) * 12.9898) * 43758.5453, 1.0)
        color = np.where(mask, grey, 0.0)[..., None] * np.ones(3)
        return frame(
            np.where(mask, depth, 0.0),
            mask if self.masks else None,
            color,
            view_index,
            self.angles_deg[view_index],
        )

    def surface(self, view_index: int) -> tuple[Float64, Float64]:
        """Depth (H, W), NaN beside the cylinder, and the angle about the axis in the object frame."""
        x, _ = rays()
        center, a = float(AXIS.point_m[2]), 1.0 + x * x
        under = center**2 - a * (center**2 - self.radius_m**2)
        depth = (center - np.sqrt(np.where(under > 0, under, np.nan))) / a
        around = np.degrees(np.arctan2(x * depth, center - depth)) - self.angles_deg[view_index]
        return depth, 180.0 - (180.0 - around) % 360.0

    def flat_uv_m(self, xyz_held_m: Float64) -> Float64:
        """Exact flat place (..., 2) of points on the cylinder: arc length and height (down)."""
        offset = xyz_held_m - AXIS.point_m
        arc = np.arctan2(offset[..., 0], -offset[..., 2]) * self.radius_m
        return np.stack([arc, offset[..., 1]], axis=-1)


def placed_view(shown: RgbdFrame) -> PlacedView:
    """Return the surface of a frame, and how the camera stood at its angle."""
    surface = observe_surface(shown, AXIS, SurfaceConfig())
    return PlacedView(surface=surface, object_from_camera=object_from_camera(AXIS, shown.angle_deg))


def flattened(shown: RgbdFrame, config: FlatteningConfig = FLATTENING, **options: float) -> Flattening:
    return flatten(observe_surface(shown, AXIS, SurfaceConfig()), AXIS, config, **options)


def views(*angles_deg: float, **options: object) -> list[FlattenedView]:
    cylinder = Cylinder(angles_deg=angles_deg, **options)  # type: ignore[arg-type]
    return [flattened(cylinder[n]).view for n in range(len(angles_deg))]


def aligned_by_z_angle(current: FlattenedView, new: FlattenedView, turn_deg: float) -> Alignment:
    """Align the view after a turn of the axis as the method ``paper`` does, with A_w = 50 degrees."""
    lines = correspond(current, new, AXIS, (0.0, turn_deg), Rigid2(), 50.0)
    return align_from(from_lines(lines), Matcher(current, new, AXIS), correspondence=lines)


def placement_error_m(current: FlattenedView, new: FlattenedView, current_from_new: Rigid2) -> float:
    """Largest distance between where both views put the same cloth (the cylinder's own coordinates)."""
    cylinder = Cylinder()

    def flat_from_plane(view: FlattenedView) -> tuple[np.ndarray, np.ndarray]:
        uv = view.uv_from_rc(np.argwhere(view.valid))
        return uv, cylinder.flat_uv_m(view.xyz_m[view.valid].astype(float))

    uv_0, flat_0 = flat_from_plane(current)
    uv_1, flat_1 = flat_from_plane(new)
    moved = current_from_new.apply(uv_1)
    error = []
    for point in flat_1[::997]:
        distance = np.linalg.norm(flat_0 - point, axis=1)
        if distance.min() < 0.002:
            error.append(moved[np.argmin(np.linalg.norm(flat_1 - point, axis=1))] - uv_0[distance.argmin()])
    return float(np.linalg.norm(error, axis=1).max())


def sheet(view_index: int, left_px: int, width_px: int, z_angle_deg: float, rows: int = 20) -> FlattenedView:
    """A flat strip whose pixels know their own place on the plane (xyz = u, v, 0)."""
    size = 0.002
    u = (left_px + np.arange(width_px)) * size
    v = np.arange(rows) * size
    xyz = np.zeros((rows, width_px, 3), dtype=np.float32)
    xyz[..., 0], xyz[..., 1] = u, v[:, None]
    shape = (rows, width_px)
    return FlattenedView(
        rgb=np.full((*shape, 3), 10 * view_index, dtype=np.uint8),
        xyz_m=xyz,
        normal=np.broadcast_to(np.float32([0, 0, -1]), (*shape, 3)).copy(),
        z_angle_deg=np.full(shape, z_angle_deg, dtype=np.float32),
        valid=np.ones(shape, dtype=bool),
        view_index=np.full(shape, view_index, dtype=np.int16),
        source_rc=np.stack(np.meshgrid(np.arange(rows), np.arange(width_px), indexing="ij"), -1).astype(
            np.float32
        ),
        pixel_size_m=size,
        origin_uv_m=(left_px * size, 0.0),
    )
