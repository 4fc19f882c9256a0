"""The modes of the page: a session, live play, capture, teaching.

Input: messages of the page, in one queue. Output: states for the tabs and objects for the scene.
"""
