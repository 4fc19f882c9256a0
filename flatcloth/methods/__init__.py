"""The methods that integrate flattened views into the canonical shape.

In: single views and the decisions of a session. Out: plans, placements and canonical shapes (``base``).
"""
