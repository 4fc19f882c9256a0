"""The item, and its side of interest, found without masks; strokes correct it.

In: the frames of a recording, where it turns (``gather_evidence``), and the operator's strokes
(``core.strokes``). Out: ``Segmentation``, a side with a certainty for every surface pixel of all views.
``SideSolver`` solves again within 0.15 s after each stroke and remembers every prefix, so undo is exact.
"""
