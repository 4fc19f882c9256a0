"""Decisions by the garment about links, pieces and seams; which of them a run takes without an operator."""

from __future__ import annotations

import numpy as np

from flatcloth.core.types import Float64
from flatcloth.engine.garment.recognition import GarmentService, KnownGarment
from flatcloth.garments.deciding import decided_part, is_decided, placed_piece
from flatcloth.garments.links import is_wrong
from flatcloth.garments.placing import Placed
from flatcloth.garments.recognition import NONE, is_sure
from flatcloth.methods.answers import Canonical
from flatcloth.session.document import Document
from flatcloth.session.garment import (
    DecidedSeam,
    DecideLink,
    DecidePiece,
    DecideSeam,
    PlacedPiece,
)
from flatcloth.session.machine import Keeper, MemorySession, SessionState

_SEAM_PLACES = 40
"""Places that a decision about a seam keeps. Chosen: enough to find the seam again on another shape."""
_MOST_ROUNDS = 3
"""Most parts that an unattended run removes. Chosen: each takes some seconds."""


def place_sure_pieces(service: GarmentService, session: Keeper) -> KnownGarment | str:
    """Place the floating pieces with a reliable place on the garment, as decisions of the session.

    First, parts of this side that seams show to be joined falsely are removed. Then parts whose link is
    certainly wrong are removed, and parts joined by other doubted links become uncertain. Earlier decisions
    are kept. On a shape of a wrong recording nothing is reliable.
    """
    _decide_joints(service, session)
    known = service.known(session.state.document)
    if not isinstance(known, str) and known.is_wrong:
        return known
    for _ in range(_MOST_ROUNDS):
        if isinstance(known, str) or not known.links or not is_wrong(known.links[0]):
            break
        assert known.cloth is not None, "links are doubted on known cloth"
        link = known.links[0]
        session.record(DecideLink(decided_part(known.cloth, link.part, link.probability, taken_off=True)))
        known = service.known(session.state.document)
    if isinstance(known, str):
        return known
    before = session.state.document.garment.parts
    for link in known.links:
        cloth = known.cloth
        if cloth is not None and link.std_m and not is_decided(cloth, link.part, before):
            decision = decided_part(cloth, link.part, link.probability, taken_off=False, std_m=link.std_m)
            session.record(DecideLink(decision))
    return _with_sure_pieces(known, service, session)


def decided_seam(xyz_m: Float64, *, kept: bool) -> DecideSeam:
    """Return the decision about a seam with places (K, 3) in the object frame, by some of them."""
    some = np.linspace(0, len(xyz_m) - 1, min(len(xyz_m), _SEAM_PLACES)).astype(np.intp)
    return DecideSeam(
        DecidedSeam(kept=kept, points_m=tuple((float(x), float(y), float(z)) for x, y, z in xyz_m[some]))
    )


def _decide_joints(service: GarmentService, session: Keeper) -> None:
    """Take off the parts of this side that seams show to be joined falsely; others become uncertain.

    Both sides are joined again after each time, which may show further ones.
    """
    for _ in range(_MOST_ROUNDS):
        document = session.state.document
        sides = service.sides(document)
        joints = () if sides is None else sides.joints
        pieces = service.integration.algorithm.cloth_of_pieces(document)
        for joint in joints:
            shared = [np.count_nonzero(cloth.placed & joint.part) for cloth in pieces]
            cloth = pieces[int(np.argmax(shared))]
            part, std_m = cloth.placed & joint.part, 0.0 if joint.is_false else joint.std_m
            if not (joint.is_false or std_m) or not part.any():
                continue
            if not is_decided(cloth, part, document.garment.parts):
                right = 1.0 - joint.false
                decision = decided_part(cloth, part, right, taken_off=joint.is_false, std_m=std_m)
                session.record(DecideLink(decision))
        if not any(joint.is_false for joint in joints):
            break


def known_with_pieces(service: GarmentService, document: Document) -> KnownGarment | str:
    """Return the garment of a document's shape with the pieces with a reliable place placed."""
    known = service.known(document)
    if isinstance(known, str) or known.is_wrong:
        return known
    return _with_sure_pieces(known, service, MemorySession(SessionState(0, document=document)))


def _with_sure_pieces(known: KnownGarment, service: GarmentService, session: Keeper) -> KnownGarment | str:
    decided, unsure = known.pieces, frozenset() if known.sides is None else known.sides.unsure
    for piece in known.found.pieces if known.found.kind != NONE else ():
        if is_sure(piece) and piece.index not in {*decided.shape_from_piece, *decided.refused, *unsure}:
            session.record(DecidePiece(piece_decision(known.canonical, piece, accepted=True)))
    return service.known(session.state.document)


def piece_decision(canonical: Canonical, piece: Placed, *, accepted: bool) -> PlacedPiece:
    """Return the decision about a piece at its place on the garment."""
    return placed_piece(
        canonical.floating[piece.index],
        canonical.view,
        piece.shape_from_piece,
        piece.probability,
        piece.std_m,
        accepted=accepted,
    )
