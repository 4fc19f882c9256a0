"""The formats of recordings: one module for each, all registered in ``recordings.registry``.

Input: a file or folder. Output: a :class:`Recording`.
"""
