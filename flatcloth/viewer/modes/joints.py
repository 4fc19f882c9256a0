"""What holds the parts of the shape, for the page: looked up when asked, and cut or kept by decisions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from starlette.requests import Request
from starlette.routing import BaseRoute

from flatcloth.core.cache import Cache
from flatcloth.core.errors import FlatclothError
from flatcloth.core.types import Float64, Rigid2
from flatcloth.engine.joints import HeldBy, Joint, joints_of, with_places
from flatcloth.flattening.cloth import Cloth
from flatcloth.garments.deciding import decided_part, pixels_of_part, placed_by_hand
from flatcloth.grasping.visibility import Visibility
from flatcloth.session.document import Document
from flatcloth.session.garment import DecideLink
from flatcloth.shape.joints import NEGLIGIBLE
from flatcloth.viewer import http
from flatcloth.viewer.modes.controller import PageController
from flatcloth.viewer.protocol.messages import DecideJoint
from flatcloth.viewer.protocol.picture import outline_of, place_in_view
from flatcloth.viewer.protocol.sent import HeldByView, JointInfo, JointsInfo

MOST_MARKS = 60
"""Marks of a joint in one image, or on the shape. Chosen: a line of them is seen."""
CHANGED = "The shape has changed; look again."
NO_LINKS = "The method {} does not know how sure its links are."


class JointService:
    """Serves where the parts of the shape of a page are joined."""

    def __init__(self, page: PageController) -> None:
        self._page = page
        self._found: Cache[tuple[Cloth, list[Joint]]] = Cache(4)

    def routes(self) -> list[BaseRoute]:
        """Return the route of this service."""
        return [http.get("/joints/{revision:int}.json", self._info)]

    def decision(self, asked: DecideJoint) -> DecideLink:
        """Return the decision that a part is cut off, or kept.

        Raises
        ------
        FlatclothError
            If the shape has changed since it was shown.
        """
        document = self._document(asked.revision)
        cloth, joints = self._joints(document)
        if asked.index >= len(joints):
            raise FlatclothError(CHANGED)
        joint = joints[asked.index]
        part = decided_part(cloth, joint.part, joint.probability, taken_off=asked.cut)
        part = replace(part, by_hand=True)
        return DecideLink(part, placed_by_hand(part, Rigid2(*asked.place)) if asked.place else None)

    def _document(self, revision: int) -> Document:
        picture = self._page.picture
        if picture is None or picture.document is None or picture.revision != revision:
            raise FlatclothError(CHANGED)
        return picture.document

    def _joints(self, document: Document) -> tuple[Cloth, list[Joint]]:
        def find() -> tuple[Cloth, list[Joint]]:
            cloth = self._page.integration.cloth(document)
            if cloth is None:
                raise FlatclothError(NO_LINKS.format(self._page.integration.method))
            is_of_this = last is not None and last.is_of(self._page.integration.canonical(document))
            known = last if is_of_this else None
            found = joints_of(cloth, () if known is None else known.links, document.garment.parts)
            return cloth, with_places(found, cloth, known)

        last = self._page.garments.last
        return self._found.get((document.shape_key, document.garment.parts, id(last)), find)

    def _info(self, request: Request) -> JointsInfo:
        revision = request.path_params["revision"]
        try:
            document = self._document(revision)
            cloth, joints = self._joints(document)
        except FlatclothError as error:
            return JointsInfo(revision=revision, trouble=str(error))
        view = self._page.integration.canonical(document).view
        shown = []
        for joint in joints:
            own = replace(view, valid=pixels_of_part(view, cloth, joint.part))
            some, points = _thinned(len(joint.seam_uv_m)), own.xyz_m[own.valid]
            shown.append(
                JointInfo(
                    area_cm2=1e4 * own.area_m2,
                    evidence=joint.evidence,
                    weak=joint.share * (1.0 - joint.probability) > NEGLIGIBLE,
                    probability=joint.probability,
                    kept=joint.is_kept,
                    outline_uv_m=outline_of(own),
                    ends_uv_m=np.round(joint.ends_uv_m[some], 4).tolist(),
                    length_m=np.round(joint.length_m[some], 4).tolist(),
                    seam_xyz_m=np.round(joint.seam_xyz_m[some], 4).tolist(),
                    part_xyz_m=np.round(points[_thinned(len(points), 5 * MOST_MARKS)], 4).tolist(),
                    views=[self._view(held) for held in joint.views],
                    places=joint.places,
                )
            )
        return JointsInfo(revision=revision, joints=shown)

    def _view(self, held: HeldBy) -> HeldByView:
        recording = self._page.integration.recording
        median_m, most_m = held.residual_m
        return HeldByView(
            view_index=held.view_index,
            angle_deg=recording.angles_deg[held.view_index],
            pairs=held.pairs,
            residual_mm=(round(1e3 * median_m, 2), round(1e3 * most_m, 2)),
            rc=self._pixels(held.view_index, held.xyz_m[_thinned(len(held.xyz_m))]),
        )

    def _pixels(self, view_index: int, xyz_m: Float64) -> list[tuple[float, float]]:
        """Return the pixels of a view at which places are; those outside the image are left out."""
        normal = np.full(3, np.nan)  # a pair that was seen is seen, whichever way the surface is turned
        found = [place_in_view(self._page.integration, view_index, place, normal) for place in xyz_m]
        inside = [place for place in found if place.visibility is not Visibility.OUTSIDE]
        return [(round(float(place.row), 1), round(float(place.col), 1)) for place in inside]


def _thinned(count: int, most: int = MOST_MARKS) -> slice:
    return slice(None, None, max(1, -(-count // most)))
