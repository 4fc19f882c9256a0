"""HTTP routes: layers, source images, exports, capture.

Input: requests. Output: bytes with their media type.
"""
