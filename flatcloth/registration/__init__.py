"""The rig: the turning axis and the pose of the camera at each view, refined from the views themselves.

In: recorded views and surfaces. Out: an axis, a held point, and a small motion for each view.
"""
