"""Answers what a session asks for: views, proposals, repair, unattended runs, live mode, teaching.

In: a recording, a configuration and documents. Out: proposals, canonical shapes and reports.
"""
