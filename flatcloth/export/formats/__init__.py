"""The documents that flatcloth writes, as types, and the formats of other tools that it can write besides.

In: the results of a session. Out: JSON Schemas, and files that rerun, Foxglove or COCO's tools read.
"""
