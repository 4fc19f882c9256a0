"""The compiled functions of an integration, so that they can be compiled before they are needed.

In: ``table.json``, the functions and the types they are called with. Out: shares of it, compiled on disk.
"""
