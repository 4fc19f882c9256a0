"""ROS bags, read without ROS.

Input: a ``.bag`` or ``.mcap`` file. Output: a :class:`Recording`.
"""
