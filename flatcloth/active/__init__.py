"""The active loop: a goal decides where the item is turned next, and when it is known.

In: views of a camera, a robot or a simulated cell, one at a time. Out: the next angle, or the end with its
reason, and a session folder.
"""
