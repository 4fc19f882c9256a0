"""Rendering of arrays to pictures: layers, colour maps, charts and drawings, for viewer and export.

Input: flattened views and curves. Output: images as arrays, SVG or PNG.
"""
