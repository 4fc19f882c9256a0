"""What a session leaves behind: data files, an offline page, figures, an animation, a report.

In: a session folder, which is only read (no lock, no change), so that one can be exported while it is open
elsewhere. Out: files; the same session gives the same bytes.
"""
