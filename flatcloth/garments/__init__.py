"""Recognition of garments: kind, dimensions and named points of a canonical shape.

In: a flattened view with its floating pieces and the depth images that it was seen in. Out: a
probability for each kind of garment, dimensions and named points, each with a standard deviation.
"""
