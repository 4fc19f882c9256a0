"""ROS bags without ROS.

In: a ``.bag`` or ``.mcap`` file. Out: a :class:`Recording`.
"""
