"""All views of a recording, prepared for segmentation: surface pixels, clusters, and their evidence."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from flatcloth.core.config import Config
from flatcloth.core.errors import SegmentationError, SurfaceError
from flatcloth.core.geometry import Rigid3, object_from_camera
from flatcloth.core.types import (
    Bool,
    Float32,
    Float64,
    Int32,
    Int64,
    Intrinsics,
    Progress,
    RgbdFrame,
    RotationAxis,
    Uint8,
    no_progress,
)
from flatcloth.flattening.surface import Surface, crop_to_item, observe_surface
from flatcloth.registration.axis import THREADS
from flatcloth.registration.cameras import Fits, register
from flatcloth.registration.view_features import ViewFeatures, extract_features
from flatcloth.segmentation.clusters import Clusters, gather
from flatcloth.segmentation.inner import inner_faces
from flatcloth.segmentation.item import CutOff, checked, find_item
from flatcloth.segmentation.relations import SignedGraph, links_of_view, signed_graph, surroundings
from flatcloth.segmentation.settings import SETTINGS

_T = TypeVar("_T", np.float32, np.int32)
_LOOK = 2
"""The camera poses are checked on every second view first. Chosen: this
finds the one recording with wrong poses, and no other, in a fifth of the time."""


@dataclass(frozen=True, kw_only=True)
class ObservedView:
    """One view of the item, cropped to it.

    ``view_index``; ``offset_rc`` of the crop in the recorded image of ``full_shape``; ``intrinsics`` of
    the crop; ``object_from_camera`` the camera pose; ``item`` (h, w) bool, measured pixels of
    the item, and ``outlined`` those within its outline by color; ``depth_m`` (h, w) float32; ``cluster``
    (h, w) int32, -1 where none is near, and ``shows`` (K,) int32 those that occur; ``surface`` (h, w) bool,
    pixels that made the clusters; ``area_m2`` (h, w) float32, cloth under each of those.
    """

    view_index: int
    offset_rc: tuple[int, int]
    full_shape: tuple[int, int]
    intrinsics: Intrinsics
    object_from_camera: Rigid3
    item: Bool
    outlined: Bool
    depth_m: Float32
    cluster: Int32
    shows: Int32
    surface: Bool
    area_m2: Float32

    def whole(self, crop: Bool) -> Bool:
        """Return a crop (h, w) pasted into the recorded image (H, W)."""
        image = np.zeros(self.full_shape, dtype=np.bool_)
        (top, left), (rows, cols) = self.offset_rc, crop.shape
        image[top : top + rows, left : left + cols] = crop
        return image


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """The views and their evidence of sides; immutable.

    ``views`` that show the item, by their number in the recording; ``clusters``, ``graph`` the evidence;
    ``around`` (M, M) the mean over what lies around each cluster and faces alike; ``color`` (M, 3) float64 of
    the clusters, CIELAB in 8 bits; ``inner`` (M,) int64 numbers of inner faces, seen through an opening, -1
    elsewhere; ``cut_off`` the regions that were removed. ``noisy``: most views have a sensor's noise.
    """

    views: dict[int, ObservedView]
    clusters: Clusters
    graph: SignedGraph
    around: csr_matrix
    color: Float64
    inner: Int64
    cut_off: tuple[CutOff, ...]
    noisy: bool

    @property
    def start_view(self) -> int:
        """The view that shows most of the item."""
        return max(self.views, key=lambda n: float((self.views[n].depth_m[self.views[n].item] ** 2).sum()))


def gather_evidence(
    frames: Sequence[RgbdFrame],
    axis: RotationAxis,
    held_point_m: Float64,
    config: Config,
    progress: Progress = no_progress,
    confirmed: bool = False,
) -> Evidence:
    """Find the item in all views, and their evidence of its sides.

    Parameters
    ----------
    frames : sequence of RgbdFrame
        The views, in the order of the recording; all of them, or some. Their masks are not used.
    axis : RotationAxis
        Turning axis, camera frame of view 0.
    held_point_m : (3,) float64
        Where the item is held.
    config : Config
        Of surface and registration.
    progress : callable
        Called with the share of the work that is done; may raise ``CancelledError``.
    confirmed : bool
        The recorded poses of the cameras are known to be right; otherwise the views are compared.

    Raises
    ------
    SegmentationError
        If no view shows an item, or there are two; or if two frames have the same number.
    """
    at = {frame.view_index: n for n, frame in enumerate(frames)}
    if len(at) != len(frames):
        raise SegmentationError("Two frames have the same view number; give each view once.")
    looking = "looking for the item"
    item = find_item(frames, axis, held_point_m, config.surface, lambda: progress(0.0, looking))
    crops = [crop_to_item(frame, own) for frame, own in zip(frames, item.masks, strict=True) if own.any()]
    del frames  # they take most memory, unless the caller keeps them
    surfaces = _surfaces(crops, axis, config, lambda: progress(0.1, "surfaces of the views"))
    progress(0.3, "where the cameras stand")
    poses = _poses(surfaces, axis, held_point_m, confirmed)
    progress(0.6, "clusters of the surface")
    noise_m = float(np.median([surface.noise_m for surface in surfaces]))
    noisy = bool(np.median([surface.noisy for surface in surfaces]))
    seen, of_views, colors = list[tuple[ObservedView, Float32, Uint8]](), [], []
    for pose in poses:  # the clusters need few of the surfaces' 25 bytes a pixel
        surface = surfaces.pop(0)
        n = at[surface.frame.view_index]
        of_views.append(_points_of(surface, pose))
        seen.append(_view(surface, pose, (item.masks[n], item.outlined[n]), of_views[-1][2]))
        colors.append(cv2.cvtColor(surface.frame.color, cv2.COLOR_RGB2LAB)[surface.usable])
    points, normals, cos = (np.concatenate(each) for each in zip(*of_views, strict=True))
    del crops, of_views, surface
    clusters = gather(points, normals, cos, noise_m)
    sums = [np.bincount(clusters.of_pixel, each) for each in np.concatenate(colors).T]
    mean = np.stack(sums, axis=1) / clusters.pixels[:, None]
    del points, normals, cos, colors
    views, facing, steps = zip(*seen, strict=True)
    ends = np.cumsum([np.count_nonzero(view.surface) for view in views])[:-1]
    labels = [
        _image(view.surface, own) for view, own in zip(views, np.split(clusters.of_pixel, ends), strict=True)
    ]
    with ThreadPoolExecutor(THREADS) as pool:
        graph = signed_graph(clusters, list(pool.map(links_of_view, labels, facing, steps)))
        around = surroundings(clusters, SETTINGS.border_m)
        inner = pool.submit(inner_faces, clusters, graph, around, mean[:, 0])
        views = tuple(pool.map(_labelled, views, labels))
    progress(0.8, "sides")
    return Evidence(
        views={view.view_index: view for view in views},
        clusters=clusters,
        graph=graph,
        around=around,
        color=mean,
        inner=inner.result(),
        cut_off=item.cut_off,
        noisy=noisy,
    )


def _surfaces(
    crops: Sequence[tuple[RgbdFrame, Bool]], axis: RotationAxis, config: Config, check: Callable[[], None]
) -> list[Surface]:
    with ThreadPoolExecutor(THREADS) as pool:
        seen = checked(pool.map(lambda crop: _surface(crop[0], crop[1], axis, config), crops), check)
    surfaces = [surface for surface in seen if surface is not None]
    if not surfaces:
        raise SegmentationError("No view shows cloth that differs from its surroundings; check the depth.")
    return surfaces


def _surface(frame: RgbdFrame, item: Bool, axis: RotationAxis, config: Config) -> Surface | None:
    try:
        return observe_surface(replace(frame, mask=None), axis, config.surface, item, torn=True)
    except SurfaceError:
        return None


def _poses(
    surfaces: Sequence[Surface], axis: RotationAxis, held_point_m: Float64, confirmed: bool
) -> Sequence[Rigid3]:
    """Return the camera poses: the recorded ones, unless the views contradict them."""
    known = [object_from_camera(axis, surface.frame.angle_deg) for surface in surfaces]
    if confirmed or len(surfaces) < 2:
        return known
    fits: Fits = {}
    for step in (_LOOK, 1):
        with ThreadPoolExecutor(THREADS) as pool:
            features = list(pool.map(_features, surfaces[::step]))
        registered = register(features, axis, held_point_m, fits, threads=THREADS)
        if not registered.is_loose:
            return known
    return registered.object_from_camera


def _features(surface: Surface) -> ViewFeatures:
    """Features with uncompressed images: all views are compared once, and then no longer needed."""
    features = extract_features(surface)
    images = features.images
    return replace(features, make_images=lambda: images)


def _points_of(surface: Surface, pose: Rigid3) -> tuple[Float32, Float32, Float32]:
    """Return points and normals (N, 3) of a surface, object frame, and cosines (N,) of the incidence."""
    xyz_m, normal = surface.xyz_m[surface.usable], surface.normal[surface.usable]
    cos = -(xyz_m * normal).sum(axis=-1) / np.linalg.norm(xyz_m, axis=-1)
    return pose.apply(xyz_m).astype(np.float32), pose.turn(normal).astype(np.float32), cos.astype(np.float32)


def _image(shown: Bool, values: NDArray[_T], elsewhere: float = -1) -> NDArray[_T]:
    """Return an image (h, w) of the values (N,) of the pixels shown."""
    image = np.full(shown.shape, elsewhere, dtype=values.dtype)
    image[shown] = values
    return image


def _view(
    surface: Surface, pose: Rigid3, masks: tuple[Bool, Bool], cos: Float32
) -> tuple[ObservedView, Float32, Uint8]:
    """Return a view that has no clusters yet, the cosine of the incidence (h, w), and the surface's steps."""
    frame, facing = surface.frame, _image(surface.usable, cos)
    (top, left), (rows, cols), k = frame.offset_rc, frame.depth_m.shape, frame.intrinsics
    item, outlined = (mask[top : top + rows, left : left + cols] for mask in masks)
    view = ObservedView(
        view_index=frame.view_index,
        offset_rc=frame.offset_rc,
        full_shape=(masks[0].shape[0], masks[0].shape[1]),
        intrinsics=k,
        object_from_camera=pose,
        item=item,
        outlined=outlined,
        depth_m=frame.depth_m,
        cluster=np.empty((0, 0), dtype=np.int32),
        shows=np.empty(0, dtype=np.int32),
        surface=surface.usable,
        area_m2=np.where(surface.usable, frame.depth_m**2 / (k.fx * k.fy) / facing, 0).astype(np.float32),
    )
    return view, facing, surface.steps


def _labelled(view: ObservedView, label: Int32) -> ObservedView:
    near = filled(label, view.depth_m, view.item)
    return replace(view, cluster=near, shows=np.unique(near[near >= 0]))


def filled(label: Int32, depth_m: Float32, item: Bool) -> Int32:
    """Assign pixels of the item without a cluster to that of a near pixel on the same layer.

    Pixels near rims and holes, and steep ones, form no clusters. They take the cluster of the nearest pixel
    with one if its depth is similar.
    """
    known = (label >= 0).astype(np.uint8)
    result = label.copy()
    if not known.any():
        return result
    _, nearest = cv2.distanceTransformWithLabels(1 - known, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    at = np.zeros(int(nearest.max()) + 1, dtype=np.int64)
    at[nearest[label >= 0]] = np.flatnonzero(label >= 0)
    source = at[nearest]
    alike = np.abs(depth_m.ravel()[source] - depth_m) <= SETTINGS.near_m
    taken = item & (label < 0) & alike
    result[taken] = label.ravel()[source[taken]]
    return result
