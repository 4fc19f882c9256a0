"""The side of interest for any list of decisions. Results are cached by prefix: undo is exact and cheap."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from flatcloth.core.cache import Cache
from flatcloth.core.strokes import Cut, Decision
from flatcloth.core.types import Bool, Float64, Int64
from flatcloth.segmentation.brushes import beyond, under
from flatcloth.segmentation.certainty import agreement, calibrated
from flatcloth.segmentation.item import LEAST_AREA_M2
from flatcloth.segmentation.observed import Observed, start_sheet
from flatcloth.segmentation.partition import Int8
from flatcloth.segmentation.result import (
    OF_INTEREST,
    OTHER,
    UNDECIDED,
    Segmentation,
    Suggestion,
    best_view,
    views_showing,
)
from flatcloth.segmentation.spreading import Spreading

_UNTESTED, _SETTLED = -1, -2  # by definition: no part has these numbers
_EXCEPTION = -1.0  # by definition: below every cost


@dataclass(frozen=True, kw_only=True)
class _State:
    """The sides after some decisions.

    ``side`` (M,) is +1 or -1 for each cluster; ``holder`` (M,) the decision that determines it directly, -1
    if none does; ``excluded`` (M,) is True where a cut removed the cluster. ``inner`` (M,) is True on inner
    faces, which are never of interest; ``strokes`` are the clusters under each stroke, in order. ``group``
    (M,) int64 numbers the regions that strokes turned over separately: strokes contradict the evidence
    between two groups. ``part`` (M,) int64 numbers the connected components of the evidence. ``guess`` is
    the part where the next stroke shows whether the initial guess was right, ``_UNTESTED`` if that was never
    in doubt, ``_SETTLED`` after it was decided. ``known`` (M,) is True in the largest part and in
    parts that a stroke touched; the side of other clusters is unknown. ``alone`` is the cost that the first
    stroke would have had without turning over the whole guess; 0 if it did not turn it over, or if a later
    stroke agreed with it; ``_EXCEPTION`` if later strokes showed that it holds only under its mark.
    ``against`` is the total cost of the later strokes.
    """

    side: Float64
    inner: Bool
    holder: Int64
    strokes: tuple[tuple[int, Int64], ...]
    guess: int
    group: Int64
    part: Int64
    known: Bool
    excluded: Bool
    conflicts: tuple[str, ...]
    alone: float = 0.0
    against: float = 0.0

    @property
    def shown(self) -> Float64:
        """Sides (M,), +1 of interest, -1 not."""
        return _shown(self.side, self.inner)


class _Turn(NamedTuple):
    """The clusters that a stroke turns over, and its cost.

    ``sides``: the clusters that change sides; ``inner``: those that become an inner face; ``cost``: that of
    the contradicted evidence, if only the region around the stroke is turned over; ``whole``: True if the
    guess of the side was wrong; ``clear``: False if another stroke is needed to decide that.
    """

    sides: Int64
    inner: Int64
    cost: float
    whole: bool = False
    clear: bool = True


def _shown(side: Float64, inner: Bool) -> Float64:
    """Return the sides (M,) with inner faces (M,) set to -1: they are not of interest."""
    return np.where(inner, -1.0, side)


def _wanted(decision: Decision) -> float:
    """Return the side that a stroke assigns: 1 of interest, -1 not."""
    return -1.0 if isinstance(decision, Cut) or decision.side == "other" else 1.0


def _mark(side: Float64, inner: Bool, touched: Int64, wanted: float) -> None:
    """Assign the side of a stroke to the clusters under it, and to no others."""
    off = touched[_shown(side, inner)[touched] != wanted]
    inner[off] = wanted < 0
    side[off] = 1.0 if wanted > 0 else side[off]


class SideSolver:
    """Finds sides; may be called from several threads.

    Parameters
    ----------
    observed : Observed
        The prepared views.
    """

    def __init__(self, observed: Observed) -> None:
        self.observed = observed
        self._spreading = Spreading(observed.graph, observed.config)
        self._states: Cache[_State] = Cache(256, 256 << 20)
        self._results: Cache[Segmentation] = Cache(64, 64 << 20)
        self.start_sheet = start_sheet(observed)
        """Middle of the largest well-seen sheet of the start view: the side of interest without strokes."""

    def solve(self, decisions: Sequence[Decision]) -> Segmentation:
        """Return the sides after these decisions, in order.

        Raises
        ------
        SegmentationError
            If a decision touches no cloth, or its view does not exist; the message says which.

        Notes
        -----
        Only what follows the longest known prefix is computed: a further stroke takes about 0.2 s.
        """
        key = tuple(decisions)
        return self._results.get(key, lambda: self._result(key))

    def places(self, decisions: Sequence[Decision]) -> Iterator[Suggestion]:
        """Yield where strokes would determine most: first the largest area, then what it leaves uncertain."""
        now, state = self.solve(decisions), self._state(tuple(decisions))
        clusters = self.observed.clusters
        unsure = np.where(state.excluded, 0.0, clusters.area_m2 * (1.0 - now.certainty))
        if unsure.sum() < LEAST_AREA_M2:
            return
        inner = self._off_borders(state) & (state.holder < 0)
        weight = np.where(inner, unsure * clusters.facing**4, 0.0)
        if not weight.any():
            return
        random = np.random.default_rng(0)
        count = min(self.observed.config.samples, int((weight > 0).sum()))
        chosen = random.choice(len(weight), count, replace=False, p=weight / weight.sum())
        samples = self.observed.samples.astype(np.float32)
        together = np.square(samples[:, chosen].T @ samples / len(samples))
        together[np.arange(count), chosen] = 1.0
        for order in range(count):
            gain = together @ unsure
            gain_m2, row = float(gain.max()), int(gain.argmax())
            if order and gain_m2 < LEAST_AREA_M2:
                return
            unsure = unsure * (1.0 - together[row])
            best = int(chosen[row])
            seen = best_view(self.observed, best)
            if seen is None:
                return
            view, rc = seen
            place, normal = clusters.place_m[best].tolist(), clusters.normal[best].tolist()
            yield Suggestion(
                view_index=view,
                rc=rc,
                point_m=(place[0], place[1], place[2]),
                normal=(normal[0], normal[1], normal[2]),
                gain_m2=gain_m2,
                text=f"A stroke here, in view {view}, would settle about {1e4 * gain_m2:.0f} cm2.",
            )

    # ---------------------------------------------------------------- states

    def _state(self, decisions: tuple[Decision, ...]) -> _State:
        if not decisions:
            return self._states.get((), self._begin)
        return self._states.get(decisions, lambda: self._after(self._state(decisions[:-1]), decisions))

    def _begin(self) -> _State:
        found, start = self.observed.partition, self.start_sheet
        largest = int(np.bincount(found.part[start]).argmax())
        side = found.side * np.sign((found.side[start] * (found.part[start] == largest)).sum() or 1.0)
        inner = self.observed.inner.copy()
        if inner[start].any():  # the start sheet counts as of interest: no face is inner
            inner[:] = False
        return _State(
            side=side,
            inner=inner,
            holder=np.full(len(side), -1, dtype=np.int64),
            strokes=(),
            guess=_UNTESTED,
            group=np.zeros(len(side), dtype=np.int64),
            part=found.part,
            known=found.part == largest,
            excluded=np.zeros(len(side), dtype=np.bool_),
            conflicts=(),
        )

    def _after(self, state: _State, decisions: tuple[Decision, ...]) -> _State:
        number, decision = len(decisions) - 1, decisions[-1]
        name = f"decision {number + 1}"
        if isinstance(decision, Cut):
            off = beyond(self.observed, decision, (state.shown > 0) & state.known & ~state.excluded, name)
            excluded = state.excluded.copy()
            excluded[off] = True
            return replace(state, excluded=excluded)
        touched, wanted = under(self.observed, decision, name), _wanted(decision)
        conflicts = (*state.conflicts, *self._conflicts(state, touched, wanted, number))
        if state.guess >= 0 and (state.part[touched[~state.inner[touched]]] == state.guess).any():
            state = self._settled(state, touched, wanted, number)
        else:
            previous = self.solve(decisions[:-1]).side
            # A doubtful face was shown as not of interest: a stroke on it contradicts that.
            previous = np.where(self.observed.doubtful < 0, previous, OTHER)
            state = self._stroked(state, touched, wanted, number, previous)
            if 0 < state.alone < state.against:
                state = self._without_first(state, decisions)
        return replace(state, conflicts=conflicts)

    def _without_first(self, state: _State, decisions: tuple[Decision, ...]) -> _State:
        """Restore the initial guess; the first stroke then holds only under its mark.

        It had turned over the whole guess. All later strokes contradict that, and their total cost is
        higher than the cost of the first stroke alone.
        """
        begin, (first, *rest) = self._begin(), state.strokes
        fresh = replace(begin, excluded=state.excluded, guess=_SETTLED)
        for number, touched in rest:
            fresh = self._stroked(fresh, touched, _wanted(decisions[number]), number, None)
        number, touched = first
        touched = touched[fresh.holder[touched] < 0]
        side, inner, holder = fresh.side.copy(), fresh.inner.copy(), fresh.holder.copy()
        _mark(side, inner, touched, _wanted(decisions[number]))
        holder[touched] = number
        strokes = ((number, touched), *fresh.strokes) if touched.size else fresh.strokes
        return replace(fresh, side=side, inner=inner, holder=holder, strokes=strokes, alone=_EXCEPTION)

    def _settled(self, state: _State, touched: Int64, wanted: float, number: int) -> _State:
        """Decide by a stroke whether the guess was right, then apply the earlier strokes again."""
        begin = self._begin()
        own = touched[(state.part[touched] == state.guess) & ~state.inner[touched]]
        right = np.sign(wanted * begin.side[own].sum() or 1.0)
        # If it was wrong, the start sheet is no evidence any more: only strokes are.
        group = np.where(begin.known & (right < 0), 1, 0)
        fresh = replace(begin, side=right * begin.side, group=group, excluded=state.excluded, guess=_SETTLED)
        fresh = self._stroked(fresh, touched, wanted, number, None)
        for earlier, before in state.strokes:
            rest = np.setdiff1d(before, touched)
            if rest.size:
                shown = 1.0 if state.shown[rest].sum() > 0 else -1.0
                fresh = self._stroked(fresh, rest, shown, earlier, None)
        return fresh

    def _stroked(
        self, state: _State, touched: Int64, wanted: float, number: int, previous: Int8 | None
    ) -> _State:
        side, inner, part, known, turn = self._spread(state, touched, wanted, previous)
        alone, against = state.alone, 0.0
        if turn is not None and turn.whole:
            alone = turn.cost
        elif alone > 0 and turn is not None and turn.cost > self.observed.config.most_cost:
            against = state.against + turn.cost
        else:
            alone = min(alone, 0.0)
        turned = (_shown(side, inner) != state.shown) & state.known
        group = state.group
        if not turned[state.known].all():  # if all turned over, the relative sides are unchanged
            group = np.unique(np.append(2 * group + turned, 0), return_inverse=True)[1].ravel()[:-1]
        doubted = part != state.part
        holder = state.holder.copy()
        holder[touched] = number
        return replace(
            state,
            side=side,
            inner=inner,
            part=part,
            known=known,
            holder=holder,
            strokes=(*state.strokes, (number, touched)),
            guess=int(part.max()) if doubted.any() else state.guess,
            group=np.where(doubted, group.max() + 1, group),  # the guess no longer counts there
            alone=alone,
            against=against,
        )

    def _spread(
        self, state: _State, touched: Int64, wanted: float, previous: Int8 | None
    ) -> tuple[Float64, Bool, Int64, Bool, _Turn | None]:
        side, inner, known = state.side.copy(), state.inner.copy(), state.known.copy()
        part, shown = state.part, state.shown
        for n in np.unique(part[touched]):
            own = touched[part[touched] == n]
            if not known[own[0]]:  # a separate part: the stroke determines its side
                members = part == n
                outer = own[~inner[own]]
                side[members] *= np.sign(wanted * side[outer if outer.size else own].sum() or 1.0)
                shown[members] = _shown(side, inner)[members]
                known[members] = True
        wrong = touched[shown[touched] != wanted]
        turn: _Turn | None = None
        if not wrong.size:
            return side, inner, part, known, turn
        kept = state.holder >= 0
        kept[touched] = False
        keep = np.concatenate([np.flatnonzero(kept), touched[shown[touched] == wanted]])
        if (
            state.guess == _UNTESTED
            and not state.strokes
            and not np.intersect1d(wrong, self.start_sheet).size
        ):
            keep = np.union1d(
                np.setdiff1d(self.start_sheet, touched), keep
            )  # the start sheet keeps its side, unless the stroke touches it
        number, faces = 1 + len(state.strokes), wrong[inner[wrong]]
        if faces.size:  # these clusters were wrongly taken for an inner face
            inner[self._spreading.inner_face(np.where(inner, -1.0, 1.0), keep, faces, number)[0]] = False
        rest = wrong[~state.inner[wrong]]
        if rest.size:
            # A stroke on undecided cloth contradicts nothing, so it is no sign of a wrong guess.
            decided = previous is not None and bool(np.mean(previous[rest] != UNDECIDED) > 0.5)
            guessed = not state.strokes and decided
            turn = self._turned(state, side, keep, rest, number, guessed)
            inner[turn.inner] = True
            side[turn.sides] = -side[turn.sides]
            if not turn.clear:  # the guess may have been wrong: what is left of it waits for another stroke
                left = known.copy()
                left[turn.sides] = left[touched] = False
                part, known = np.where(left, part.max() + 1, part), known & ~left
        _mark(side, inner, touched, wanted)
        return side, inner, part, known, turn

    def _turned(
        self, state: _State, side: Float64, keep: Int64, wrong: Int64, number: int, guessed: bool
    ) -> _Turn:
        """Return what a stroke turns over.

        ``guessed`` is True if the stroke contradicts only the initial guess. The guess was wrong if the
        evidence shows no border between the stroke and the start sheet; if a disturbed sample separates the
        two, that is not clear.
        """
        g, spreading, none = self.observed.graph, self._spreading, np.empty(0, dtype=np.int64)
        most, divided = self.observed.config.most_cost, none
        mark = max(len(wrong), self.observed.config.least_region)
        # Cloth at the back of an inner face is no evidence of that face's side.
        weight = np.where((g.weight < 0) & (state.inner[g.first] | state.inner[g.second]), 0.0, g.weight)
        region, cost = spreading.turned_over(side, keep, wrong, number, weight)
        if most <= cost < np.inf:
            divided, price = spreading.repartitioned(side, keep, wrong, number, weight)
            cheap = price <= most and len(divided) < 0.5 * state.known.sum() if guessed else price < cost
            if cheap and len(divided) >= mark:
                region, cost, divided = divided, price, none
        # Operators correct the largest error first, so a stroke is meant for more cloth than its mark.
        farther = len(region) <= 2 * mark < len(divided) and not guessed
        # A change that agrees with the evidence (cost below 0) needs no inner face as its explanation.
        if side[wrong[0]] > 0 and cost > 0:
            face, price = spreading.inner_face(side, keep, wrong, number)
            if price < cost and (len(face) > 2 * mark or not farther):
                return _Turn(none, face, price)
        if guessed and cost > most:  # no border separates it from the start sheet
            if self._always_together(wrong, state.side):
                return _Turn(np.flatnonzero(state.known), none, cost, whole=True)
            return _Turn(region, none, cost, clear=False)
        if state.alone == _EXCEPTION and cost > most:  # the evidence is unreliable: only the mark counts
            return _Turn(none, none, cost)
        return _Turn(divided if farther else region, none, cost)

    def _always_together(self, clusters: Int64, side: Float64) -> bool:
        """Whether in all disturbed samples the clusters relate to the start sheet as in ``side``."""
        samples = self.observed.samples
        one, other = (np.sign((samples[:, at] * side[at]).sum(axis=1)) for at in (clusters, self.start_sheet))
        return bool((one * other > 0).all())

    def _conflicts(self, state: _State, touched: Int64, wanted: float, number: int) -> list[str]:
        against = touched[(state.holder[touched] >= 0) & (state.shown[touched] != wanted)]
        found = []
        for earlier in np.unique(state.holder[against]):
            area = float(self.observed.clusters.area_m2[against[state.holder[against] == earlier]].sum())
            found.append(
                f"Decisions {earlier + 1} and {number + 1} contradict each other about {1e4 * area:.1f} cm2 "
                "of cloth; the later one holds there."
            )
        return found

    # ---------------------------------------------------------------- results

    def _result(self, decisions: tuple[Decision, ...]) -> Segmentation:
        state, observed = self._state(decisions), self.observed
        certainty = calibrated(observed, self._agreed(state))
        certainty[~state.known] = 0.5
        held = state.holder >= 0
        faces, shown = observed.doubtful, state.shown > 0
        accepted = np.append(faces[held & shown], -1)  # only a stroke shows that such a face is no inner face
        certainty[shown & ~np.isin(faces, accepted)] = 0.5
        certainty[held | state.excluded] = 1.0
        side = np.where(state.shown > 0, OF_INTEREST, OTHER).astype(np.int8)
        # Operators correct the largest error first: with more strokes, less is left to doubt.
        config, fewer = observed.config, 1.0 / math.sqrt(max(len(state.strokes), 1))
        least, turned = (0.5 + fewer * (limit - 0.5) for limit in (config.least_certainty, config.sure))
        doubtful = certainty < np.where(state.group > 0, turned, least)
        side[doubtful | ~state.known] = UNDECIDED
        side[state.excluded] = OTHER
        found = Segmentation(
            observed=observed,
            decisions=decisions,
            side=side,
            certainty=certainty,
            conflicts=state.conflicts,
        )
        return replace(found, changed=self._changed(found)) if decisions else found

    def _agreed(self, state: _State) -> Float64:
        """Return how often the samples relate the clusters (M,) to strokes and start as this state does."""
        anchors = [*(touched for _, touched in state.strokes), self.start_sheet]
        guess = bool(state.known[self.start_sheet].any())
        return agreement(self.observed, state.side, anchors, state.group, guess)

    def _changed(self, now: Segmentation) -> str:
        before, area = self.solve(now.decisions[:-1]), self.observed.clusters.area_m2
        moved = now.side != before.side
        turned = moved & (now.side != UNDECIDED) & (before.side != UNDECIDED)
        sure = turned & (before.certainty >= self.observed.config.sure)
        sure_m2 = float(area[sure].sum())
        views = views_showing(self.observed, moved)
        text = f"The last decision changed {1e4 * float(area[moved].sum()):.0f} cm2 in {len(views)} views"
        text += f", of which {1e4 * sure_m2:.0f} cm2 were sure before." if sure_m2 >= LEAST_AREA_M2 else "."
        state, was = self._state(now.decisions), self._state(now.decisions[:-1])
        if state.alone == _EXCEPTION and was.alone != _EXCEPTION:
            text += (
                f" Decision {was.strokes[0][0] + 1} had turned over the whole guess; "
                "it now holds only under its mark, because all later strokes contradict it."
            )
        if state.guess >= 0:
            text += " It is not clear whether the rest lies on the other side too: draw another stroke on it."
        return text

    # ---------------------------------------------------------------- where to go on

    def _off_borders(self, state: _State) -> Bool:
        """Clusters (M,) none of whose neighbours lies on the other side."""
        g = self.observed.graph
        apart = (g.weight > 0) & (state.side[g.first] != state.side[g.second])
        inner = np.ones(g.count, dtype=np.bool_)
        inner[g.first[apart]] = False
        inner[g.second[apart]] = False
        return inner
