"""The method ``paper``: sections 4.1 to 4.3 of the paper with one rigid placement per view.

Start at ``method``. Input: flattened views and decisions. Output: plans, placements and canonical views.
"""
