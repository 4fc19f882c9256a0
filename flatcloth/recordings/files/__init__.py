"""Single files of recordings: paths that stay inside their folder, images, depth files, camera and lens.

In: a path. Out: checked values and arrays, or a :class:`RecordingError` of one line.
"""
