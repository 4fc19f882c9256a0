"""Films of an item that was turned, in steps or continuously: finding its stops and their angles.

Input: frames with times. Output: views with angles.
"""
