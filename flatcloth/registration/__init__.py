"""Registration of the rig: the turning axis and the pose of the camera at each view, from the views.

Input: recorded views and surfaces. Output: an axis, a held point, and a small motion for each view.
"""
