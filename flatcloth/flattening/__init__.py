"""One view to its flattened view ``F(u, v)`` (paper, section 3).

In: an RGB-D frame and the turning axis. Out: a surface, sample points, and flattened views with their
intermediates.
"""
