"""Seams: this side and the other side of an item, joined where their rims meet in space.

The paper flattens one side. Both are sheets of one garment: where this side is hidden in a fold, the cloth
goes on over a seam onto the other. :mod:`flatcloth.methods.robust.seams.joining` has the algorithm.
"""
