"""Markers of a kit: in a color image, in the views of a recording, the truth they show, stickers in photos.

OpenCV reads some markers of an image. The print is known, so the map from a marker's plane to the image is
the one that makes them most alike, which finds corners to about 0.1 px, also on bent cloth. The neighbours of
a fitted marker are predicted and fitted in turn, which needs no reading.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import LinearNDInterpolator
from scipy.optimize import least_squares
from scipy.spatial import Delaunay

from flatcloth.core.types import Bool, FlattenedView, Float64, Int64, Progress, RgbdFrame, Uint8, no_progress
from flatcloth.engine.evaluation import trimmed_fit
from flatcloth.recordings.base import Recording
from flatcloth.validation.kit import FEWEST, SQUARE, Kit, KitError, dictionary_codes, lengths, marker_at

_MOST_UP, _LARGE_PX = 3, 2600
"""Images are enlarged to so many times and pixels at most before reading. Chosen: codes of 17 px are read."""
_LEAST_LIKE, _LEAST_CODE = 0.8, 0.65
"""Correlation with the image of the print, and of its code in each half, if a marker is there. Measured by
``python -m benchmarks validation``: no id is wrong; by the code alone, 1 neighbour in 1,000 is misplaced."""
_SAMPLES = 2, 10
"""Least and most samples along a module; between, one a pixel. Chosen: more cost time only."""
_BLUR_PX, _LEAST_BLUR = 0.55, 0.1
"""Blur of the print by camera and cloth in pixels, and the least in modules. Measured there: best."""
_STIFFNESS = (*[1.0] * 5, *[0.01] * 9)
"""Weight against bending at each step. Measured there: the first find a marker, the others follow it."""
_LEAST_PIXELS, _LEAST_SHARE, _OUTLIER = 24, 0.7, 3.0
"""Measured pixels inside a marker for its depth, their share, and the deviations beyond which one does not
count. Chosen: four times the unknowns."""


def found_markers(color: Uint8, kit: Kit) -> dict[int, Float64]:
    """Find the markers of a kit in a color image (H, W, 3), RGB; it takes about 5 ms a marker.

    Return the corners (4, 2) of each id, in the order of ``Kit.corners_m``, x right, y down; centers of
    pixels have whole coordinates.
    """
    gray = cv2.cvtColor(color, cv2.COLOR_RGB2GRAY)
    slopes = [cv2.Sobel(gray, cv2.CV_32F, k, 1 - k, scale=1 / 8) for k in (1, 0)]
    image = np.dstack([gray.astype(np.float32), *slopes])
    prints, ids = dictionary_codes(kit.dictionary), np.array(list(kit.places_m))
    centers = np.stack([corners.mean(axis=0) for corners in kit.places_m.values()])
    found: dict[int, Float64] = {}
    waiting = deque(_read(gray, kit))
    while waiting:
        i, guess_px = waiting.popleft()
        if i not in found and (corners_px := _fitted(image, prints[i], guess_px)) is not None:
            found[i] = corners_px
            motion = cv2.getPerspectiveTransform(*np.array([kit.corners_m[i], corners_px], dtype=np.float32))
            apart = np.linalg.norm(centers - centers[ids == i], axis=1) / kit.reach_m
            around = ids[apart <= kit.is_measured].tolist()
            waiting += [(n, cv2.perspectiveTransform(kit.corners_m[n][None], motion)[0]) for n in around]
    return dict(sorted(found.items()))


def _read(gray: NDArray[Any], kit: Kit) -> list[tuple[int, Float64]]:
    """Return the ids of the kit that OpenCV reads, and their corners (4, 2), roughly."""
    up = int(np.clip(_LARGE_PX // max(gray.shape), 1, _MOST_UP))
    large = cv2.resize(gray, None, fx=up, fy=up, interpolation=cv2.INTER_CUBIC)
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, kit.dictionary))
    corners, found, _ = cv2.aruco.ArucoDetector(dictionary).detectMarkers(large)
    ids = [int(i) for i in np.ravel(found)] if len(corners) else []
    places = (np.reshape(corners, (-1, 4, 2)).astype(np.float64) + 0.5) / up - 0.5
    return [(i, place) for i, place in zip(ids, places, strict=True) if i in kit.sheet]


def terms(places: Float64) -> Float64:
    """Return the terms (N, 6) of a map of second order at places (N, 2): 1, x, y, xy, x^2, y^2."""
    x, y = places.T
    return np.stack([np.ones_like(x), x, y, x * y, x * x, y * y], axis=-1)


def _fitted(image: NDArray[np.float32], black: Bool, guess_px: Float64) -> Float64 | None:
    """Return the corners (4, 2) of a marker that is where it was guessed, otherwise None.

    Gauss-Newton steps for the map of second order, the contrast, the brightness and its slope that minimise
    the squared differences between print and ``image`` (H, W, 3), which is brightness and its slopes.
    """
    module_px = float(np.linalg.norm(guess_px[2] - guess_px[0])) / math.sqrt(2) / len(black)
    samples = int(np.clip(round(module_px), *_SAMPLES))
    along = np.ones(samples * (len(black) + 2))  # with the quiet zone
    at = (np.argwhere(np.outer(along, along))[:, ::-1] + 0.5) / samples - 1
    places = at * (2 / len(black)) - 1
    enlarged = np.kron(np.pad(~black, 1, constant_values=True), np.ones((8, 8))).astype(np.float32)
    blurred = cv2.GaussianBlur(enlarged, (0, 0), 8 * max(_BLUR_PX / module_px, _LEAST_BLUR))
    ink = _looked_up(np.asarray(blurred, dtype=np.float32), (at + 1) * 8 - 0.5)
    sampled, corners = terms(places), terms(SQUARE)
    shade = np.column_stack([-ink, -np.ones(len(at)), -places])
    motion = np.vstack([np.linalg.solve(corners[:, :4], guess_px), np.zeros((2, 2))])
    bends = np.tile([0.0, 0.0, 0.0, 1.0, 1.0, 1.0], 2)
    for stiffness in _STIFFNESS:
        at_px = sampled @ motion
        if not ((at_px >= 0) & (at_px < image.shape[1::-1])).all():
            return None
        seen = _looked_up(image, at_px)
        columns = np.hstack([sampled * seen[:, 1:2], sampled * seen[:, 2:], shade])
        weight = stiffness * seen[:, 0].var() * len(seen) * bends
        right = -columns.T @ seen[:, 0]
        right[:12] -= weight * motion.T.ravel()
        normal = columns.T @ columns + np.diag(np.append(weight, np.zeros(4)))
        motion += np.linalg.lstsq(normal, right)[0][:12].reshape(2, 6).T
    # The code without its border is compared in each half: other codes fit by chance, or a side slips.
    modules = np.argwhere(black[1:-1, 1:-1] >= 0)[:, ::-1].astype(np.float64)
    inner = terms((modules + 1.5) * (2 / len(black)) - 1)
    pairs = np.stack([_looked_up(image, inner @ motion)[:, 0], ~black[1:-1, 1:-1].ravel()])
    halves = [pairs[:, inner[:, k] * sign > 0] for k in (1, 2) for sign in (1, -1)]
    with np.errstate(invalid="ignore", divide="ignore"):  # where nothing varies nothing is alike
        is_code = all(np.corrcoef(half)[0, 1] > _LEAST_CODE for half in halves)
        is_print = np.corrcoef(ink, _looked_up(image, sampled @ motion)[:, 0])[0, 1] > _LEAST_LIKE
    return corners @ motion if is_code and is_print else None


def _looked_up(image: NDArray[np.float32], at_px: Float64) -> Float64:
    """Return the values (N,) or (N, K) of an image at places (N, 2)."""
    x, y = np.ascontiguousarray(at_px.T[:, None], dtype=np.float32)
    return np.asarray(cv2.remap(image, x, y, cv2.INTER_CUBIC)[0], dtype=np.float64)


@dataclass(frozen=True)
class Sightings:
    """All sightings of markers, one row each: ``view``, ``marker`` the id (M,), ``corners_px`` (M, 4, 2).

    ``corners_m`` (M, 4, 3) are on a surface of second order that fits the depth inside the marker, camera
    frame; ``noise_m`` (M,) is the deviation of the depth from it. NaN where too little depth was measured.
    """

    view: Int64
    marker: Int64
    corners_px: Float64
    corners_m: Float64
    noise_m: Float64

    def of_view(self, view: int) -> dict[int, Float64]:
        """Return the corners (4, 2) of the markers of a view by their ids, as ``found_markers`` does."""
        rows = np.flatnonzero(self.view == view)
        return dict(zip(self.marker[rows].tolist(), self.corners_px[rows], strict=True))

    @cached_property
    def cosine(self) -> Float64:
        """The cosine (M,) of the angle between line of sight and normal, as depth shows it."""
        places = self.corners_m
        normal = np.cross(places[:, 2] - places[:, 0], places[:, 3] - places[:, 1])
        normal, sight = (v / np.linalg.norm(v, axis=1)[:, None] for v in (normal, places.mean(axis=1)))
        return np.asarray(np.abs((normal * sight).sum(axis=1)))


def sightings_of(recording: Recording, kit: Kit, progress: Progress = no_progress) -> Sightings:
    """Find the markers of a kit in all views; ``KitError`` tells why there are too few."""
    rows: list[Iterable[object]] = []
    for n in range(len(recording)):
        progress(n / len(recording), f"markers of view {n}")
        frame = recording[n]
        found = found_markers(frame.color, kit)
        rows += [(n, marker, corners, *_surface(frame, corners)) for marker, corners in found.items()]
    seen = Sightings(*[np.array(each) for each in zip(*rows, strict=True)] or [np.zeros(0)] * 5)
    if len(set(seen.marker)) < FEWEST:
        raise KitError(
            f"{recording.location}: {len(set(seen.marker))} markers of the kit {kit.name} are found. Give "
            "the kit that was printed with --kit, and record nearer or sharper: a marker needs 12 pixels."
        )
    return seen


def _surface(frame: RgbdFrame, corners_px: Float64) -> tuple[Float64, float]:
    """Return the corners (4, 3) and the noise of a marker; NaN if too little is measured inside."""
    inside = np.zeros(frame.depth_m.shape, dtype=np.uint8)
    cv2.fillConvexPoly(inside, np.rint(16 * corners_px).astype(np.int32), 1, shift=4)
    (y, x), middle, k = np.nonzero(inside & (frame.depth_m > 0)), corners_px.mean(axis=0), frame.intrinsics
    if len(x) < max(_LEAST_PIXELS, _LEAST_SHARE * np.count_nonzero(inside)):
        return np.full((4, 3), np.nan), math.nan
    z, at = frame.depth_m[y, x].astype(np.float64), terms(np.stack([x, y], axis=1) - middle)
    kept = np.abs(z - np.median(z)) < np.ptp(corners_px, axis=0).max() * np.median(z) / k.fx
    for _ in range(3):
        fit = np.linalg.lstsq(at[kept], z[kept], rcond=None)[0]
        off = np.abs(z - at @ fit)
        noise = 1.4826 * float(np.median(off[kept]))
        kept = off <= _OUTLIER * max(noise, 1e-4)
    rays = np.column_stack([(corners_px - (k.cx, k.cy)) / (k.fx, k.fy), np.ones(4)])
    return rays * (terms(corners_px - middle) @ fit)[:, None], noise


@dataclass(frozen=True)
class KitTruth:
    """The truth that the markers of a recording show, inside and between them, linear in the image.

    ``corners_px`` returns the corners (4, 2), x right, y down, of the markers in a view by their ids.
    """

    kit: Kit
    corners_px: Callable[[int], Mapping[int, Float64]]

    def places(self, view_index: int, at_px: Float64) -> Float64:
        """Return the places (N, 2), as in ``Kit.places_m``, of (x, y) (N, 2) in a view; NaN if unknown."""
        found, kit, seen = np.full((len(at_px), 2), np.nan), self.kit, self.corners_px(view_index)
        if not seen:
            return found
        flat = np.concatenate([kit.places_m[i] for i in seen])
        between = Delaunay(np.concatenate(list(seen.values())))
        triangles = [at[between.simplices] for at in (flat, between.points)]
        sides, seen_sides = (np.roll(each, -1, axis=1) - each for each in triangles)
        turned = np.linalg.det(sides[:, :2]) * np.linalg.det(seen_sides[:, :2])
        near = (np.linalg.norm(sides, axis=2).max(axis=1) <= kit.reach_m) & (turned > 0)
        inside = between.find_simplex(at_px)
        shown = (inside >= 0) & near[inside]
        found[shown] = LinearNDInterpolator(between, flat)(at_px[shown])
        return found

    def compared(self, view: FlattenedView) -> tuple[Bool, Float64, Float64]:
        """Compare a view with the sheet that most of its pixels are of, after one rigid motion onto it.

        Return which of its pixels (H, W) markers show, their places (K, 2) after the motion, trimmed as that
        of ``flatcloth evaluate``, and their true ones (K, 2) on the sheet.
        """
        source, at_px = view.view_index[view.valid], view.source_rc[view.valid][:, ::-1].astype(np.float64)
        true_m = np.full((len(source), 2), np.nan)
        for n in np.unique(source):
            true_m[source == n] = self.places(int(n), at_px[source == n])
        is_known, is_second = np.isfinite(true_m[:, 0]), true_m[:, 0] > 2e-3 * self.kit.size_mm[0]
        is_known &= is_second == (2 * is_second.sum() > is_known.sum())
        known, true_m = view.valid.copy(), true_m[is_known]
        known[known] = is_known
        at_m = view.uv_from_rc(np.argwhere(known))
        return known, trimmed_fit(at_m, true_m) if known.any() else true_m, true_m

    def with_errors(self, view: FlattenedView, piece: NDArray[np.int16] | int = 0) -> FlattenedView:
        """Return a view with the error of each pixel; ``piece`` (H, W) numbers what is compared by itself."""
        error_m, piece = np.full(view.shape, np.nan, dtype=np.float32), np.broadcast_to(piece, view.shape)
        for n in np.unique(piece[view.valid]):
            known, flat_m, true_m = self.compared(replace(view, valid=view.valid & (piece == n)))
            error_m[known] = np.linalg.norm(flat_m - true_m, axis=1)
        return replace(view, error_m=error_m)


def measured_kit(kit: Kit, photo: Uint8) -> Kit:
    """Return a kit of the stickers in a photo (H, W, 3), RGB, of a garment that lies flat.

    The homography of the photo is the one that makes squares of them.
    """
    seen = found_markers(photo, msgspec.structs.replace(kit, is_measured=False))
    if len(seen) < FEWEST:
        raise KitError(f"{len(seen)} stickers are read. Take the photo from above, near and sharp.")
    corners_px, square = np.stack(list(seen.values())), kit.side_m / 2 * SQUARE

    def flat(motion: Float64) -> Float64:
        return np.asarray(cv2.perspectiveTransform(corners_px, np.append(motion, 1.0).reshape(3, 3)))

    first = cv2.getPerspectiveTransform(*np.array([corners_px[0], square], dtype=np.float32))
    first = (first / first[2, 2]).ravel()[:8]
    found = least_squares(lambda x: (lengths(flat(x)) - lengths(square)).ravel(), first, x_scale="jac")
    places = flat(found.x)
    places += kit.side_m - places.min(axis=(0, 1))  # a plain margin
    width_mm, height_mm = (1e3 * (places.max(axis=(0, 1)) + kit.side_m)).round(3).tolist()
    markers = [marker_at(i, 1, corners_m) for i, corners_m in zip(seen, places, strict=True)]
    return msgspec.structs.replace(kit, size_mm=(width_mm, height_mm), is_measured=True, markers=markers)
