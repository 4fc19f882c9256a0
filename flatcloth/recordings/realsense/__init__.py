"""RealSense files and frames; librealsense is loaded on first use.

Input: a ``.db3`` or ``.bag`` file, or framesets. Output: registered images as NumPy arrays.
"""
