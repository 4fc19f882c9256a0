"""The side of interest for any list of decisions. Results are cached by prefix: undo is exact and cheap."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flatcloth.core.cache import Cache
from flatcloth.core.strokes import Cut, Decision
from flatcloth.core.types import Bool, Float64, Int64
from flatcloth.segmentation.brushes import beyond, under
from flatcloth.segmentation.certainty import calibrated
from flatcloth.segmentation.color import alike_in_color
from flatcloth.segmentation.item import LEAST_AREA_M2
from flatcloth.segmentation.observed import Evidence, start_sheet
from flatcloth.segmentation.partition import Divisions, Int8
from flatcloth.segmentation.result import (
    OF_INTEREST,
    OTHER,
    UNDECIDED,
    Segmentation,
    Suggestion,
    best_view,
    views_showing,
)


@dataclass(frozen=True, kw_only=True)
class _State:
    """What some decisions say, and the divisions that agree with them.

    ``known`` (M,) float64 is the side of each cluster under a stroke, 1 or -1; 0 elsewhere. ``holder`` (M,)
    is the decision that says so, -1 if none does. ``inner`` (M,) is True on inner faces that a stroke says
    are not of interest; ``excluded`` (M,) where a cut removed it; ``divisions`` (K, M) are the sides.
    """

    known: Float64
    holder: Int64
    inner: Bool
    excluded: Bool
    conflicts: tuple[str, ...]
    divisions: Int8

    @property
    def side(self) -> Float64:
        """The side (M,) in most divisions, 1 or -1; 0 where none joins a cluster to what is known."""
        most: Float64 = np.sign(self.divisions.sum(axis=0, dtype=np.float64))
        return most


class SideSolver:
    """Finds sides; may be called from several threads.

    Parameters
    ----------
    observed : Evidence
        The prepared views.
    """

    def __init__(self, observed: Evidence) -> None:
        self.observed, clusters, graph = observed, observed.clusters, observed.graph
        color = alike_in_color(clusters, graph, observed.color[:, 1:], observed.config)
        self._divisions = Divisions(graph, clusters.place_m, observed.config, color)
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
        Only what follows the longest known prefix is computed: a further stroke takes about 0.1 s.
        """
        key = tuple(decisions)
        return self._results.get(key, lambda: self._result(key))

    def most_probable(self, decisions: Sequence[Decision]) -> Float64:
        """Return the side (M,) of most divisions, 1 or -1, even if undecided; 0: none, or an inner face."""
        state = self._state(tuple(decisions))
        return np.where(state.inner, -1.0, np.where(self._doubted(state), 0.0, state.side))

    def agreement(self, decisions: Sequence[Decision]) -> Float64:
        """Return for each cluster (M,) how probably it is on the side that most divisions place it on."""
        divisions = self._state(tuple(decisions)).divisions
        count = len(divisions)
        share: Float64 = 0.5 + 0.5 * np.abs(divisions.mean(axis=0)) * count / (count + 1.0)
        return share

    def places(self, decisions: Sequence[Decision]) -> Iterator[Suggestion]:
        """Yield where strokes would determine most: first the largest area, then what it leaves uncertain."""
        now, state = self.solve(decisions), self._state(tuple(decisions))
        clusters = self.observed.clusters
        unsure = np.where(state.excluded, 0.0, clusters.area_m2 * (1.0 - now.certainty))
        if unsure.sum() < LEAST_AREA_M2:
            return
        inside = self._off_borders(state) & (state.holder < 0)
        weight = np.where(inside, unsure * clusters.facing**4, 0.0)
        if not weight.any():
            return
        random = np.random.default_rng(0)
        count = min(self.observed.config.samples, int((weight > 0).sum()))
        chosen = random.choice(len(weight), count, replace=False, p=weight / weight.sum())
        divisions = state.divisions.astype(np.float32)
        together = np.square(divisions[:, chosen].T @ divisions / len(divisions))
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
        count = self.observed.clusters.count
        known, nowhere = np.zeros(count), np.zeros(count, dtype=np.bool_)
        return _State(
            known=known,
            holder=np.full(count, -1, dtype=np.int64),
            inner=nowhere,
            excluded=nowhere,
            conflicts=(),
            divisions=self._divisions.sides(known, self.start_sheet),
        )

    def _after(self, state: _State, decisions: tuple[Decision, ...]) -> _State:
        number, decision = len(decisions) - 1, decisions[-1]
        name = f"decision {number + 1}"
        if isinstance(decision, Cut):
            of_interest = (state.side > 0) & ~state.inner & ~state.excluded
            excluded = state.excluded.copy()
            excluded[beyond(self.observed, decision, of_interest, name)] = True
            return replace(state, excluded=excluded)
        touched, wanted = under(self.observed, decision, name), 1.0 if decision.side == "this" else -1.0
        known, holder, face = state.known.copy(), state.holder.copy(), self.observed.inner
        own = (face >= 0) & np.isin(face, face[touched])
        inner = state.inner & ~own if wanted > 0 else state.inner | (own & (known <= 0.0))
        # An inner face that is none of interest lies where the divisions have it.
        known[touched] = np.where(inner[touched], state.side[touched], wanted)
        holder[touched] = number
        return replace(
            state,
            known=known,
            holder=holder,
            inner=inner,
            conflicts=(*state.conflicts, *self._conflicts(state, touched, wanted, number)),
            divisions=self._divisions.sides(known, self.start_sheet, state.divisions),
        )

    def _conflicts(self, state: _State, touched: Int64, wanted: float, number: int) -> list[str]:
        against = touched[state.known[touched] == -wanted]
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
        certainty = calibrated(observed.clusters, self.agreement(decisions))
        certainty[state.side == 0] = 0.5
        held, shown = state.holder >= 0, (state.side > 0) & ~state.inner
        certainty[shown & self._doubted(state)] = 0.5
        certainty[held | state.excluded] = 1.0
        side = np.where(shown, OF_INTEREST, OTHER).astype(np.int8)
        side[(certainty < observed.config.least_certainty) & ~state.inner] = UNDECIDED
        side[state.excluded] = OTHER
        found = Segmentation(
            observed=observed,
            decisions=decisions,
            side=side,
            certainty=certainty,
            conflicts=state.conflicts,
        )
        return replace(found, changed=self._changed(found)) if decisions else found

    def _doubted(self, state: _State) -> Bool:
        """Clusters (M,) on what looks like an inner face; only a stroke shows that it is none."""
        face = self.observed.inner
        doubted: Bool = ~np.isin(face, [*face[(state.known > 0) & ~state.inner], *face[self.start_sheet], -1])
        return doubted

    def _changed(self, now: Segmentation) -> str:
        before, area = self.solve(now.decisions[:-1]), self.observed.clusters.area_m2
        moved = now.side != before.side
        turned = moved & (now.side != UNDECIDED) & (before.side != UNDECIDED)
        sure = turned & (before.certainty >= self.observed.config.sure)
        sure_m2 = float(area[sure].sum())
        views = views_showing(self.observed, moved)
        text = f"The last decision changed {1e4 * float(area[moved].sum()):.0f} cm2 in {len(views)} views"
        return text + (
            f", of which {1e4 * sure_m2:.0f} cm2 were sure before." if sure_m2 >= LEAST_AREA_M2 else "."
        )

    # ---------------------------------------------------------------- where to go on

    def _off_borders(self, state: _State) -> Bool:
        """Clusters (M,) none of whose neighbours lies on the other side."""
        g = self.observed.graph
        apart = (g.weight > 0) & (state.side[g.first] != state.side[g.second])
        inner = np.ones(g.count, dtype=np.bool_)
        inner[g.first[apart]] = False
        inner[g.second[apart]] = False
        return inner
