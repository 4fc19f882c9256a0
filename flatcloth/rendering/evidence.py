"""Pictures that show a mistake of a recording: as recorded, and as mended."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import cv2
import numpy as np

from flatcloth.checking.findings import Finding
from flatcloth.core.config import SurfaceConfig
from flatcloth.core.errors import SurfaceError
from flatcloth.core.geometry import back_project, object_from_camera, project, window_of
from flatcloth.core.types import Bool, RgbdFrame, RotationAxis, Uint8
from flatcloth.flattening.surface import foreground_mask
from flatcloth.recordings.base import Recording
from flatcloth.recordings.mending import Mends, mended
from flatcloth.registration.axis_estimation import UP

_ONE, _OTHER = np.array([23, 102, 194]), np.array([217, 130, 43])
"""Colors of the two views: blue and orange, which colour-blind people tell apart."""
_PAPER, _INK = 255, (26, 31, 38)
"""Colors of the background and the captions, as in other figures. Chosen."""
_HEIGHT_PX = 420
"""Height of a picture. Chosen for a panel of the page."""
_MARGIN_PX, _GAP_PX, _CAPTION_PX = 24, 12, 26
"""Around the item, between the pictures, and above them. Chosen."""


def evidence(recording: Recording, finding: Finding) -> Uint8 | None:
    """Return a picture (H, W, 3) of a finding; None if no views show it.

    Two views are laid on each other after the recorded turn, or the outlines in depth and of the mask are
    drawn on the color; left as recorded, right with the first mend.

    Raises
    ------
    RecordingError
        If the views cannot be read.
    """
    if finding.views is None:
        return None
    return mistaken(recording, finding.views, {f"with {m.words()}"[:60]: m for m in finding.mends[:1]})


def mistaken(recording: Recording, views: tuple[int, int], mistakes: Mapping[str, Mends]) -> Uint8:
    """Return a picture (H, W, 3) of two views laid on each other as recorded, and with mends, each named.

    Of one view it is the color with outlines; see :func:`evidence`.

    Raises
    ------
    RecordingError
        If the views cannot be read.
    """
    draw, pictures = _turned if len(set(views)) > 1 else _outlined, []
    for text, mends in {"as recorded": Mends(), **mistakes}.items():
        made = mended(recording, mends)  # it may have fewer views
        shown = views if len(made) == len(recording) else tuple(min(view, len(made) - 1) for view in views)
        pictures.append(_captioned(draw(made, shown), text))
    gap = np.full((pictures[0].shape[0], _GAP_PX, 3), _PAPER, np.uint8)
    return np.concatenate([pictures[0], *(part for p in pictures[1:] for part in (gap, p))], axis=1)


def _turned(recording: Recording, views: tuple[int, ...]) -> Uint8:
    one, other = (recording[view] for view in views)
    items = [_item(frame, recording.rotation_axis) for frame in (one, other)]
    k = one.intrinsics
    points = [
        back_project(f.depth_m, f.intrinsics)[item] for f, item in zip((one, other), items, strict=True)
    ]
    axis = recording.rotation_axis
    if axis is None:
        axis = RotationAxis(point_m=np.median(points[0], axis=0), direction=UP)
    onto = object_from_camera(axis, one.angle_deg).inverse() @ object_from_camera(axis, other.angle_deg)
    canvas = np.full((k.height, k.width, 3), _PAPER, np.uint8)
    shade = np.zeros((2, k.height, k.width), np.float32)
    for n, xyz in enumerate((points[0].astype(np.float64), onto.apply(points[1]))):
        rc = np.rint(project(xyz[xyz[:, 2] > 0], k)).astype(int)
        row, col = rc[((rc >= 0) & (rc < shade.shape[1:])).all(axis=1)].T
        shade[n, row, col] = 1.0
    for there, color in zip(shade, (_ONE, _OTHER), strict=True):
        closed = cv2.morphologyEx(there, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))[..., None]
        canvas = (canvas * (1 - 0.55 * closed) + color * 0.55 * closed).astype(np.uint8)
    return canvas[window_of(np.asarray((shade > 0).any(axis=0)), _MARGIN_PX) or np.s_[:, :]]


def _outlined(recording: Recording, views: tuple[int, ...]) -> Uint8:
    frame = recording[views[0]]
    item = _item(frame, recording.rotation_axis)
    picture = frame.color.copy()
    for of, color in ((item, _OTHER), (frame.mask, _ONE)):
        if of is not None:
            found, _ = cv2.findContours(of.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
            cv2.drawContours(picture, found, -1, color.tolist(), 2)
    return picture[window_of(item, _MARGIN_PX) or np.s_[:, :]]


def _item(frame: RgbdFrame, axis: RotationAxis | None) -> Bool:
    try:
        return foreground_mask(replace(frame, mask=None), axis, SurfaceConfig())
    except SurfaceError:
        return np.asarray(frame.depth_m > 0)


def _captioned(picture: Uint8, text: str) -> Uint8:
    """Return a picture of ``_HEIGHT_PX`` below its caption."""
    font, size = cv2.FONT_HERSHEY_SIMPLEX, 0.5
    (wide, _), _ = cv2.getTextSize(text, font, size, 1)
    own = max(1, round(_HEIGHT_PX / picture.shape[0] * picture.shape[1]))
    made = np.full((_CAPTION_PX + _HEIGHT_PX, max(own, wide + 8), 3), _PAPER, np.uint8)
    left = (made.shape[1] - own) // 2
    fitted = cv2.resize(picture, (own, _HEIGHT_PX), interpolation=cv2.INTER_AREA)
    made[_CAPTION_PX:, left : left + own] = fitted
    cv2.putText(made, text, (4, 18), font, size, _INK, 1, cv2.LINE_AA)
    return made
