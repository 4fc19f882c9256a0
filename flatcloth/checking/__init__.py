"""Checks whether a recording says the truth: its turning, its images, its camera.

Input: a recording. Output: findings, each with a probability and the mends that remove it.
"""
