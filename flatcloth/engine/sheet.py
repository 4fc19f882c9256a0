"""The sheet: the shape with the floating pieces next to it, as they are shown and picked.

A method places floating pieces far from the shape on the plane, so that they do not overlap it. For display
they are moved, by whole pixels, into columns to the right of the shape. Pieces near the shape without a
reliable place stay where they are.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from flatcloth.core.errors import FlatclothError
from flatcloth.core.geometry import fit_rigid2
from flatcloth.core.types import Bool, FlattenedView, Float64, Floats, LaidPiece, Rigid2
from flatcloth.engine.integration import Integration
from flatcloth.flattening.resampling import place
from flatcloth.garments.deciding import DecidedPieces, decided_pieces
from flatcloth.methods.answers import Canonical
from flatcloth.methods.base import Views
from flatcloth.session.document import Document, PlacedPart

GAP_M = 0.04
"""Between the shape and the pieces, and between two pieces: wider than a finger's width of cloth. Set by
hand."""
_NEAR_M = 1.0
"""A piece whose middle is nearer to the shape than this is already near its place. Set by hand."""

FLOATS = "Nothing seen connects it to the shape."
PLACED = "Placed by the garment or by seams with the other side: no view connects it."
BY_HAND = "Cut off the shape by hand."
PLACED_BY_HAND = "Placed by hand: no view connects it."
LOOSE = "A narrow neck or weak overlaps connect it to the shape: its place is not reliable."


@dataclass(frozen=True, kw_only=True)
class SheetPiece:
    """A floating piece on the sheet.

    ``label`` B, C, ... by falling area; ``number`` its place among the method's pieces, from 1; ``view`` is
    its raster on the sheet; ``shift_m`` (u, v) leads there from the method's plane; ``reason`` says why it
    floats; ``views`` are the views that show it. ``placed`` is the motion from the method's plane of a piece
    that lies on the shape by the garment.
    """

    label: str
    number: int
    view: FlattenedView
    shift_m: tuple[float, float]
    reason: str
    views: tuple[int, ...]
    placed: Rigid2 | None = None

    @property
    def sheet_from_plane(self) -> Rigid2:
        """The motion from the method's plane to the sheet."""
        return self.placed or Rigid2(0.0, *self.shift_m)


def floating_file(number: int) -> str:
    """Return the file of a floating piece, counted from 1."""
    return f"floating-{number}.npz"


OTHER_FILE = "flattened-other.npz"
"""The file of the other side."""


def other_floating_file(number: int) -> str:
    """Return the file of a floating piece of the other side, counted from 1."""
    return f"floating-other-{number}.npz"


@dataclass(frozen=True, kw_only=True)
class Sheet:
    """The shape and its floating pieces on one plane.

    ``view`` holds all of them, ``piece`` (H, W) int16 numbers them: 0 the shape, 1 piece B, ..., -1
    no cloth; ``canonical`` is the view that it was made of.
    """

    canonical: Canonical
    view: FlattenedView
    piece: NDArray[np.int16]
    pieces: tuple[SheetPiece, ...]

    @property
    def placed(self) -> dict[int, Rigid2]:
        """The motions of the pieces placed by the garment, by their index in ``canonical.floating``."""
        return {piece.number - 1: piece.placed for piece in self.pieces if piece.placed is not None}

    @property
    def floating_m2(self) -> float:
        """Area of all floating pieces that have no place on the shape."""
        return sum(piece.view.area_m2 for piece in self.pieces if piece.placed is None)

    @property
    def shape_m2(self) -> float:
        """Area of the shape with the pieces that are placed on it."""
        placed = sum(piece.view.area_m2 for piece in self.pieces if piece.placed is not None)
        return self.canonical.view.area_m2 + placed

    def is_clear_of(self, edge_m: float) -> bool:
        """Return whether no piece next to the shape reaches over what is drawn up to u ``edge_m``."""
        return all(p.shift_m == (0.0, 0.0) or p.view.origin_uv_m[0] > edge_m for p in self.pieces)

    def piece_at(self, uv_m: Floats) -> int:
        """Return which piece a place of the sheet belongs to: that whose rectangle holds it, else 0."""
        at = np.asarray(uv_m, dtype=np.float64)
        row, col = np.rint(self.view.rc_from_uv(at)).astype(int).tolist()
        if 0 <= row < self.piece.shape[0] and 0 <= col < self.piece.shape[1] and self.piece[row, col] > 0:
            return int(self.piece[row, col])
        for n, piece in enumerate(self.pieces, start=1):
            low, high = _box(piece.view)
            if piece.shift_m != (0.0, 0.0) and bool(((at >= low) & (at <= high)).all()):
                return n
        return 0

    def piece_on_plane(self, uv_m: Floats) -> int:
        """Return which piece a place of the method's plane belongs to: the nearest far piece, else 0."""
        at = np.asarray(uv_m, dtype=np.float64)
        candidates = [(0, *_box(self.canonical.view))]
        for n, piece in enumerate(self.pieces, 1):
            if piece.sheet_from_plane != Rigid2():
                sides = np.transpose(_box(piece.view))
                corners = piece.sheet_from_plane.inverse().apply(np.array([*itertools.product(*sides)]))
                candidates.append((n, corners.min(axis=0), corners.max(axis=0)))
        outside = [np.maximum(0.0, np.maximum(low - at, at - high)) for _, low, high in candidates]
        off, nearest = min((float(np.linalg.norm(each)), n) for n, each in enumerate(outside))
        return candidates[nearest][0] if off < _NEAR_M else 0

    def shift(self, piece: int) -> Rigid2:
        """Return the motion from the method's plane to the sheet of a piece, 0 the shape."""
        return Rigid2() if piece == 0 else self.pieces[piece - 1].sheet_from_plane

    def places(self, uv_m: Floats) -> tuple[int, Float64]:
        """Return the piece that places (N, 2) of the method's plane belong to, and their places here."""
        known = np.isfinite(uv_m).all(axis=1)
        piece = self.piece_on_plane(np.median(uv_m[known], axis=0)) if known.any() else 0
        return piece, self.shift(piece).apply(uv_m)

    def shown(self, placement: Rigid2, center_m: Floats) -> Rigid2:
        """Return a placement (plane from a component's own plane) as it is on the sheet.

        ``center_m`` (2,) is the component's middle on its own plane; it determines the piece. A
        placement far from all cloth, as of a reopened piece, is shown next to the shape.
        """
        center = placement.apply(center_m)
        piece = self.piece_on_plane(center)
        shown = self.shift(piece) @ placement
        low, high = _box(self.canonical.view)
        at = shown.apply(center_m)
        if piece == 0 and bool((at < low - _NEAR_M).any() or (at > high + _NEAR_M).any()):
            aside = np.array([high[0] + 4 * GAP_M, (low[1] + high[1]) / 2])
            return Rigid2(0.0, *(aside - at).tolist()) @ placement
        return shown

    def meant(self, shown: Rigid2, center_m: Floats) -> Rigid2:
        """Return the placement on the method's plane that corresponds to one on the sheet."""
        return self.shift(self.piece_at(shown.apply(center_m))).inverse() @ shown


def order_of(floating: Sequence[FlattenedView]) -> list[int]:
    """Return the indices of floating pieces in the order of their letters: the largest first."""
    return sorted(range(len(floating)), key=lambda n: -floating[n].area_m2)


def lay_out(
    canonical: Canonical,
    placed: Mapping[int, Rigid2] = MappingProxyType({}),
    by_hand: Collection[int] = (),
    edge_m: float = -math.inf,
) -> Sheet:
    """Lay out the floating pieces of a canonical view next to it.

    ``placed`` are motions onto the shape of those that have a place on it, by their index in ``floating``;
    ``by_hand`` those that the operator placed. What is drawn of the shape ends at u ``edge_m``.
    """
    main = canonical.view
    low, high = _box(main)
    height = max(float(high[1] - low[1]), 0.2)
    left, top, wide = max(float(high[0]), edge_m) + GAP_M, float(low[1]), 0.0
    pieces = []
    for n, index in enumerate(order_of(canonical.floating)):
        view = canonical.floating[index]
        shown = np.unique(view.view_index[view.valid])
        views = tuple(int(v) for v in shown if v >= 0)
        motion = placed.get(index)
        own_low, own_high = _box(view)
        middle = (own_low + own_high) / 2
        off = index in canonical.taken_off
        near = not off and bool((middle > low - _NEAR_M).all() and (middle < high + _NEAR_M).all())
        reason = BY_HAND if off else LOOSE if near else FLOATS
        shift = (0.0, 0.0)
        if motion is not None:
            view, reason = _moved(view, motion, main), PLACED_BY_HAND if index in by_hand else PLACED
        elif not near:
            size = own_high - own_low
            if top > low[1] and top + size[1] > low[1] + height:
                left, top, wide = left + wide + GAP_M, float(low[1]), 0.0
            step = np.rint((np.array([left, top]) - own_low) / main.pixel_size_m) * main.pixel_size_m
            # Both rasters begin at a whole number of pixels, so that their pixels coincide.
            between = np.asarray(main.origin_uv_m) - (np.asarray(view.origin_uv_m) + step)
            step = step + between - np.rint(between / main.pixel_size_m) * main.pixel_size_m
            shift = (float(step[0]), float(step[1]))
            top, wide = top + float(size[1]) + 2 * GAP_M, max(wide, float(size[0]))
            view = replace(view, origin_uv_m=(view.origin_uv_m[0] + shift[0], view.origin_uv_m[1] + shift[1]))
        pieces.append(
            SheetPiece(
                label=label_of(n + 1),
                number=index + 1,
                view=view,
                shift_m=shift,
                reason=reason,
                views=views,
                placed=motion,
            )
        )
    joined, piece = _joined(main, [p.view for p in pieces])
    return Sheet(canonical=canonical, view=joined, piece=piece, pieces=tuple(pieces))


def sheet_of(
    canonical: Canonical,
    document: Document,
    laid: Sequence[LaidPiece] = (),
    before: Sheet | None = None,
    edge_m: float = -math.inf,
) -> Sheet:
    """Lay out a canonical view, with the pieces that its document places by the garment, or that seams lay.

    ``before`` is returned if nothing on it has changed, and its pieces are clear of what ends at ``edge_m``.
    """
    decided = decided_pieces(document.garment, canonical.view, canonical.floating)
    decided = decided.with_laid(laid)
    placed = decided.shape_from_piece
    if before is not None and before.canonical is canonical and before.placed == placed:
        if before.is_clear_of(edge_m):
            return before
    return lay_out(canonical, placed, decided.by_hand, edge_m)


def with_placed_pieces(canonical: Canonical, pieces: DecidedPieces) -> Canonical:
    """Return a shape with the cloth of the floating pieces that have a place on it; they stay listed.

    Their standard deviations are those of their places; unknown if those of the shape are.
    """
    if not pieces.shape_from_piece:
        return canonical
    main, laid = canonical.view, []
    for index, motion in sorted(pieces.shape_from_piece.items()):
        moved = _moved(canonical.floating[index], motion, main)
        if main.placement_std_m is not None:
            is_known = moved.valid & np.isfinite(main.placement_std_m).any()
            std = np.where(is_known, pieces.std_m[index], np.nan).astype(np.float32)
            moved = replace(moved, placement_std_m=std)
        laid.append(moved)
    return replace(canonical, view=_joined(main, laid)[0])


def overlay_on(integration: Integration, document: Document, sheet: Sheet) -> FlattenedView:
    """Return the pending view of a document on the sheet."""
    pending = document.pending
    assert pending is not None
    center = np.array(center_uv_m(integration.views.part(pending.view_index, pending.component)))
    shown = sheet.shown(pending.current_from_new, center)
    if shown == pending.current_from_new:
        return integration.overlay(document)
    return integration.overlay(replace(document, pending=replace(pending, proposed=shown, nudge=Rigid2())))


def beyond(overlay: FlattenedView, shape: FlattenedView) -> Bool:
    """Return (H, W) where a view has cloth and the shape has none."""
    rc = np.rint(shape.rc_from_uv(overlay.uv_from_rc(np.argwhere(overlay.valid)))).astype(int)
    inside = ((rc >= 0) & (rc < shape.shape)).all(axis=1)
    known = np.zeros(len(rc), dtype=bool)
    known[inside] = shape.valid[rc[inside, 0], rc[inside, 1]]
    fresh: Bool = overlay.valid.copy()
    fresh[overlay.valid] = ~known
    return fresh


def center_uv_m(view: FlattenedView) -> tuple[float, float]:
    """Return the centre of a view's grid on its plane."""
    rows, cols = view.shape
    u_m, v_m = view.uv_from_rc(np.array([(rows - 1) / 2, (cols - 1) / 2])).tolist()
    return float(u_m), float(v_m)


def outline_loops(view: FlattenedView) -> list[Float64]:
    """Return the borders (N, 2) of a view on its plane, simplified to a pixel, to be drawn."""
    contours, _ = cv2.findContours(view.valid.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    kept = [cv2.approxPolyDP(each, 1.0, True)[:, 0, ::-1] for each in contours if cv2.contourArea(each) > 20]
    return [view.uv_from_rc(each.astype(np.float64)) for each in kept]


def place_of_piece(views: Views, piece: SheetPiece, accepted: Sequence[int]) -> PlacedPart:
    """Return the component of the accepted view that shows most of a piece, where it lies on the sheet.

    Raises
    ------
    FlatclothError
        If only the start view shows the piece.
    """
    shown = [v for v in accepted if v in piece.views]
    if not shown:
        raise FlatclothError(
            f"Piece {piece.label} was seen by the start view only, which stays where it is."
            " Step on: another view may connect it."
        )
    own = piece.view
    view_index = max(shown, key=lambda view: np.count_nonzero(own.valid & (own.view_index == view)))
    where = np.argwhere(own.valid & (own.view_index == view_index))
    there = own.uv_from_rc(where)
    source = own.source_rc[where[:, 0], where[:, 1]]
    best: tuple[int, int, Rigid2] = (0, 0, Rigid2())
    for n, component in enumerate(views.flattening(view_index).components):
        pixel = np.argwhere(component.view.valid)
        tree = cKDTree(component.view.source_rc[pixel[:, 0], pixel[:, 1]])
        off, nearest = tree.query(source, distance_upper_bound=1.0)
        same = np.isfinite(off)
        if same.sum() > max(best[0], 2):
            uv = component.view.uv_from_rc(pixel[nearest[same]])
            best = int(same.sum()), n, fit_rigid2(uv, there[same])
    if not best[0]:
        raise FlatclothError(
            f"No component of view {view_index} shows piece {piece.label}; reopen the view itself."
        )
    return PlacedPart(view_index, best[1], best[2])


def is_on_shape(views: Views, canonical: Canonical, view_index: int, component: int) -> bool:
    """Return whether cloth of a component of a view belongs to the shape, and not to a floating piece."""
    part = views.part(view_index, component)
    own = cKDTree(part.source_rc[part.valid])

    def shown_by(view: FlattenedView) -> int:
        source = view.source_rc[view.valid & (view.view_index == view_index)]
        off, _ = own.query(source, distance_upper_bound=1.0)
        return int(np.isfinite(off).sum())

    return shown_by(canonical.view) > max(map(shown_by, canonical.floating), default=0)


def label_of(piece: int) -> str:
    """Return the letter of a piece: A the shape, B, C, ..., Z, AA."""
    letters = ""
    number = piece + 1
    while number:
        number, digit = divmod(number - 1, 26)
        letters = chr(65 + digit) + letters
    return letters


def _box(view: FlattenedView) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    rows, cols = view.shape
    low = np.asarray(view.origin_uv_m, dtype=np.float64)
    return low, low + view.pixel_size_m * np.array([cols - 1, rows - 1])


def _moved(view: FlattenedView, motion: Rigid2, main: FlattenedView) -> FlattenedView:
    """Return a piece moved on the plane, its pixels on those of the shape."""
    size = main.pixel_size_m
    # place() rasters at whole pixels of the plane; the shape's raster may begin between them.
    off = np.asarray(main.origin_uv_m) - np.rint(np.asarray(main.origin_uv_m) / size) * size
    back = Rigid2(0.0, float(-off[0]), float(-off[1]))
    moved = place([(view, back @ motion)])
    origin = np.asarray(moved.origin_uv_m) + off
    return replace(moved, origin_uv_m=(float(origin[0]), float(origin[1])))


def _joined(main: FlattenedView, pieces: list[FlattenedView]) -> tuple[FlattenedView, NDArray[np.int16]]:
    """Return one raster of the shape and its pieces; where a piece meets the shape, the shape is kept."""
    numbers = np.where(main.valid, 0, -1).astype(np.int16)
    if not pieces:
        return main, numbers
    size = main.pixel_size_m
    boxes = np.array([_box(view) for view in (main, *pieces)])
    low, high = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
    cols, rows = (np.rint((high - low) / size).astype(int) + 1).tolist()
    arrays: dict[str, Any] = {}
    for name in _ARRAYS:
        if (own := getattr(main, name)) is not None:
            nothing = np.nan if own.dtype.kind == "f" else -1 if own.dtype.kind == "i" else 0
            arrays[name] = np.full((rows, cols, *own.shape[2:]), nothing, dtype=own.dtype)
    piece = np.full((rows, cols), -1, dtype=np.int16)
    for n, view in enumerate((main, *pieces)):
        col, row = np.rint((np.asarray(view.origin_uv_m) - low) / size).astype(int).tolist()
        where = np.s_[row : row + view.shape[0], col : col + view.shape[1]]
        fresh = view.valid & (piece[where] < 0)
        piece[where][fresh] = n
        for name, array in arrays.items():
            if (own := getattr(view, name)) is not None:
                array[where][fresh] = own[fresh]
    return replace(main, origin_uv_m=(float(low[0]), float(low[1])), **arrays), piece


_ARRAYS = (
    "rgb", "xyz_m", "normal", "z_angle_deg", "valid", "view_index", "source_rc", "quality", "placement_std_m",
)  # fmt: skip
