"""What everything stands on: types, geometry, settings, errors, access to files and processes.

In: nothing of this program. Out: names that every other package may import.
"""
