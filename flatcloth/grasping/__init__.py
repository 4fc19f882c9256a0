"""From a pixel of the flattened view to a grasp pose: picks, grips, hand-eye, measuring, visibility.

In: flattened views and places on them. Out: poses, lengths, and the views that saw a point.
"""
