"""The garment of a session: recognised from its shape, and compared with the truth.

In: an integration and a document. Out: the garment that fits, its points and dimensions.
"""
