"""Folders of other programs: TUM RGB-D and Open3D.

In: a folder. Out: a :class:`Recording`.
"""
