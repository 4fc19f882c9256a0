"""The methods that integrate flattened views into the canonical shape.

Input: single views and the decisions of a session. Output: plans, placements and canonical shapes
(``base``).
"""
