"""Views that the operator laid by hand: pairs that he vouches for, where the views share nothing in space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flatcloth.core.geometry import fit_rigid2
from flatcloth.core.types import Bool, Complex128, Float64
from flatcloth.shape.graph import Graph, Links, merged, pairs_as_laid, pairs_within, rotations_at, uv_of, z_of
from flatcloth.shape.observations import PAIR_INTERVALS, Association, Observation, PlacedView
from flatcloth.shape.shape import PLACE_STD_M, Shape


@dataclass(frozen=True, kw_only=True)
class ByHand:
    """A view that the operator laid on the shape ``on`` of the views before it, where he sees that cloth
    belongs.

    ``view`` with its pose; ``shown`` are nodes of that shape that the view shows, where its cloth hangs;
    ``pixel_uv_m`` (H, W, 2) is where the view's pixels were laid on the plane, NaN for those that were not.
    """

    view: PlacedView
    on: Shape
    shown: Association
    pixel_uv_m: Float64


def with_hands(
    graph: Graph, links: Links, seen: Sequence[Observation], by_hand: Sequence[ByHand]
) -> tuple[Graph, Links, Bool]:
    """Return a graph with pairs between the cloth that the operator laid and the cloth that it was laid on.

    Parameters
    ----------
    graph, links
        All views, those laid by hand last.
    seen : sequence of Observation
        What each of these sees.
    by_hand : sequence of ByHand
        How each of the last of these views was laid.

    Returns
    -------
    Graph, Links
        With the further pairs.
    (P,) bool
        The further pairs.
    """
    parts = [graph]
    for view, laid in zip(seen[len(seen) - len(by_hand) :], by_hand, strict=True):
        row, col = np.rint(view.rc).astype(np.int32).T
        z, under = np.full((2, len(graph)), np.nan + 0j)
        z[view.node] = z_of(laid.pixel_uv_m[row, col])
        _bring_pieces(laid.on, z)
        own = np.flatnonzero(np.isfinite(z))
        rotation = rotations_at(graph, z)
        under[: len(laid.on.nodes)] = z_of(laid.on.uv_m)
        under[own] = np.nan  # the same cloth needs no pair
        there = np.flatnonzero(np.isfinite(under))
        rotation[there] = rotations_at(graph, under)[there]
        z[there] = under[there]
        reach_m = PAIR_INTERVALS * float(np.median(graph.length_m))
        one, other = pairs_within(uv_of(z[own]), uv_of(z[there]), reach_m)
        pairs = np.sort(np.stack([own[one], there[other]], axis=1), axis=1)
        known = {tuple(pair) for part in parts for pair in part.pairs.tolist()}
        new = np.array([tuple(pair) not in known for pair in pairs.tolist()], dtype=np.bool_)
        parts.append(pairs_as_laid(graph, pairs[new], z, rotation, PLACE_STD_M, evidence=1.0))
    whole, order = merged(parts, graph.xyz_m)
    place = np.argsort(order).astype(np.int32)
    return whole, replace(links, pair=place[links.pair]), order >= len(graph.pairs)


def _bring_pieces(on: Shape, z: Complex128) -> None:
    """Let floating pieces follow three or more nodes that were laid: set the places (N,) of the others."""
    is_laid = np.isfinite(z[: len(on.piece)])
    for number in range(1, int(on.piece.max()) + 1):
        own, rest = (np.flatnonzero((on.piece == number) & which) for which in (is_laid, ~is_laid))
        if len(own) >= 3:
            z[rest] = z_of(fit_rigid2(on.all_uv_m[own], uv_of(z[own])).apply(on.all_uv_m[rest]))
