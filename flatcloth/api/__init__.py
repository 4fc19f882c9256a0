"""The public functions of flatcloth (docs/api.md); ``import flatcloth`` offers them by name.

In: a recording and settings. Out: flattened views and :class:`~flatcloth.api.shape.Shape`. The commands, the
batch engine and the examples use these functions too.
"""
