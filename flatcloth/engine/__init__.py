"""The computations that a session requests: views, proposals, repair, unattended runs, a camera, teaching.

Input: a recording, a configuration and documents. Output: proposals, canonical shapes and reports.
"""
