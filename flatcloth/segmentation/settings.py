"""Constants of the segmentation, with their units and sources."""

from __future__ import annotations

from dataclasses import dataclass

SURE = 0.9
"""Probability from which an answer is given without reserve, and acted on without asking: a side, a kind of
garment, the place of a floating piece, a link of the shape. Chosen; docs/segmentation.md and docs/garments.md
have the measured reliability."""


@dataclass(frozen=True, kw_only=True)
class SegmentationConfig:
    """How the side of interest is found.

    Values without another source were chosen on ten of the shared recordings and are measured by
    ``python -m benchmarks segmentation``, which also measures recordings of garments not among them.
    """

    cluster_m: float = 0.006
    """Radius of a cluster of surface pixels, all views together; pixels farther than a quarter of it along
    the normal are another layer, ..."""
    cluster_noise: float = 5.0
    """... or farther than this multiple of the depth noise."""
    alike_cos: float = 0.6
    """Normals of one side at one place differ by at most the angle of this cosine; those of the two layers of
    a plate, one of them reversed, too."""
    enough_pixels: float = 10.0
    """Pixels at which a cluster's evidence has half of its full weight."""
    link_facing: float = 2.0
    """Weight at which links of neighbouring pixels, seen squarely, count half."""
    convex: float = 0.15
    """Links across a convex turn (sum of the sines at both ends) sharper than this are weaker, by a Gaussian
    of this width."""
    layers_m: float = 0.004
    """The two layers of a plate lie at most this far apart."""
    samples: int = 32
    """Divisions by disturbed evidence; the certainty is computed from them."""
    disturbance_m: float = 0.05
    """Errors of the evidence of a pair, and prints, are alike over this distance."""
    border_m: float = 0.02
    """The border of the sides is found about as exactly as this. With 2 to 3 cm 97 % of 80 recordings are
    within 3 % after two strokes, with 1 cm 94 %."""
    least_region: int = 30
    """Fewest clusters of an inner face. Chosen."""
    least_certainty: float = 0.7
    """Cloth with a lower certainty is undecided, and not part of the shape."""

    @property
    def near_m(self) -> float:
        """Places farther apart, or in depth, belong to different cloth."""
        return 2.0 * self.cluster_m


SETTINGS = SegmentationConfig()
