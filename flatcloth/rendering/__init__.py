"""Arrays to pictures: layers, colour maps, charts and drawings, for the viewer and the export alike.

In: flattened views and curves. Out: images as arrays, SVG or PNG.
"""
