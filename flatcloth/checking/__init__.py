"""Checks whether a recording is right: its turning, its images, its camera.

Input: a recording. Output: findings, each with a probability and the mends that remove it.
"""
