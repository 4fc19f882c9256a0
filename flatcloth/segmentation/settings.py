"""Constants of the segmentation, with their units and sources."""

from __future__ import annotations

from dataclasses import dataclass

ALIKE_COS = 0.3
"""Normals of one side at one place differ by less than 73 degrees. Chosen."""
THREADS = 2
"""Views, or samples, processed in parallel. Chosen for two cores; more need more memory."""


@dataclass(frozen=True, kw_only=True)
class SegmentationConfig:
    """How the side of interest is found.

    Values without another source were chosen on ten of the shared recordings and are measured by
    ``python -m benchmarks segmentation``, which also measures recordings of garments not among them.
    """

    cluster_m: float = 0.006
    """Radius of a cluster of surface pixels, all views together; ..."""
    cluster_offset_m: float = 0.0015
    """... pixels farther than this along the normal are another layer, ..."""
    cluster_noise: float = 5.0
    """... or than this multiple of the depth noise."""
    cluster_cos: float = 0.6
    """Normals in a cluster differ by at most the angle of this cosine."""
    link_facing: float = 2.0
    """Weight at which links of neighbouring pixels, seen squarely, count half."""
    convex: float = 0.15
    """Links across a convex turn (sum of the sines at both ends) sharper than this are weaker, by a Gaussian
    of this width, ..."""
    least_link: float = 0.002
    """... but by no more than this."""
    opposite_cos: float = -0.85
    """Normals of the two layers of a plate differ by at least the angle of this cosine, ..."""
    opposite_m: float = 0.004
    """... one lies behind the other by at most this without noise, or by ``cluster_m`` with noise (stereo
    sensors enlarge near surfaces), ..."""
    opposite_behind_m: float = 0.003
    """... or in front of it by this, because of registration errors, ..."""
    opposite_beside_m: float = 0.005
    """... and their distance across the normal is at most this."""
    thickness_weight: float = 2.0
    """Most evidence of an inner face that the thickness of one layer gives for each cluster."""
    noisy_depth_m: float = 0.0003
    """Depth that scatters more than this about its local planes (median) is noisy."""
    samples: int = 32
    """Partitions of disturbed graphs; the certainty is computed from them."""
    disturbance: float = 1.0
    """Standard deviation of the disturbance of the logarithm of the evidence; ..."""
    disturbance_m: float = 0.05
    """... it is correlated over this distance."""
    flip_exponent: float = 0.3
    """A stroke turns over the region with the least border cost divided by its size to this power; ..."""
    flip_per_cluster: float = 0.06
    """... each cluster adds this to the cost, times the stroke's number, ..."""
    flip_potential: float = 0.6
    """... and only clusters below this potential are turned over (-1 at the stroke, 1 at the others)."""
    most_cost: float = 62.0
    """A region of a higher cost has no clear border. If the first stroke contradicts a side that was shown,
    the guess was probably wrong: all is turned over or, if a sample separates the stroke from the start
    sheet, the cloth outside the region becomes undecided. For other strokes, the graph is partitioned again,
    if that costs less. Learned: the middle of the values with the fewest errors after a first stroke;
    ``python -m benchmarks segmentation --learn`` prints it, also with each garment left out."""
    flip_rounds: int = 1
    """How often the potentials are reweighted."""
    least_certainty: float = 0.7
    """Cloth with a lower certainty is undecided, and not part of the shape, ..."""
    certainty_per_stroke: float = 0.05
    """... less this for each stroke after the second, because operators correct large errors first, ..."""
    undecided_below: float = 0.575
    """... but not less than this: below it only a stroke decides. A certainty of 0.62 is right in 0.58."""
    sure: float = 0.9
    """If cloth of a higher certainty is turned over, its area is reported. Cloth that strokes turned over is
    undecided below this certainty, ..."""
    turned_per_stroke: float = 0.1
    """... less this for each stroke after the first, for the same reason."""
    fill_px: int = 16
    """Pixels of the item without a cluster take the nearest one within this distance, and within
    ``thickest_m`` in depth."""

    @property
    def thickest_m(self) -> float:
        """Surface farther behind a cluster is another object, and no measurement of its thickness."""
        return 2.0 * self.cluster_m
