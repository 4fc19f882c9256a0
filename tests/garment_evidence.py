"""Outlines as if they had been seen: the evidence of their cloth, and views of flat sheets."""

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from flatcloth.core.types import FlattenedView, Rigid2
from flatcloth.flattening.cloth import Cloth
from flatcloth.garments.distance import inside_outline
from flatcloth.garments.evidence import PieceEvidence
from flatcloth.garments.kinds import kind_named


def sampled(outline: np.ndarray, spacing: float = 0.006) -> tuple[np.ndarray, np.ndarray]:
    """Return places along a closed outline and the outward directions there."""
    places, normals = [], []
    for a, b in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        length = np.linalg.norm(b - a)
        count = max(1, int(length / spacing))
        share = (np.arange(count) + 0.5) / count
        places.append(a + share[:, None] * (b - a))
        normals.append(np.tile([(b - a)[1] / length, -(b - a)[0] / length], (count, 1)))
    return np.concatenate(places), np.concatenate(normals)


def evidence_from(
    outline: np.ndarray, motion: Rigid2 | None = None, keep: np.ndarray | None = None, noise_m: float = 0.0
) -> PieceEvidence:
    """Return the evidence of an outline's cloth, moved; ``keep`` (u, v, limit) cuts it off along a line."""
    edges, normals = sampled(outline)
    low, high = outline.min(axis=0), outline.max(axis=0)
    grid = np.stack(np.meshgrid(*(np.arange(a, b, 0.018) for a, b in zip(low, high, strict=True))), axis=-1)
    inside = grid.reshape(-1, 2)
    inside = inside[inside_outline(inside, outline)]
    if keep is not None:
        chosen = edges @ keep[:2] <= keep[2]
        edges, normals = edges[chosen], normals[chosen]
        inside = inside[inside @ keep[:2] <= keep[2]]
    edges = edges + noise_m * np.random.default_rng(1).standard_normal(edges.shape)
    motion = motion or Rigid2()
    xyz = np.concatenate([inside, np.ones((len(inside), 1))], axis=1)
    return PieceEvidence(
        edge_uv_m=motion.apply(edges),
        edge_normal=Rigid2(motion.theta_rad).apply(normals),
        edge_std_m=np.zeros(len(edges)),
        edge_trust=np.ones(len(edges)),
        unseen_uv_m=np.zeros((0, 2)),
        inside_uv_m=motion.apply(inside),
        inside_std_m=np.zeros(len(inside)),
        inside_xyz_m=xyz,
        area_m2=len(inside) * 0.018**2,
        hole_edge_m=0.0,
        depth_m=np.zeros((1, 1), dtype=np.float32),
        depth_origin_uv_m=np.full(2, -50.0),
        depth_pixel_m=0.002,
    )


def blank_view(valid: np.ndarray, pixel_size_m: float = 0.002, **other: Any) -> FlattenedView:
    """Return a flat sheet 0.85 m before the camera, parallel to the image, but for given attributes."""
    rows, cols = valid.shape
    row, col = np.mgrid[0:rows, 0:cols]
    xyz = np.stack([col * pixel_size_m, row * pixel_size_m, np.full(valid.shape, 0.85)], axis=-1)
    view = FlattenedView(
        rgb=np.full((rows, cols, 3), 128, dtype=np.uint8),
        xyz_m=np.where(valid[..., None], xyz, np.nan).astype(np.float32),
        normal=np.where(valid[..., None], [0.0, 0.0, -1.0], np.nan).astype(np.float32),
        z_angle_deg=np.where(valid, 0.0, np.nan).astype(np.float32),
        valid=valid,
        view_index=np.where(valid, 0, -1).astype(np.int16),
        source_rc=np.zeros((rows, cols, 2), dtype=np.float32),
        pixel_size_m=pixel_size_m,
        origin_uv_m=(0.0, 0.0),
    )
    return replace(view, **other)


def at_mean(name: str) -> np.ndarray:
    kind = kind_named(name)
    drawn: np.ndarray = kind.outline(kind.mean[:, None])[:, :, 0]
    return drawn


def weakly_joined(rows: int, cols: int, weak_after: int, weak: float = 0.05) -> Cloth:
    """Return a flat sheet of samples 12 mm apart, weakly joined around one of its columns."""
    row, col = (each.ravel() for each in np.mgrid[0:rows, 0:cols])
    uv = 0.012 * np.stack([col, row], axis=1)
    edges = cKDTree(uv).query_pairs(0.018, output_type="ndarray").astype(np.int32)
    steep = (np.abs(col[edges] - weak_after - 0.5) < 3.0).any(axis=1)
    across = (col[edges] <= weak_after).sum(axis=1) == 1
    xyz = np.concatenate([uv, np.full((len(uv), 1), 0.85)], axis=1)
    return cloth_of(uv, xyz, edges, np.where(across, weak, np.where(steep, 0.3, 1.0)))


def cloth_of(uv: np.ndarray, xyz: np.ndarray, edges: np.ndarray, evidence: np.ndarray) -> Cloth:
    """Return flat cloth that the first view saw, by its samples and the pairs of them."""
    return Cloth(
        uv_m=uv,
        xyz_m=xyz,
        edges=edges,
        length_m=np.linalg.norm(uv[edges[:, 0]] - uv[edges[:, 1]], axis=1),
        evidence=evidence,
        view_index=np.zeros(len(edges), dtype=np.int32),
    )
