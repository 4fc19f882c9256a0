"""The modes of the page: a session, a camera, teaching.

Input: messages of the page, in one queue. Output: states for the tabs and objects for the scene.
"""
