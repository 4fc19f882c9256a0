"""The files of recordings: paths that stay inside their folder, images, depth files, camera and lens.

Input: a path. Output: checked values and arrays, or a :class:`RecordingError` of one line.
"""
