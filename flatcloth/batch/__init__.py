"""Many recordings at once: a data set becomes session folders and one table.

In come sources (folders, globs, manifests, data set layouts) and options; out go a session folder a
recording, ``results.csv``, and a page to review them. The tasks run in processes of
this machine, or on the workers of a Dask scheduler.
"""
