"""The side of interest for any list of decisions. Results are cached by prefix: undo is exact and cheap."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flatcloth.core.cache import Cache
from flatcloth.core.strokes import Decision
from flatcloth.core.types import Bool, Float64, Int64
from flatcloth.segmentation.brushes import under
from flatcloth.segmentation.color import alike_in_color, odds_by_color
from flatcloth.segmentation.item import LEAST_AREA_M2
from flatcloth.segmentation.observed import Evidence
from flatcloth.segmentation.partition import Divisions, Int8
from flatcloth.segmentation.result import (
    OF_INTEREST,
    OTHER,
    UNDECIDED,
    Segmentation,
    Suggestion,
    best_view,
)
from flatcloth.segmentation.settings import SETTINGS, SURE


@dataclass(frozen=True, kw_only=True)
class _State:
    """What some decisions say, and samples of the sides that agree with them.

    ``said`` (M,) float64 is the side of each cluster under a stroke, 1 or -1; 0 elsewhere. ``holder`` (M,)
    is the decision that says so, -1 if none does.
    ``divisions`` (K, M) are the sides by the evidence, ``prior`` (K,) their odds, lower where strokes turned
    over most of the cloth; ``inner`` (K, F) is True where what looks like an inner face is one, so that it is
    none of interest.
    """

    said: Float64
    holder: Int64
    conflicts: tuple[str, ...]
    divisions: Int8
    prior: Float64
    inner: Bool


class SideSolver:
    """Finds sides; may be called from several threads.

    Parameters
    ----------
    observed : Evidence
        The prepared views.
    """

    def __init__(self, observed: Evidence) -> None:
        self.observed, clusters, graph = observed, observed.clusters, observed.graph
        chroma, samples = observed.color[:, 1:], SETTINGS.samples
        color = alike_in_color(clusters, graph, chroma)
        self._divisions = Divisions(graph, clusters.place_m, color)
        counts = np.arange(samples)[:, None] < color[1] * samples
        self._odds = np.where(counts, odds_by_color(graph, chroma, color[0]), 0.0).astype(np.float32)
        """Log odds of the one side by color in each sample (K, M)."""
        self._states: Cache[_State] = Cache(256, 256 << 20)
        self._results: Cache[Segmentation] = Cache(64, 64 << 20)
        view = observed.views[observed.start_view]
        self._first_m2 = np.bincount(
            view.cluster[view.surface], view.area_m2[view.surface], observed.clusters.count
        )
        """What the start view shows of each cluster (M,): without strokes, most of it is of interest."""
        outer = observed.inner == observed.inner[self._first_m2.argmax()]
        self._face = np.unique(np.where(outer, -1, observed.inner), return_inverse=True)[1]
        """What looks like an inner face, by number (M,); 0 elsewhere."""

    def solve(self, decisions: Sequence[Decision]) -> Segmentation:
        """Return the sides after these decisions, in order.

        Raises
        ------
        SegmentationError
            If a decision touches no cloth, or its view does not exist; the message says which.

        Notes
        -----
        Only what follows the longest known prefix is computed: a further stroke takes about 0.05 s.
        """
        key = tuple(decisions)
        return self._results.get(key, lambda: self._result(key))

    def probability(self, decisions: Sequence[Decision]) -> Float64:
        """Return how probably each cluster (M,) is of interest."""
        return self._probability(self._state(tuple(decisions)))

    def places(self, decisions: Sequence[Decision]) -> Iterator[Suggestion]:
        """Yield where strokes would help most, each after those before.

        A stroke tells which samples of the sides agree with it. It helps by the area that is expected to be
        wrong without it, and no more with it. Cloth of the same side in every sample is a patch.
        """
        state = self._state(tuple(decisions))
        clusters, graph = self.observed.clusters, self.observed.graph
        shown, weight = self._samples(state)
        if not state.said.any():  # perhaps the operator wants the other side
            turned = np.where(self._inner(state), -1, -state.divisions)
            shown = np.concatenate([shown, turned]).astype(np.int8)
            weight = np.concatenate([SURE * weight, (1.0 - SURE) * weight])
        area = np.where(state.holder >= 0, 0.0, clusters.area_m2)
        middle = (area > 0.0) & (clusters.facing > SETTINGS.alike_cos)
        side = np.sign(weight @ shown)
        border = (graph.weight > 0) & (side[graph.first] != side[graph.second])
        middle[np.concatenate([graph.first[border], graph.second[border]])] = False
        patches, patch = np.unique(shown, axis=1, return_inverse=True)
        area_m2 = np.bincount(patch, area)
        doubt_m2 = area_m2 * (1.0 - np.abs(weight @ patches)) * (np.bincount(patch, middle) > 0)
        chosen = np.argsort(-doubt_m2)[: SETTINGS.samples]
        chosen = chosen[doubt_m2[chosen] > 0.0]
        cells = weight[None]  # of the samples that agree with the same sides of the places before
        while chosen.size:
            apart = [np.concatenate([cells * on, cells * ~on]) for on in patches[:, chosen].T > 0]
            right_m2 = [float((np.abs(own @ patches) @ area_m2).sum()) for own in (cells, *apart)]
            best = int(np.argmax(right_m2[1:]))
            gain_m2 = 0.5 * (right_m2[1 + best] - right_m2[0])
            if gain_m2 < LEAST_AREA_M2:
                return
            cells = apart[best][apart[best].any(axis=1)]
            inside = np.flatnonzero(middle & (patch == chosen[best]))
            off_m = np.linalg.norm(clusters.place_m[inside] - clusters.place_m[inside].mean(axis=0), axis=1)
            at = int(inside[off_m.argmin()])
            if (seen := best_view(self.observed, at)) is None:
                return
            text = f"A stroke here, in view {seen[0]}, would settle about {1e4 * gain_m2:.0f} cm2."
            yield Suggestion(view_index=seen[0], rc=seen[1], gain_m2=gain_m2, text=text)

    # ---------------------------------------------------------------- states

    def _state(self, decisions: tuple[Decision, ...]) -> _State:
        if not decisions:
            return self._states.get((), self._begin)
        return self._states.get(decisions, lambda: self._after(self._state(decisions[:-1]), decisions))

    def _begin(self) -> _State:
        count, samples = self.observed.clusters.count, SETTINGS.samples
        begin = np.zeros(count)
        begin[self._first_m2.argmax()] = 1.0
        divisions = self._divisions.sides(begin)
        # Which side is which is one question for all samples: they agree about most of what is shown.
        alike = (divisions * self._first_m2) @ divisions.T.astype(np.float64)
        divisions *= np.where(np.linalg.eigh(alike)[1][:, -1:] < 0.0, -1, 1).astype(np.int8)
        if (divisions @ self._first_m2).sum() < 0.0:
            divisions = -divisions
        # Each face is an inner one in half of the samples, whatever the others are.
        half = np.tile(np.arange(samples) % 2 == 0, (int(self._face.max()) + 1, 1))
        inner = np.random.default_rng(0).permuted(half, axis=1).T
        inner[:, 0] = False
        return _State(
            said=np.zeros(count),
            holder=np.full(count, -1, dtype=np.int64),
            conflicts=(),
            divisions=divisions,
            prior=np.ones(samples),
            inner=inner,
        )

    def _after(self, state: _State, decisions: tuple[Decision, ...]) -> _State:
        number, decision = len(decisions) - 1, decisions[-1]
        name = f"decision {number + 1}"
        touched, wanted = under(self.observed, decision, name), 1.0 if decision.side == "this" else -1.0
        said, holder, inner = state.said.copy(), state.holder.copy(), state.inner.copy()
        said[touched], holder[touched] = wanted, number
        inner[:, np.setdiff1d(self._face[touched], 0)] = wanted < 0
        return replace(
            self._agreeing(state, said, holder),
            said=said,
            holder=holder,
            inner=inner,
            conflicts=(*state.conflicts, *self._conflicts(state, touched, wanted, number)),
        )

    def _agreeing(self, state: _State, said: Float64, holder: Int64) -> _State:
        """Return the state with divisions that agree with what is said.

        The first stroke also says which side is of interest: divisions that contradict it are turned over.
        That it is not what the start view shows most of, or that a later stroke turns over most of the cloth,
        is as improbable as what is surely not so. A stroke that lies mostly on what looks like an inner
        face says only that this face is of no interest.
        """
        inner = (self._face > 0) | (self._inner(state).mean(axis=0) > 0.5)
        inner = (np.bincount(holder + 1, inner) > 0.5 * np.bincount(holder + 1))[holder + 1]
        before, known = (np.where(inner & (each < 0), 0.0, each) for each in (state.said, said))
        other = (state.divisions @ known < 0.0) & ~before.any()
        divisions = np.where(other[:, None], -state.divisions, state.divisions)
        found = self._divisions.sides(known, divisions)
        turned = other | ((found * divisions) @ self.observed.clusters.area_m2 < 0.0)
        return replace(state, divisions=found, prior=state.prior * np.where(turned, 1.0 - SURE, SURE))

    def _conflicts(self, state: _State, touched: Int64, wanted: float, number: int) -> list[str]:
        against = touched[state.said[touched] == -wanted]
        found = []
        for earlier in np.unique(state.holder[against]):
            area = float(self.observed.clusters.area_m2[against[state.holder[against] == earlier]].sum())
            found.append(
                f"Decisions {earlier + 1} and {number + 1} contradict each other about {1e4 * area:.1f} cm2 "
                "of cloth; the later one holds there."
            )
        return found

    # ---------------------------------------------------------------- results

    def _samples(self, state: _State) -> tuple[Int8, Float64]:
        """Return samples (K, M) of what is of interest, 1 or -1, and their probabilities (K,).

        Both sheets of a garment are seen: the difference of their areas has a standard deviation of half of
        the whole.
        """
        shown = np.where(self._inner(state), -1, state.divisions).astype(np.int8)
        area = self.observed.clusters.area_m2
        difference = state.divisions @ area / area.sum()
        weight = state.prior * np.exp(-0.5 * np.square(2.0 * difference))
        return shown, weight / weight.sum()

    def _inner(self, state: _State) -> Bool:
        """Return what is an inner face in each sample (K, M): by its look, or the other side's color."""
        alike = state.divisions * self._odds
        alike *= np.sign(alike.sum(axis=1, keepdims=True))
        found: Bool = state.inner[:, self._face] | (alike < -1.0)
        return found

    def _probability(self, state: _State) -> Float64:
        """Return how probably each cluster (M,) is of interest, with caution.

        Errors that no disturbance shows turn each sample over as probably as what is surely not so: either
        side gets this much more weight. No cloth is surer than what lies around it and faces alike.
        """
        shown, weight = self._samples(state)
        mean = weight @ shown / (1.0 + 2.0 * (1.0 - SURE))
        side = np.sign(mean)
        probable = 0.5 + 0.5 * side * np.clip(side * (self.observed.around @ mean), 0.0, np.abs(mean))
        return np.where(state.said != 0.0, state.said > 0.0, probable)

    def _result(self, decisions: tuple[Decision, ...]) -> Segmentation:
        state, observed = self._state(decisions), self.observed
        probability = self._probability(state)
        certainty = np.maximum(probability, 1.0 - probability).astype(np.float32)
        side = np.where(probability > 0.5, OF_INTEREST, OTHER).astype(np.int8)
        side[certainty < SETTINGS.least_certainty] = UNDECIDED
        found = Segmentation(
            observed=observed,
            decisions=decisions,
            side=side,
            certainty=certainty,
            conflicts=state.conflicts,
        )
        return replace(found, changed=self._changed(found)) if decisions else found

    def _changed(self, now: Segmentation) -> str:
        before, area = self.solve(now.decisions[:-1]), self.observed.clusters.area_m2
        moved = now.side != before.side
        turned = moved & (now.side != UNDECIDED) & (before.side != UNDECIDED)
        sure = turned & (before.certainty >= SURE)
        sure_m2 = float(area[sure].sum())
        views = sum(bool(moved[view.shows].any()) for view in self.observed.views.values())
        text = f"The last decision changed {1e4 * float(area[moved].sum()):.0f} cm2 in {views} views"
        return text + (
            f", of which {1e4 * sure_m2:.0f} cm2 were sure before." if sure_m2 >= LEAST_AREA_M2 else "."
        )
