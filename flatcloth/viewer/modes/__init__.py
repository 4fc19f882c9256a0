"""What the page does in each mode: a session, live play, capture, teaching.

In: messages of the page, on one queue. Out: states for the tabs and objects for the scene.
"""
