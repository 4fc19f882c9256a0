"""From a pixel of the flattened view to a grasp pose: picks, grips, hand-eye, measuring, visibility.

Input: flattened views and positions on them. Output: poses, lengths, and the views that saw a point.
"""
