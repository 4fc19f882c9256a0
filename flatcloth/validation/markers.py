"""Markers of a kit in a color image: some are read by OpenCV, all are fitted to the image.

The print is known, so the map from a marker's plane to the image is the one that makes them most alike. That
finds corners to about 0.1 px, also on bent cloth. The neighbours of a fitted marker are predicted and fitted
in turn, which needs no reading.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from flatcloth.core.types import Bool, Float32, Float64, Int32, Uint8
from flatcloth.validation.kit import SQUARE, Kit, dictionary_codes

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
_NEIGHBOURS, _TRIES = 2.0, 3
"""Neighbours are within so many sides of a marker; so many predictions of one are tried. Chosen."""


@dataclass(frozen=True, kw_only=True)
class Markers:
    """Markers of an image: ``ids`` (K,), ascending, each once; ``corners_px`` (K, 4, 2), x right, y down.

    Pixel centers have whole coordinates; corners are in the order of ``Kit.corners_m``.
    """

    ids: Int32
    corners_px: Float64


def found_markers(color: Uint8, kit: Kit) -> Markers:
    """Find the markers of a kit in a color image (H, W, 3), RGB; it takes about 5 ms a marker."""
    import cv2

    gray = cv2.cvtColor(color, cv2.COLOR_RGB2GRAY)
    slopes = [cv2.Sobel(gray, cv2.CV_32F, k, 1 - k, scale=1 / 8) for k in (1, 0)]
    image = np.dstack([gray.astype(np.float32), *slopes])
    prints, around = dictionary_codes(kit.dictionary), _neighbours(kit)
    found: dict[int, Float64] = {}
    tries: Counter[int] = Counter()
    waiting = deque(_read(gray, kit))
    while waiting:
        i, guess_px = waiting.popleft()
        if i in found or tries[i] == _TRIES:
            continue
        tries[i] += 1
        corners_px = _fitted(image, prints[i], guess_px)
        if corners_px is not None:
            found[i] = corners_px
            motion = cv2.getPerspectiveTransform(
                kit.corners_m[i].astype(np.float32), corners_px.astype(np.float32)
            )
            waiting += [(n, cv2.perspectiveTransform(kit.corners_m[n][None], motion)[0]) for n in around[i]]
    ids = sorted(found)
    corners = np.array([found[i] for i in ids]).reshape(-1, 4, 2)
    return Markers(ids=np.array(ids, dtype=np.int32), corners_px=corners)


def _read(gray: NDArray[Any], kit: Kit) -> list[tuple[int, Float64]]:
    """Return the ids of the kit that OpenCV reads once, and their corners (4, 2), roughly."""
    import cv2

    up = int(np.clip(_LARGE_PX // max(gray.shape), 1, _MOST_UP))
    large = cv2.resize(gray, None, fx=up, fy=up, interpolation=cv2.INTER_CUBIC)
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, kit.dictionary))
    corners, found, _ = cv2.aruco.ArucoDetector(dictionary).detectMarkers(large)
    ids = [int(i) for i in np.ravel(found)] if len(corners) else []
    places = (np.reshape(corners, (-1, 4, 2)).astype(np.float64) + 0.5) / up - 0.5
    once = {i for i, times in Counter(ids).items() if times == 1} & kit.sheet.keys()
    return [(i, place) for i, place in zip(ids, places, strict=True) if i in once]


def _neighbours(kit: Kit) -> dict[int, list[int]]:
    """Return the ids beside each marker on its sheet; none if their places are not measured."""
    ids = list(kit.corners_m)
    corners = np.stack(list(kit.corners_m.values()))
    reach_m = _NEIGHBOURS * kit.is_measured * np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1)
    # Sheets lie apart in the third coordinate.
    places = np.column_stack([corners.mean(axis=1), [kit.sheet[i] * 1e3 for i in ids]])
    near = cKDTree(places).query_ball_point(places, reach_m)
    return {i: [ids[n] for n in row if ids[n] != i] for i, row in zip(ids, near, strict=True)}


def _terms(places: Float64) -> Float64:
    """Return the terms (N, 6) of a map of second order at places (N, 2) of a marker, its corners at +-1."""
    x, y = places.T
    return np.stack([np.ones_like(x), x, y, x * y, x * x, y * y], axis=-1)


@lru_cache(maxsize=16)
def _sampled(modules: int, samples: int) -> Float64:
    """Return samples (N, 2) of a marker and half its quiet zone, in modules from its first corner."""
    along = (np.arange(samples * (modules + 1)) + 0.5) / samples - 0.5
    return np.stack(np.meshgrid(along, along), axis=-1).reshape(-1, 2)


def _fitted(image: Float32, black: Bool, guess_px: Float64) -> Float64 | None:
    """Return the corners (4, 2) of a marker that is where it was guessed, otherwise None.

    Gauss-Newton steps for the map of second order, the contrast, the brightness and its slope that minimise
    the squared differences between print and ``image`` (H, W, 3), which is brightness and its slopes.
    """
    import cv2

    module_px = float(np.linalg.norm(guess_px[2] - guess_px[0])) / math.sqrt(2) / len(black)
    at = _sampled(len(black), int(np.clip(round(module_px), *_SAMPLES)))
    places = at * (2 / len(black)) - 1
    enlarged = np.kron(np.pad(~black, 1, constant_values=True), np.ones((8, 8))).astype(np.float32)
    blurred = np.asarray(
        cv2.GaussianBlur(enlarged, (0, 0), 8 * max(_BLUR_PX / module_px, _LEAST_BLUR)), dtype=np.float32
    )
    ink = _looked_up(blurred, (at + 1) * 8 - 0.5)
    terms, corners = _terms(places), _terms(SQUARE)
    shade = np.column_stack([-ink, -np.ones(len(at)), -places])
    motion = np.vstack([np.linalg.solve(corners[:, :4], guess_px), np.zeros((2, 2))])
    bends = np.tile([0.0, 0.0, 0.0, 1.0, 1.0, 1.0], 2)
    for stiffness in _STIFFNESS:
        at_px = terms @ motion
        if not ((at_px >= 0) & (at_px < image.shape[1::-1])).all():
            return None
        seen = _looked_up(image, at_px)
        columns = np.hstack([terms * seen[:, 1:2], terms * seen[:, 2:], shade])
        weight = stiffness * seen[:, 0].var() * len(seen) * bends
        right = -columns.T @ seen[:, 0]
        right[:12] -= weight * motion.T.ravel()
        normal = columns.T @ columns + np.diag(np.append(weight, np.zeros(4)))
        motion += np.linalg.lstsq(normal, right)[0][:12].reshape(2, 6).T
    # The code without its border is compared in each half: other codes fit by chance, or a side slips.
    middles = (np.arange(1.0, len(black) - 1) + 0.5) * (2 / len(black)) - 1
    inner = _terms(np.stack(np.meshgrid(middles, middles), axis=-1).reshape(-1, 2))
    pairs = np.stack([_looked_up(image, inner @ motion)[:, 0], ~black[1:-1, 1:-1].ravel()])
    halves = [pairs[:, inner[:, k] * sign > 0] for k in (1, 2) for sign in (1, -1)]
    is_code = min(_correlation(*half) for half in halves) > _LEAST_CODE
    is_print = _correlation(ink, _looked_up(image, terms @ motion)[:, 0]) > _LEAST_LIKE
    return corners @ motion if is_code and is_print else None


def _correlation(first: Float64, second: Float64) -> float:
    first, second = first - first.mean(), second - second.mean()
    return float(first @ second / math.sqrt(max(float((first @ first) * (second @ second)), 1e-9)))


def _looked_up(image: Float32, at_px: Float64) -> Float64:
    """Return the values (N,) or (N, K) of an image at places (N, 2)."""
    import cv2

    x, y = np.ascontiguousarray(at_px.T[:, None], dtype=np.float32)
    return np.asarray(cv2.remap(image, x, y, cv2.INTER_CUBIC)[0], dtype=np.float64)
