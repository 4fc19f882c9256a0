"""Features of a view for registration, and the agreement of two views about common cloth.

Points of either view are moved to the other, projected into its image, and compared with the surface there
along its normal (point to plane), and with its texture. Comparisons are weighted by the incidence angles of
both cameras: near the horizon of a surface, points hidden from the other camera are projected onto the layer
in front of them, always behind it, and would pull the views together.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np

from flatcloth.core.cache import Cache
from flatcloth.core.geometry import Rigid3, back_project
from flatcloth.core.types import Bool, Float32, Float64, Int32, Intrinsics
from flatcloth.flattening.surface import Surface
from flatcloth.registration.normal_equations import ComparedView, Limits, Sums, Transforms, accumulate

POINTS_PER_VIEW = 1200
"""Approximate number of compared points of a view. Set by hand."""
MOST_APART_DEG = 65.0
"""Views with directions farther apart than this share little cloth. Set by hand; tests/registration tries
turns of 60 degrees."""
_NORMAL_SMOOTHING_PX = 2.0
"""Smoothing of the normals where the depth is noisy. Set by hand."""
_TEXTURE_SIZE_M = 0.007
"""Texture is the color minus its mean over this size. Set by hand."""
_BLOCK_SIZE_M = 0.080
"""Errors count as independent only beyond this size. Set by hand."""

CHANNELS = 3
"""Channels of texture: brightness and two color differences, logarithmic, without their local means. By
definition."""
TERMS = 1 + CHANNELS
"""Terms of the comparison: the distance, and the channels. By definition."""
MOTION = 6
"""Degrees of freedom of a motion. By definition."""
UNKNOWNS = 1 + MOTION
"""The motion of one view against the other (rotation about x, y, z; shift), and the fattening. By
definition."""
_IMAGES_KEPT = 16
"""Views whose images for comparison are kept. Chosen: those of a view take 1 MB and are made in 5 ms;
every new view is compared with about four others."""


class ComparedImages(NamedTuple):
    """The images (H, W, ...) float32 that a comparison reads, made from a view's surface.

    ``texture`` (3, H, W); ``normals``, smoothed, NaN off the surface; None: those of the surface, which need
    no smoothing.
    """

    texture: Float32
    normals: Float32 | None


@dataclass(frozen=True, kw_only=True, eq=False)
class ViewFeatures:
    """The data of one view for registration, camera frame.

    ``points_m`` (N, 3), ``pixel`` (N, 2), on a grid of the image; ``pixel_pitch_m`` the
    median size of a pixel on the surface; ``noise_m`` the scatter of the depth. Images (H, W, ...):
    ``depth_m`` float32, NaN off the surface, which is ``usable``; ``inner`` whether the texture is
    unaffected by the outline. ``make_images`` makes the others, which take most memory and are kept for
    a few views only, by ``key``. ``surface`` is what they are computed from, for those that need it later.
    """

    view_index: int
    angle_deg: float
    intrinsics: Intrinsics
    noise_m: float
    pixel_pitch_m: float
    points_m: Float64
    pixel: Int32
    depth_m: Float32
    usable: Bool
    inner: Bool
    make_images: Callable[[], ComparedImages]
    surface: Surface | None = None
    key: object = field(default_factory=object)

    @cached_property
    def middle_m(self) -> Float64:
        """The median (3,) of the points."""
        middle: Float64 = np.median(self.points_m, axis=0)
        return middle

    @cached_property
    def normal(self) -> Float64:
        """The normals (N, 3) of the points."""
        return self.normals[self.pixel[:, 0], self.pixel[:, 1]].astype(np.float64)

    @property
    def all_points_m(self) -> Float64:
        """All points (N, 3) of the surface."""
        return back_project(self.depth_m, self.intrinsics)[self.usable].astype(np.float64)

    @property
    def images(self) -> ComparedImages:
        """The images that a comparison reads."""
        return _images.get(self.key, self.make_images)

    @property
    def normals(self) -> Float32:
        """The normals (H, W, 3) that a comparison reads."""
        normals = self.images.normals
        if normals is None:
            assert self.surface is not None
            return self.surface.normal
        return normals

    def compared(self) -> ComparedView:
        """Return the arrays as the compiled loops take them."""
        k = self.intrinsics
        return ComparedView(
            points_m=self.points_m,
            normal=self.normal,
            pixel=self.pixel,
            depth_m=self.depth_m,
            normals=self.normals,
            usable=self.usable,
            texture=self.images.texture,
            inner=self.inner,
            camera=np.array([k.fx, k.fy, k.cx, k.cy]),
        )


_images: Cache[ComparedImages] = Cache(_IMAGES_KEPT, _IMAGES_KEPT << 20)
"""Of the views compared last, whichever shape they belong to; a key keeps no view in memory."""


@dataclass(frozen=True, kw_only=True)
class Gates:
    """Which points of two views correspond, and how they are weighted by incidence.

    The default values are for poses known to a few degrees and millimetres. Chosen; stricter ones
    leave less surface, laxer ones compare what the other view does not show.
    """

    same_normal_cos: float = 0.9
    """Points correspond if their normals differ by at most the angle of this cosine."""
    least_facing_cos: float = 0.45
    """Surface at a smaller cosine of incidence for either camera does not count, ..."""
    full_facing_cos: float = 1.0
    """... and at this one it counts fully."""


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """The agreement of two views: the terms are the distance (m) and the channels of the texture.

    For each term: ``matrix`` (4, 7, 7) and ``gradient`` (4, 7) of half the weighted sum of squares,
    unscaled; ``scores`` (4, B, 7) the gradient by blocks of the image; ``spread`` (4,) of the
    differences, robust, NaN without any; ``likeness`` (3,) correlation of the texture; ``count``
    compared points (both directions), ``parts`` (B,) by block, ``inner`` off the outlines of both views;
    ``inertia`` (6, 6) the information about the motion if displacements were observed in all directions.
    ``tally`` (3,): the points that the other view should show, as they fall on its image and face it, the sum
    of their weights by distance, and of the squared distances (m^2) with these weights.
    """

    matrix: Float64
    gradient: Float64
    scores: Float64
    spread: Float64
    likeness: Float64
    count: int
    parts: Float64
    inner: int
    inertia: Float64
    tally: Float64


def extract_features(surface: Surface) -> ViewFeatures:
    """Compute the features of a view for registration.

    Parameters
    ----------
    surface : Surface
        The view's surface.

    Notes
    -----
    Images are made at the first comparison, in 5 ms for a garment of 40 000 pixels.
    """
    pixel = grid_points(surface.usable)
    return ViewFeatures(
        surface=surface,
        view_index=surface.frame.view_index,
        angle_deg=surface.frame.angle_deg,
        intrinsics=surface.frame.intrinsics,
        noise_m=surface.noise_m,
        depth_m=surface.depth_m,
        usable=surface.usable,
        pixel_pitch_m=surface.pixel_pitch_m,
        points_m=surface.xyz_m[pixel[:, 0], pixel[:, 1]].astype(np.float64),
        pixel=pixel,
        inner=cv2.erode(surface.usable.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0,
        make_images=lambda: _images_of(surface),
    )


def _images_of(surface: Surface) -> ComparedImages:
    texture = _texture(surface, _TEXTURE_SIZE_M / surface.pixel_pitch_m)
    return ComparedImages(texture, _smoothed(surface, _NORMAL_SMOOTHING_PX) if surface.noisy else None)


def grid_points(usable: Bool, most: int = POINTS_PER_VIEW) -> Int32:
    """Return up to about ``most`` pixels (N, 2) of the surface, on a grid of the image."""
    stride = max(1, math.ceil(math.sqrt(np.count_nonzero(usable) / most)))
    pixel = (stride * np.argwhere(usable[::stride, ::stride])).astype(np.int32)
    if not len(pixel):
        pixel = np.argwhere(usable).astype(np.int32)  # a small surface between the grid points
    return pixel


def _smoothed(surface: Surface, sigma_px: float) -> Float32:
    """Return the normals (H, W, 3) of the surface, averaged; NaN off it."""
    off = ~surface.usable
    planes = []
    for n in range(3):
        plane = np.ascontiguousarray(surface.normal[..., n])
        plane[off] = 0.0
        planes.append(cv2.GaussianBlur(plane, (0, 0), sigma_px))
    length = np.sqrt(planes[0] ** 2 + planes[1] ** 2 + planes[2] ** 2)
    length[off] = np.nan
    smoothed: Float32 = cv2.merge([plane / length for plane in planes]).astype(np.float32, copy=False)
    return smoothed


_LOG = np.log(np.maximum(np.arange(256), 1)).astype(np.float32)
"""Logarithm of each value of a colour. By definition."""


def _texture(surface: Surface, size_px: float) -> Float32:
    """Texture (3, H, W), slightly smoothed, minus its mean over that size; 0 off the surface.

    It is logarithmic, so that shading adds to the first channel only, over the size of the folds, and
    does not change the color differences.
    """
    inside = surface.usable.astype(np.float32)
    red, green, blue = (cv2.LUT(plane, _LOG) * inside for plane in cv2.split(surface.frame.color))
    fine, coarse = (_blurred_share(inside, sigma) for sigma in (1.0, size_px))
    texture = np.empty((CHANNELS, *inside.shape), dtype=np.float32)
    third, half = np.float32(1 / 3), np.float32(0.5)
    mixed: list[Float32] = [third * (red + green + blue), red - green, half * (red + green) - blue]
    around = np.empty_like(inside)
    for near, image in zip(texture, mixed, strict=True):  # in place: large new arrays take time
        cv2.GaussianBlur(image, (0, 0), 1.0, dst=near)
        cv2.GaussianBlur(image, (0, 0), size_px, dst=around)
        near *= fine
        around *= coarse
        near -= around
        near *= inside
    return texture


def _blurred_share(inside: Float32, sigma_px: float) -> Float32:
    """Factor that normalises a blurred image of which only a part is known."""
    blurred = np.maximum(cv2.GaussianBlur(inside, (0, 0), sigma_px), np.float32(1e-6))
    share: Float32 = np.reciprocal(blurred).astype(np.float32)
    return share


def compare(
    one: ViewFeatures,
    other: ViewFeatures,
    object_from_one: Rigid3,
    object_from_other: Rigid3,
    center_m: Float64,
    fattening_px: float,
    search_radius_m: float,
    spread: Float64,
    every: int = 1,
    gates: Gates = Gates(),
    *,
    of_focal: bool = False,
) -> Agreement:
    """Compare two views in both directions.

    Parameters
    ----------
    one, other : ViewFeatures
        The views.
    object_from_one, object_from_other : Rigid3
        Their camera poses, ``object_from_camera``.
    center_m : (3,) float64
        Object frame; centre of the rotation of ``one`` against ``other``.
    fattening_px : float
        Edge fattening of the sensor in pixels.
    search_radius_m : float
        Points farther from the other surface than this are not compared.
    spread : (4,) float64
        Typical size of the differences; differences of several times this size have little
        weight. 0: the term is left out.
    every : int
        Step between the compared points.
    gates : Gates
        Which points correspond.
    of_focal : bool
        The seventh unknown of the distance is the logarithm of the focal length, not the fattening.
    """
    sums, limits = nothing_compared(one, other, every, gates)
    limits = limits._replace(
        search_radius_m=search_radius_m, fattening_px=fattening_px, spread=spread, of_focal=of_focal
    )
    ends = one.compared(), other.compared()
    for source, target, object_from_source, object_from_target, sign in (
        (*ends, object_from_one, object_from_other, 1.0),
        (*ends[::-1], object_from_other, object_from_one, -1.0),
    ):
        moved = object_from_target.inverse() @ object_from_source
        transforms = Transforms(
            rotation=np.ascontiguousarray(moved.rotation),
            translation_m=moved.translation_m,
            object_rotation=np.ascontiguousarray(object_from_target.rotation),
            object_shift_m=object_from_target.translation_m - center_m,
            sign=sign,
        )
        accumulate(source, target, transforms, limits, sums)
    points, textured = sums.counts.tolist()
    kept = [sums.found[0, :points], *sums.found[1:, :textured]]
    energy = np.sqrt(sums.products[:, 0] * sums.products[:, 1])
    return Agreement(
        matrix=sums.matrix,
        gradient=sums.scores.sum(axis=1),
        scores=sums.scores,
        spread=np.array([_usual(term) for term in kept]),
        likeness=np.where(energy > 0, sums.products[:, 2] / np.where(energy > 0, energy, 1.0), 0.0),
        count=points,
        parts=sums.parts,
        inner=textured,
        inertia=_inertia(sums.moments),
        tally=sums.tally,
    )


def nothing_compared(one: ViewFeatures, other: ViewFeatures, every: int, gates: Gates) -> tuple[Sums, Limits]:
    """Return empty sums for two views, and the limits, with no radius, no fattening and no spread."""
    block_px = max(4.0, _BLOCK_SIZE_M / one.pixel_pitch_m)
    rows, cols = (int(size / block_px) + 1 for size in one.usable.shape)
    blocks, points = rows * cols, len(one.points_m) + len(other.points_m)
    limits = Limits(
        search_radius_m=0.0,
        same_normal_cos=gates.same_normal_cos,
        least_facing_cos=gates.least_facing_cos,
        full_facing_cos=gates.full_facing_cos,
        shown_facing_cos=Gates().least_facing_cos,
        fattening_px=0.0,
        spread=np.zeros(TERMS),
        every=every,
        blocks_per_px=1 / block_px,
        block_cols=cols,
        of_focal=False,
    )
    sums = Sums(
        matrix=np.zeros((TERMS, UNKNOWNS, UNKNOWNS)),
        scores=np.zeros((TERMS, blocks, UNKNOWNS)),
        products=np.zeros((CHANNELS, 3)),
        parts=np.zeros(blocks),
        moments=np.zeros((4, 4)),
        tally=np.zeros(3),
        found=np.zeros((TERMS, points)),
        counts=np.zeros(2, dtype=np.int64),
    )
    return sums, limits


def _usual(differences: Float64) -> float:
    """Return the standard deviation of absolute differences from their median; NaN without any."""
    middle = differences.size // 2
    return 1.4826 * float(np.partition(differences, middle)[middle]) if differences.size else math.nan


def _inertia(moments: Float64) -> Float64:
    """Sum of J' J (6, 6), where J is the derivative of a point by its motion; moments of (x, 1)."""
    (xx, xy, xz, x), (_, yy, yz, y), (_, _, zz, z), (_, _, _, count) = moments.tolist()
    return np.array(
        [
            [yy + zz, -xy, -xz, 0.0, -z, y],
            [-xy, xx + zz, -yz, z, 0.0, -x],
            [-xz, -yz, xx + yy, -y, x, 0.0],
            [0.0, z, -y, count, 0.0, 0.0],
            [-z, 0.0, x, 0.0, count, 0.0],
            [y, -x, 0.0, 0.0, 0.0, count],
        ]
    )
