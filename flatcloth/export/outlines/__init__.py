"""The outline of the shape: polygons in mm, and their files (SVG, DXF, JSON).

In comes a flattened view; out go polygons and texts.
"""
