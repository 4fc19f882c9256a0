"""Which sets of matches are seams, and which cloth between them joins falsely: all configurations.

A configuration says which sets of a pair of pieces are true. Two true sets that place the pieces differently
need cloth between them that joins falsely. The logarithm of its probability, up to a constant, is the sum of
the log odds of the true sets and of those of the false joints that they need. There are few sets, so all
configurations are looked at.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from flatcloth.core.types import Bool, Float64

MOST_SETS = 12
"""Sets whose configurations are all looked at, the strongest. Chosen: 4,096 of them."""


@dataclass(frozen=True, kw_only=True)
class Configuration:
    """The most probable configuration, ``true`` (K,), and what all of them say.

    ``all_true`` (2^K, K) are all of them, ``chance`` (2^K,) their probabilities; ``probability`` (K,) that
    each set is true. ``needs`` the pairs of true sets that need a false joint in the most probable one,
    ``false`` the probability that they do, for each pair.
    """

    true: Bool
    all_true: Bool
    chance: Float64
    probability: Float64
    needs: frozenset[tuple[int, int]]
    false: Mapping[tuple[int, int], float]


def configured(log_odds: Sequence[float], false: Mapping[tuple[int, int], float]) -> Configuration:
    """Return what all configurations of the sets of a pair of pieces say.

    Parameters
    ----------
    log_odds : K numbers
        Logarithm of the odds that each set is true, by itself; the surest first, at most ``MOST_SETS``.
    false : mapping
        For each two sets (n, k), n < k, that place the pieces differently: the probability that the cloth
        between them, of either side, joins falsely.
    """
    count = len(log_odds)
    true = (np.arange(2**count)[:, None] >> np.arange(count)) & 1 > 0
    weight = true @ np.asarray(log_odds, dtype=np.float64)
    needs: dict[tuple[int, int], Bool] = {}
    for k in range(count):
        # A true set needs one joint to be false, the most doubtful one; none if it agrees with a true one.
        against = sorted((n for n in range(k) if (n, k) in false), key=lambda n: -false[n, k])
        alone = true[:, k] & ~true[:, [n for n in range(k) if (n, k) not in false]].any(axis=1)
        for n in against:
            needs[n, k] = alone & true[:, n]
            alone = alone & ~true[:, n]
            weight[needs[n, k]] += np.log(max(false[n, k], 1e-300)) - np.log1p(-false[n, k])
    chance = np.exp(weight - weight.max())
    chance /= chance.sum()
    best = int(weight.argmax())
    return Configuration(
        true=true[best],
        all_true=true,
        chance=chance,
        probability=chance @ true,
        needs=frozenset(pair for pair, needed in needs.items() if needed[best]),
        false={pair: float(chance @ needed) for pair, needed in needs.items()},
    )
