"""The method ``robust``: 3D correspondences and one joint flattening of all views.

Start at ``method``. Input: surfaces, flattened views and decisions. Output: plans, placements and
canonical views with their placement uncertainty.
"""
