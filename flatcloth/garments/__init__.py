"""What a canonical shape is, how large, and where its named points lie.

In: a flattened view with its floating pieces and the depth images that it was seen in. Out: a
probability for each kind of garment, dimensions and named points, each with a standard deviation.
"""
