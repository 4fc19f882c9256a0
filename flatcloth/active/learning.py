"""What is known of a goal: by the side of interest, and by both sides if that is not enough.

It takes about as long as a turn, and so it is done meanwhile: the next angle follows from the new shape and
from the garment as it was known before. Links of the other side are doubted only where the loop would end.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from flatcloth.active.choosing import OtherSide, of_other_side
from flatcloth.active.goal import Goal, Knowledge, knowledge_of
from flatcloth.engine.garment import GarmentService, KnownGarment, known_by_both, known_with_pieces
from flatcloth.session.document import Document


@dataclass(frozen=True, kw_only=True)
class Learnt:
    """What a loop has learnt: the garment, or why there is none, what follows from it, and the other side.

    ``other`` is what further views are expected to show of the other side. The garment is known by the first
    so many ``views``; the area may be of later ones, too. ``before`` is what fewer views told.
    """

    known: KnownGarment | str = "No view was taken yet."
    knowledge: Knowledge = field(default_factory=Knowledge)
    both: GarmentService | None = None
    other: OtherSide | None = None
    views: int = 0
    before: Knowledge = field(default_factory=Knowledge)


def learn(
    garments: GarmentService,
    document: Document,
    views: int,
    goal: Goal,
    *,
    doubts_links: bool,
    before: Knowledge,
) -> Learnt:
    """Recognise the garment of a shape by the first ``views``; ``doubts_links`` of the other side.

    ``before`` is what fewer views told: where they told another kind, the kind is less sure.
    """
    area_m2 = garments.integration.canonical(document).view.area_m2
    known = known_with_pieces(garments, document)
    knowledge = knowledge_of(views, area_m2, known).sobered(before)
    if goal.about == "shape" or knowledge.is_reached(goal) or len(document.used_views) < 2:
        return Learnt(known=known, knowledge=knowledge, views=views, before=before)
    both, by_both = known_by_both(garments.integration, document, doubts_links=doubts_links)
    if isinstance(by_both, KnownGarment):
        known, knowledge = by_both, knowledge_of(views, area_m2, by_both).sobered(before)
    other = of_other_side(both, document, known, knowledge, goal)
    return Learnt(known=known, knowledge=knowledge, both=both, other=other, views=views, before=before)


def got_by(before: Knowledge, now: Knowledge, goal: Goal) -> str:
    """Say in one line what a view brought."""
    parts = []
    for name in goal.points:
        was, point = before.point(name), now.point(name)
        if math.isfinite(point.std_m):
            since = f"from +-{1e3 * was.std_m:.0f} " if math.isfinite(was.std_m) else ""
            seen = "" if point.seen else ", not seen"
            parts.append(f"{name} {since}to +-{1e3 * point.std_m:.0f} mm{seen}")
    parts.append(f"{1e4 * (now.area_m2 - before.area_m2):.0f} cm2 new")
    return "; ".join(parts)
