"""What is taken away from a session: an offline page, figures, an animation, a report.

A session folder is only read here (no lock, no change), so that one can be exported while it is
open elsewhere. The same session gives the same bytes.
"""
