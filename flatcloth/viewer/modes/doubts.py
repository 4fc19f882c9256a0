"""What is in doubt about a shape, as one list: joints of its parts, floating pieces, seams of both sides.

Each is a hypothesis: what it is about, what holds it, where that lies in the pictures, what can be decided.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from msgspec import structs
from starlette.requests import Request
from starlette.routing import BaseRoute

from flatcloth.core.cache import Cache
from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import Float64, Floats, Rigid2
from flatcloth.engine.garment import KnownGarment, decided_seam, piece_decision
from flatcloth.engine.joints import Joint, joints_of, with_places
from flatcloth.engine.sheet import Sheet, SheetPiece, place_of_piece
from flatcloth.flattening.cloth import Cloth
from flatcloth.garments.deciding import decided_part, pixels_of_part, placed_by_hand
from flatcloth.garments.placing import Placed
from flatcloth.garments.recognition import NONE, is_offered
from flatcloth.grasping.visibility import Visibility
from flatcloth.methods.answers import Seam
from flatcloth.session.document import Document
from flatcloth.session.journal import SheetSide
from flatcloth.session.machine import Command, TakePart
from flatcloth.shape.joints import NEGLIGIBLE
from flatcloth.viewer import http
from flatcloth.viewer.modes.controller import PageController
from flatcloth.viewer.modes.garment import GarmentController, OtherSideController
from flatcloth.viewer.protocol.messages import Decide
from flatcloth.viewer.protocol.picture import OtherSheet, Picture, outline_of, place_in_view
from flatcloth.viewer.protocol.sent import UV, Choice, Doubt, DoubtsInfo, HeldByView

MOST_MARKS = 60
"""Marks of a hypothesis in one image, or on the shape. Chosen: a line of them is seen."""
CHANGED = "The shape has changed; look again."
NO_LINKS = "The method {} does not know how sure its links are."
_ASIDE_M = 0.08
"""A part of which no other place is known is shown so far off. Chosen: a hand's width."""
_NEAR_M = 0.08
"""From a seam to a point by which it is named. Chosen."""
_TITLES = {"garment": "By the garment", "seams": "By seams"}
Decider = Callable[[str, Rigid2], Sequence[Command]]
"""Makes commands of how a hypothesis is decided and where its cloth is moved."""


@dataclass(frozen=True, eq=False)
class _Shape:
    """The shape that the list is about; ``known`` and ``made`` are None while they belong to another one."""

    revision: int
    picture: Picture
    document: Document
    known: KnownGarment | None
    made: OtherSheet | None


class DoubtService:
    """Serves the list of a page, and makes decisions of what is chosen there."""

    def __init__(self, page: PageController, garment: GarmentController, other: OtherSideController) -> None:
        self._page, self._garment, self._other = page, garment, other
        self._shapes: dict[int, _Shape] = {}  # by revision: all of the shown document
        self._key: object = None
        self._revision = 0
        self._joints: Cache[tuple[Cloth, list[Joint]]] = Cache(4)
        self._lists: Cache[list[tuple[Doubt, Decider]]] = Cache(2)

    def routes(self) -> list[BaseRoute]:
        """Return the route of this service."""
        return [http.get("/doubts/{revision:int}.json", self._info)]

    def follow(self, picture: Picture | None) -> int | None:
        """Return the revision of the list about the shape shown, if any; called on the page's own thread."""
        if picture is None:
            self._shapes, self._key = {}, None
            return None
        known, made, document = self._garment.current, self._other.made, picture.document
        key = picture.revision, document.garment, id(known), id(made), self._other.is_working
        if self._key != key:
            same = {n: shape for n, shape in self._shapes.items() if shape.document is document}
            self._key, self._revision = key, self._revision + 1
            self._shapes = {**same, self._revision: _Shape(self._revision, picture, document, known, made)}
        return self._revision

    def decision(self, asked: Decide) -> Sequence[Command]:
        """Return the commands of the session that carry out a decision of the page.

        Raises
        ------
        FlatclothError
            If the shape has changed since it was shown.
        """
        found = self._list(self._shape(asked.revision))
        if asked.index >= len(found):
            raise FlatclothError(CHANGED)
        return found[asked.index][1](asked.how, Rigid2(*asked.place))

    def _shape(self, revision: int) -> _Shape:
        shape = self._shapes.get(revision)
        if shape is None:
            raise FlatclothError(CHANGED)
        return shape

    def _list(self, shape: _Shape) -> list[tuple[Doubt, Decider]]:
        return self._lists.get((shape,), lambda: [*self._of_joints(shape), *self._of_rest(shape)])

    def _info(self, request: Request) -> DoubtsInfo:
        revision = request.path_params["revision"]
        try:
            shape = self._shape(revision)
            doubts = [doubt for doubt, _ in self._list(shape)]
        except FlatclothError as error:
            return DoubtsInfo(revision=revision, trouble=str(error))
        made, this = shape.made, shape.picture.sheet.canonical.view
        method, has_links = self._page.integration.method, self._cloth(shape) is not None
        return DoubtsInfo(
            revision=revision,
            trouble="" if has_links else NO_LINKS.format(method),
            doubts=doubts,
            this_outline_uv_m=[] if made is None else outline_of(this),
            other_outline_uv_m=[] if made is None else outline_of(made.sides.other.view),
        )

    def _cloth(self, shape: _Shape) -> Cloth | None:
        return self._page.integration.cloth(shape.document)

    def _of_rest(self, shape: _Shape) -> Iterator[tuple[Doubt, Decider]]:
        sheet, known, made = shape.picture.sheet, shape.known, shape.made
        for piece in sheet.pieces:
            yield self._piece(shape, piece, _place_by_garment(known, piece))
        if made is not None:
            for piece in made.sheet.pieces:
                yield self._floating(piece, "other"), lambda *_: ()  # nothing can be decided about it
            points = {} if known is None else {n: p.uv_m for n, p in known.found.points.items()}
            names = seam_names([sheet.places(s.this_uv_m)[1] for s in made.sides.seams], points)
            for seam, name in zip(made.sides.seams, names, strict=True):
                yield self._seam(made, sheet, seam, name)

    # --- joints -----------------------------------------------------------------------------------

    def _of_joints(self, shape: _Shape) -> Iterator[tuple[Doubt, Decider]]:
        cloth, document, known = self._cloth(shape), shape.document, shape.known
        if cloth is None:
            return

        def find() -> tuple[Cloth, list[Joint]]:
            return cloth, with_places(joints_of(cloth, document.garment.parts), cloth, known)

        key = document.shape_key, document.garment.parts, id(known)
        for joint in self._joints.get(key, find)[1]:
            yield self._joint(document, cloth, joint)

    def _joint(self, document: Document, cloth: Cloth, joint: Joint) -> tuple[Doubt, Decider]:
        view = self._page.integration.canonical(document).view
        own = replace(view, valid=pixels_of_part(view, cloth, joint.part))
        outline, some = outline_of(own), _thinned(len(joint.seam_uv_m))
        pivot, arm = _handles(joint.ends_uv_m.reshape(-1, 2).mean(axis=0), outline)
        aside = arm * _ASIDE_M / max(float(np.linalg.norm(arm)), 1e-9)
        places = sorted(joint.places, key=lambda place: -place.probability)
        left = 1.0 - joint.probability - sum(place.probability for place in places)
        choices = [
            Choice("keep", "As it is", "Keep it as it is", joint.probability),
            *(
                Choice("place", _TITLES[place.by], "Place it there", place.probability, place.shape_from_part)
                for place in places
            ),
            Choice("cut", "Elsewhere", "Cut it off", max(left, 0.0), Rigid2(0.0, *aside.tolist())),
        ]
        sure, views = joint.probability, joint.views
        doubt = Doubt(
            kind="joint",
            title=f"{1e4 * own.area_m2:.0f} cm2",
            said="kept" if joint.is_kept else "firm" if sure >= 1.0 else f"{100 * sure:.1f} % sure",
            note=f"Held by {_count(sum(held.pairs for held in views), 'pair')} of"
            f" {_count(len(views), 'view')}, evidence {joint.evidence:.1f}."
            + (" You kept it." if joint.is_kept else ""),
            area_cm2=1e4 * own.area_m2,
            probability=sure,
            weak=joint.share * (1.0 - sure) > NEGLIGIBLE,
            outline_uv_m=outline,
            pivot_uv_m=pivot.tolist(),
            arm_uv_m=arm.tolist(),
            ends_uv_m=np.round(joint.ends_uv_m[some], 4).tolist(),
            length_m=np.round(joint.length_m[some], 4).tolist(),
            this_uv_m=np.round(joint.seam_uv_m[some], 4).tolist(),
            seam_xyz_m=np.round(joint.seam_xyz_m[some], 4).tolist(),
            part_xyz_m=_points(own.xyz_m[own.valid]),
            views=[self._held(v.view_index, v.pairs, v.residual_m[0], v.xyz_m) for v in views],
            choices=choices,
        )

        def decide(how: str, there: Rigid2) -> Sequence[Command]:
            part = decided_part(cloth, joint.part, sure, taken_off=how != "keep")
            place = placed_by_hand(part, there) if how == "place" else None
            return (replace(part, place=place),)

        return doubt, decide

    # --- floating pieces --------------------------------------------------------------------------

    def _piece(self, shape: _Shape, piece: SheetPiece, place: Placed | None) -> tuple[Doubt, Decider]:
        known, doubt = shape.known, self._floating(piece, "this")
        choices = [] if piece.placed else [Choice("hand", "Where it floats", "Place by hand")]
        if known is not None and place is not None:
            sure, there = place.probability, place.shape_from_piece @ piece.sheet_from_plane.inverse()
            by_it = Choice("place", _TITLES["garment"], "Place it there", sure, there, 1e3 * place.std_m)
            if place.index in known.pieces.refused:
                choices = [Choice("hand", "Elsewhere", "Place by hand", 1.0 - sure), by_it]
                doubt = structs.replace(doubt, note=f"{doubt.note} You refused the garment's place.")
            else:
                much = sure * piece.view.area_m2 > NEGLIGIBLE * known.canonical.view.area_m2
                doubt = structs.replace(doubt, weak=much and not piece.placed)
                choices += [by_it, Choice("cut", "Elsewhere", "Refuse that place", 1.0 - sure)]

        def decide(how: str, by: Rigid2) -> Sequence[Command]:
            if known is not None and place is not None and how != "hand":
                return (piece_decision(known.canonical, place, accepted=how != "cut"),)
            views = [accepted.view_index for accepted in shape.document.accepted]
            found = place_of_piece(self._page.integration.views, piece, views)
            there = by @ found.current_from_new
            return (TakePart(found.view_index, found.component, there),)

        return structs.replace(doubt, choices=choices), decide

    def _floating(self, piece: SheetPiece, side: SheetSide) -> Doubt:
        view, outline = piece.view, outline_of(piece.view)
        ends = view.uv_from_rc(np.array([[0, 0], [view.shape[0] - 1, view.shape[1] - 1]]))
        pivot, arm = _handles(ends.mean(axis=0), outline)
        return Doubt(
            kind="piece",
            side=side,
            title=piece.label if side == "this" else f"{piece.label}, other side",
            said=f"{1e4 * view.area_m2:.0f} cm2, {'placed' if piece.placed else 'floats'}",
            note=piece.reason,
            area_cm2=1e4 * view.area_m2,
            outline_uv_m=outline,
            pivot_uv_m=pivot.tolist(),
            arm_uv_m=arm.tolist(),
            part_xyz_m=_points(view.xyz_m[view.valid]),
            views=[self._held(v, 0, None, np.zeros((0, 3))) for v in piece.views],
            choices=[],
        )

    # --- seams ------------------------------------------------------------------------------------

    def _seam(self, made: OtherSheet, this: Sheet, seam: Seam, name: str) -> tuple[Doubt, Decider]:
        some, off_mm = _thinned(len(seam.xyz_m)), 1e3 * np.quantile(seam.residual_m, (0.5, 0.9))
        join = Choice("keep", "It joins both sides", "Keep", seam.probability)
        cut = Choice("cut", "It joins nothing", "Cut", 1.0 - seam.probability)
        decided = {"cut": " You cut it.", "keep": " You kept it.", None: ""}[seam.decided]
        why = f" It joins nothing: {seam.why}." if seam.why and not decided else ""
        views = []
        for view in np.unique(seam.views[seam.views >= 0]):
            at = (seam.views == view).any(axis=1)
            views.append(self._held(int(view), int(at.sum()), np.median(seam.residual_m[at]), seam.xyz_m[at]))
        doubt = Doubt(
            kind="seam",
            title=name,
            said=f"{100 * seam.length_m:.0f} cm, {'does not join' if seam.why else 'joins'}",
            note=f"{len(seam.xyz_m)} places where the rims of both sides meet; one motion leaves them"
            f" {off_mm[0]:.1f} mm apart, nine tenths below {off_mm[1]:.1f} mm.{decided}{why}",
            length_mm=1e3 * seam.length_m,
            is_apart=bool(seam.why),
            this_uv_m=_places(this.places(seam.this_uv_m)[1][some]),
            other_uv_m=_places(made.sheet.places(seam.other_uv_m)[1][some]),
            seam_xyz_m=np.round(seam.xyz_m[some], 4).tolist(),
            views=sorted(views, key=lambda held: -held.places),
            choices=[cut, join] if seam.why else [join, cut],
        )

        def decide(how: str, _by: Rigid2) -> Sequence[Command]:
            return (decided_seam(seam.xyz_m, kept=how == "keep"),)

        return doubt, decide

    # --- what shows them --------------------------------------------------------------------------

    def _held(self, view_index: int, places: int, off_m: float | None, xyz_m: Floats) -> HeldByView:
        """Return what one view sees of the places that hold cloth, with the pixels of those in its image."""
        normal = np.full(3, np.nan)  # what was seen is seen, whichever way the surface is turned
        project = partial(place_in_view, self._page.integration, view_index)
        seen = [project(place, normal) for place in xyz_m[_thinned(len(xyz_m))]]
        inside = [place for place in seen if place.visibility is not Visibility.OUTSIDE]
        return HeldByView(
            view_index=view_index,
            angle_deg=self._page.integration.recording.angles_deg[view_index],
            places=places,
            residual_mm=None if off_m is None else round(1e3 * float(off_m), 2),
            rc=[(round(float(place.row), 1), round(float(place.col), 1)) for place in inside],
        )


def _place_by_garment(known: KnownGarment | None, piece: SheetPiece) -> Placed | None:
    """Return the place that the garment has for a piece, if it is proposed or decided."""
    if known is None or known.found.kind == NONE:
        return None
    decided = {*known.pieces.shape_from_piece, *known.pieces.refused}
    found = (each for each in known.found.pieces if is_offered(each) or each.index in decided)
    return next((each for each in found if each.index == piece.number - 1), None)


def seam_names(seams_uv_m: Sequence[Float64], points: dict[str, Float64]) -> list[str]:
    """Return names of seams: by the outermost named points near each, else by the side of the shape.

    Those of one name are told apart in their order from above.
    """
    middles = [np.nanmean(uv_m, axis=0) for uv_m in seams_uv_m]
    own = []
    for uv_m, (u_m, _) in zip(seams_uv_m, middles, strict=True):
        off = {n: np.nanmin(np.linalg.norm(uv_m - at, axis=1)) for n, at in points.items()}
        near = [name for name in points if off[name] < _NEAR_M]
        if len(near) > 1:
            first = points[near[0]]
            near = [near[0], max(near, key=lambda n: float(np.linalg.norm(points[n] - first)))]
        side = "left side" if u_m <= np.mean(middles, axis=0)[0] else "right side"
        own.append(" to ".join(name.replace("_", " ") for name in near) or side)
    names = []
    for n, name in enumerate(own):
        same = sorted((k for k, other in enumerate(own) if other == name), key=lambda k: middles[k][1])
        places = (
            ["upper part", "lower part"] if len(same) == 2 else [f"part {k + 1}" for k in range(len(same))]
        )
        names.append(f"{name}, {places[same.index(n)]}" if len(same) > 1 else name)
    return names


def _handles(pivot: Float64, outline: list[list[UV]]) -> tuple[Float64, Float64]:
    """Return the point that cloth turns about, and the vector from there to its farthest border."""
    ways = np.array([*(uv for loop in outline for uv in loop), pivot.tolist()]) - pivot
    return pivot, ways[np.argmax(np.linalg.norm(ways, axis=1))]


def _places(uv_m: Float64) -> list[UV]:
    return np.round(np.nan_to_num(uv_m), 4).tolist()  # type: ignore[no-any-return]


def _points(xyz_m: Floats) -> list[tuple[float, float, float]]:
    return np.round(xyz_m[_thinned(len(xyz_m), 5 * MOST_MARKS)], 4).tolist()  # type: ignore[no-any-return]


def _count(n: int, word: str) -> str:
    return f"{n} {word}{'' if n == 1 else 's'}"


def _thinned(count: int, most: int = MOST_MARKS) -> slice:
    return slice(None, None, max(1, -(-count // most)))
