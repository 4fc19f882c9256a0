"""The method ``robust``: 3D correspondences and one joint flattening of all views; start at ``method``.

In: surfaces, flattened views and decisions. Out: plans, placements and canonical views with their
uncertainty.
"""
