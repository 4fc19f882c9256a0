"""What the server answers over HTTP: layers, source images, exports, capture.

In: requests. Out: bytes with their type.
"""
