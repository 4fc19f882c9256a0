"""The numbers of the segmentation, with their units and where they come from."""

from __future__ import annotations

from dataclasses import dataclass

ALIKE_COS = 0.3
"""Normals of one side at one place differ by less than 73 degrees. Chosen."""
THREADS = 2
"""Views, and samples, worked on at a time. Chosen for two cores; more need more memory."""


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
    """... or so many times the noise of the depth."""
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
    sensors make what is near larger), ..."""
    opposite_behind_m: float = 0.003
    """... or before it by this, by errors of the registration, ..."""
    opposite_beside_m: float = 0.005
    """... and beside it by at most this."""
    thickness_weight: float = 2.0
    """Cloth of one layer is evidence of an inner face, at most this much for each cluster."""
    noisy_depth_m: float = 0.0003
    """Depth that scatters more than this about its local planes (median) is noisy."""
    samples: int = 32
    """Partitions of disturbed graphs, from which the certainty is taken."""
    disturbance: float = 1.0
    """Standard deviation of the logarithm of the evidence, alike ..."""
    disturbance_m: float = 0.05
    """... over this extent."""
    flip_exponent: float = 0.3
    """A stroke turns over the region whose border costs least, over its size to this power; ..."""
    flip_per_cluster: float = 0.06
    """... each cluster adds this to the cost, times the number of the stroke, ..."""
    flip_potential: float = 0.6
    """... and none is farther from the stroke than this potential (-1 at the stroke, 1 at the others)."""
    most_cost: float = 62.0
    """A region that would cost more than this has no clear border. A first stroke that contradicts a side
    that was shown then may mean that the guess was wrong: all is turned over, or, if a sample divides both,
    what is not in the region is undecided. For any other stroke, the partition is made anew, if that costs
    less. Learned, as the middle of the values with which least is wrong after a first stroke; ``python -m
    benchmarks segmentation --learn`` prints it, and leave-one-garment-out."""
    flip_rounds: int = 1
    """Reweightings of the potentials."""
    least_certainty: float = 0.7
    """Cloth that is less certain than this is undecided, and stays out, ..."""
    certainty_per_stroke: float = 0.05
    """... less this for each stroke after the second: what is wrong would have been stroked first, ..."""
    undecided_below: float = 0.575
    """... but what is less certain than this is told by a stroke only: where it says 0.62, 0.58 is right."""
    sure: float = 0.9
    """What is more certain than this is not turned over silently. What strokes turned over is undecided if it
    is less certain, ..."""
    turned_per_stroke: float = 0.1
    """... less this for each stroke after the first, as above."""
    fill_px: int = 16
    """Pixels of the item without a cluster take that of the nearest with one, within this distance and
    ``thickest_m`` in depth."""

    @property
    def thickest_m(self) -> float:
        """What lies farther behind a cluster is another thing, and tells nothing of the thickness there."""
        return 2.0 * self.cluster_m
