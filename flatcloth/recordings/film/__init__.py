"""Films of an item that was turned in steps or without a stop: where it stood still, and at which angle.

In: frames with times. Out: views with angles.
"""
