"""Live mode: frames of a recording or a camera, each flattened from the result of the last.

In: a recording or a camera. Out: flattened frames and their clouds.
"""
