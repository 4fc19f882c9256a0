"""RealSense files and frames: librealsense is loaded when it is first needed.

In: a ``.db3`` or ``.bag`` file. Out: registered frames in NumPy.
"""
