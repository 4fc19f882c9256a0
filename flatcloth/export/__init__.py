"""Files written from a session: data, an offline page, figures, an animation, a report.

Input: a session folder, which is only read (not locked or changed), so that it can be exported while it is
open elsewhere. Output: files; the same session gives identical bytes.
"""
