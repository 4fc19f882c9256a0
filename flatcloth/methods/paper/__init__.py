"""The method ``paper``: sections 4.1 to 4.3 as they stand, one rigid placement a view; start at ``method``.

In: flattened views and decisions. Out: plans, placements and canonical views.
"""
