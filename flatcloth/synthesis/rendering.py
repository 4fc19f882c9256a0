"""Rendering of one view of a hung mesh by ray casting: depth, color and truth, without noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from flatcloth.core.errors import SynthesisError
from flatcloth.core.types import Bool, Float32, Float64, Int32, Intrinsics, Uint8
from flatcloth.recordings.files.libraries import load_with_libusb
from flatcloth.recordings.writer import Uint16
from flatcloth.synthesis.flat import FlatPanel
from flatcloth.synthesis.meshes import GarmentMesh
from flatcloth.synthesis.textures import Texture, mesh_rgb, pattern_rgb

MESH_COLORS = "mesh"
_BACKGROUND = np.array([33.0, 36.0, 39.0]) / 255
"""Color of the background, dark grey. Chosen."""
_LIGHT = np.array([-0.35, -0.45, -1.0]) / np.linalg.norm([-0.35, -0.45, -1.0])
"""Direction to the light in the camera frame: above and left of the camera."""
_AMBIENT = 0.30
"""Share of the light that has no direction. Chosen: less makes shades black, more hides the folds."""
_SUBPIXELS = 2
"""Rays along each side of a pixel for its color. Chosen: more cost time with their square."""
_DIFFUSE, _DOTS = 0.15, 0.85
"""Infrared light without and with a pattern. Chosen: indoors nearly all of it is the projector's."""
_DYED = 0.5
"""Share of the contrast of dyes that is left in infrared light. Chosen: most are nearly clear there."""
_WEAVE, _WEAVE_M = 0.15, 0.002
"""Deviation of the brightness of cloth in infrared light by its yarns, a share, and their size.
Measured: boards deviate from planes by as much as a real D435's frame (docs/synthesis.md)."""
_NOT_ITSELF = 0.999
"""Share of the way to a surface on which anything in between casts a shadow. Chosen."""
_TRUTH_UNITS_PER_M, _TRUTH_OFFSET_M, _TRUTH_OUTER = 20000.0, 1.5, 16
"""The format of recordings/truth.py, which only evaluation may import."""


def load_open3d() -> Any:
    """Return the module ``open3d``; raises ``SynthesisError`` if it, or a library it needs, is missing."""
    return load_with_libusb("open3d", SynthesisError, "Rendering needs Open3D", "'flatcloth[synthesis]'")


@dataclass(frozen=True, kw_only=True)
class Rendered:
    """A view: ``depth_m`` (H, W), 0 off the item; ``rgb`` (H, W, 3); ``panel`` (H, W), 0 none;
    ``outer`` (H, W) whether its outer face is seen; ``flat_uv_m`` (H, W, 2), 0 off the item.
    """  # fmt: skip

    depth_m: Float32
    rgb: Uint8
    panel: Uint8
    outer: Bool
    flat_uv_m: Float32

    def truth_bgr(self) -> Uint16:
        """Return the truth image of the recording format: panel and face, v, u."""
        code = self.panel + np.where(self.outer & (self.panel > 0), _TRUTH_OUTER, 0)
        values = np.rint((self.flat_uv_m + _TRUTH_OFFSET_M) * _TRUTH_UNITS_PER_M)
        values = np.where((self.panel > 0)[..., None], values, 0)
        return np.dstack([code, values[..., 1], values[..., 0]]).astype(np.uint16)


@dataclass(frozen=True, kw_only=True)
class Projector:
    """Casts a pattern from ``at_m`` (3,), camera frame, along the camera's optical axis.

    ``pattern`` (N, N) is its brightness over the tangents of the angles, to ``half_tan`` on each side.
    """

    at_m: Float64
    pattern: Float32
    half_tan: float

    def light(self, rays: Float64) -> Float64:
        """Return the brightness (N,) that it gives along rays (N, 3)."""
        half = len(self.pattern) / 2
        col, row = (rays[:, k] / rays[:, 2] / self.half_tan * half + half - 0.5 for k in (0, 1))
        found: Float64 = ndimage.map_coordinates(self.pattern, [row, col], np.float64, order=1)
        return found


class Scene:
    """A mesh that can be rendered in any pose.

    Parameters
    ----------
    mesh : GarmentMesh
        Its triangles and colors.
    panels : sequence of FlatPanel
        Panel 1 first.
    texture : Texture
        A generated pattern, a given one, or ``"mesh"`` for the mesh's own colors.
    seed : int
        Seed of the generated pattern.
    """

    def __init__(self, mesh: GarmentMesh, panels: tuple[FlatPanel, ...], texture: Texture, seed: int) -> None:
        self._mesh, self._texture, self._seed = mesh, texture, seed
        self._panel = np.zeros(len(mesh.triangles), dtype=np.uint8)
        self._flat = np.zeros((len(mesh.triangles), 3, 2))
        for number, panel in enumerate(panels, start=1):
            self._panel[panel.members] = number
            self._flat[panel.members] = panel.corner_uv_m
        self._yarns = np.random.default_rng([seed, 4]).standard_normal((1024, 1024)).clip(-2.0, 2.0)

    def view(self, camera: Intrinsics, points_m: Float64, normals: Float64) -> Rendered:
        """Render one view of vertices (N, 3) with their outward unit normals (N, 3), camera frame.

        It takes about 0.3 s for 480x848 px and 25 000 triangles.
        """
        caster = _Caster(points_m, self._mesh.triangles)
        hit = caster.cast(camera, 1)
        return Rendered(
            depth_m=_image(hit.seen, hit.depth_m),
            rgb=self._shaded(caster.cast(camera, _SUBPIXELS), camera, normals),
            panel=_image(hit.seen, self._panel[hit.triangle]),
            outer=_image(hit.seen, hit.outer),
            flat_uv_m=_image(hit.seen, hit.of(self._flat).astype(np.float32)),
        )

    def infrared(self, camera: Intrinsics, points_m: Float64, normals: Float64, dots: Projector) -> Float32:
        """Return the light (H, W) that an infrared imager receives, 0 off the item; see :meth:`view`."""
        caster = _Caster(points_m, self._mesh.triangles)
        hit = caster.cast(camera, _SUBPIXELS)
        ray = hit.of(points_m[self._mesh.triangles]) - dots.at_m
        distance = np.linalg.norm(ray, axis=1)
        facing = np.abs((self._normal(hit, normals) * ray).sum(axis=1)) / distance
        lit = dots.light(ray) * facing * (float(np.median(distance)) / distance) ** 2
        lit[caster.is_hidden(dots.at_m, ray)] = 0.0
        bright = (1 - _DYED) + _DYED * self._colors(hit).mean(axis=1)
        at = hit.of(self._flat).T / _WEAVE_M
        # Yarns and their shadows change the brightness, which is 1 in the mean.
        yarns = ndimage.map_coordinates(self._yarns, at, np.float64, order=1, mode="grid-wrap")
        bright *= (1.0 + _WEAVE * yarns) * (_DIFFUSE * facing + _DOTS * lit)
        return _averaged(_image(hit.seen, bright), camera).astype(np.float32)

    def _normal(self, hit: _Hit, normals: Float64) -> Float64:
        """Return the outward unit normals (N, 3) of hits: between those of vertices (N, 3)."""
        normal = hit.of(normals[self._mesh.triangles])
        normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-9)[:, None]
        return normal

    def _shaded(self, hit: _Hit, camera: Intrinsics, normals: Float64) -> Uint8:
        """Average the colors of the subpixels."""
        facing = self._normal(hit, normals) @ _LIGHT * np.where(hit.outer, 1.0, -1.0)
        rgb = self._colors(hit) * (_AMBIENT + (1 - _AMBIENT) * np.clip(facing, 0, 1))[:, None]
        rgb *= np.where(hit.outer, 1.0, 0.85)[:, None]
        averaged = _averaged(_image(hit.seen, rgb, _BACKGROUND), camera)
        rgb8: Uint8 = np.clip(np.rint(averaged * 255), 0, 255).astype(np.uint8)
        return rgb8

    def _colors(self, hit: _Hit) -> Float64:
        if self._texture == MESH_COLORS:
            return mesh_rgb(self._mesh, hit.triangle, hit.weights)
        flat, panel = hit.of(self._flat), self._panel[hit.triangle]
        rgb = np.full((len(panel), 3), 0.5)
        for number in np.unique(panel[panel > 0]):
            own = panel == number
            rgb[own] = pattern_rgb(self._texture, flat[own], int(number), self._seed)
        return rgb


@dataclass(frozen=True)
class _Hit:
    """Which rays hit, ``seen`` (h, w), and where: depth, triangle, weights of its corners, outer face."""

    seen: Bool
    depth_m: Float32
    triangle: Int32
    weights: Float64
    outer: Bool

    def of(self, corners: Float64) -> Float64:
        """Return the values (N, K) of hits, from those of the corners (T, 3, K) of triangles."""
        values: Float64 = (corners[self.triangle] * self.weights[..., None]).sum(axis=1)
        return values


class _Caster:
    """Open3D's ray casting for one pose."""

    def __init__(self, points_m: Float64, triangles: Int32) -> None:
        self._o3d: Any = load_open3d()
        self._scene = self._o3d.t.geometry.RaycastingScene()
        tangents = points_m[:, :2] / np.maximum(points_m[:, 2:], 0.02)
        self._least, self._most = tangents.min(axis=0), tangents.max(axis=0)
        self._scene.add_triangles(
            np.ascontiguousarray(points_m, dtype=np.float32), triangles.astype(np.uint32)
        )

    def is_hidden(self, from_m: Float64, rays: Float64) -> Bool:
        """Return whether anything lies on the way (N, 3) from a point to each end."""
        each = np.hstack([np.broadcast_to(from_m, rays.shape), rays]).astype(np.float32)
        found = self._scene.test_occlusions(self._o3d.core.Tensor(each), 0.0, _NOT_ITSELF)
        return np.asarray(found.numpy(), dtype=bool)

    def cast(self, camera: Intrinsics, subpixels: int) -> _Hit:
        """Cast ``subpixels`` squared rays through each pixel."""
        # Subpixel centres lie around the pixel centre, which has integer coordinates.
        y, x = ((np.arange(n * subpixels) + 0.5) / subpixels - 0.5 for n in (camera.height, camera.width))
        x, y = (x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy
        # Rays beside the item hit nothing.
        across, down = ((t >= self._least[k]) & (t <= self._most[k]) for k, t in enumerate((x, y)))
        rays = np.zeros((down.sum(), across.sum(), 6), dtype=np.float32)
        rays[..., 3], rays[..., 4], rays[..., 5] = x[across], y[down][:, None], 1.0
        answer = self._scene.cast_rays(self._o3d.core.Tensor(rays))
        depth = answer["t_hit"].numpy()
        seen = np.isfinite(depth)
        every = np.zeros((len(y), len(x)), dtype=bool)
        every[np.ix_(down, across)] = seen
        uv = answer["primitive_uvs"].numpy()[seen].astype(np.float64)
        outer = (answer["primitive_normals"].numpy()[seen] * rays[seen, 3:]).sum(axis=-1) < 0
        return _Hit(
            every,
            depth[seen],
            answer["primitive_ids"].numpy()[seen].astype(np.int32),
            np.concatenate([1 - uv.sum(axis=-1, keepdims=True), uv], axis=-1),
            outer,
        )


def _image(seen: Bool, values: NDArray[Any], around: Float64 | float = 0.0) -> NDArray[Any]:
    """Return an image with the values where something is seen, and one value around it."""
    image = np.full((*seen.shape, *values.shape[1:]), around, dtype=values.dtype)
    image[seen] = values
    return image


def _averaged(fine: NDArray[Any], camera: Intrinsics) -> NDArray[Any]:
    """Return the mean of the subpixels of each pixel."""
    return cv2.resize(fine, (camera.width, camera.height), interpolation=cv2.INTER_AREA)


def vertex_normals(points_m: Float64, triangles: Int32) -> Float64:
    """Return outward unit normals (N, 3) of vertices, the mean of the triangles' weighted by their areas."""
    a, b, c = (points_m[triangles[:, k]] for k in range(3))
    face = np.cross(b - a, c - a)
    shares, count = np.repeat(face, 3, axis=0).T, len(points_m)
    normals = np.stack([np.bincount(triangles.ravel(), share, count) for share in shares], axis=1)
    length: Float64 = np.maximum(np.linalg.norm(normals, axis=1), 1e-12)
    return normals / length[:, None]
