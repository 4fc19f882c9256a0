"""The 3D scene in viser: the item in the object frame, clouds, the axis, the camera.

Input: pictures of documents. Output: viser nodes.
"""
