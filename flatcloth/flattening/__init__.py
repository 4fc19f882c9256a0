"""Flattening of one view: a depth image becomes the flattened view ``F(u, v)`` (paper, section 3).

Input: an RGB-D frame and the turning axis. Output: the surface, its sample points, and flattened
views with all intermediate results.
"""
