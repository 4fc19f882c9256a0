"""The base of all packages: types, geometry, settings, errors, access to files and processes.

It imports nothing of this program; every other package may import it.
"""
